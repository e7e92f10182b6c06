"""Recognition and heading scores."""

import numpy as np
import pytest

import lodeflow as lf
from lodeflow.testing import run_node
from lodeflow_plugins.scoring import recognition
from lodeflow_plugins.scoring.heading_score import ScoreHeading
from lodeflow_plugins.scoring.recognition_score import ScoreRecognition

DEG = np.radians(1.0)


def test_shares_by_hand():
    error = DEG * np.array([1, 2, 3, 6, 7, 1, 9, 4])
    accepted = np.array([1, 1, 0, 1, 0, 1, 0, 0], bool)
    candidates = np.array([1, 1, 1, 1, 1, 1, 0, 0], bool)
    found = recognition.score(error, accepted, candidates, 5 * DEG)
    assert found.recognised == 3 / 5
    assert found.mistaken == 1 / 4
    assert found.kept == 3 / 4
    assert found.accepted == 0.5
    assert found.error_max == pytest.approx(6 * DEG)
    assert (found.good, found.samples) == (5, 8)


def test_nothing_accepted_or_good():
    found = recognition.score(np.ones(3), np.zeros(3, bool), np.ones(3, bool), 0.1)
    assert np.isnan([found.recognised, found.mistaken, found.kept, found.error_max]).all()
    assert found.accepted == 0.0


def test_the_difference_of_headings_is_the_short_way_round():
    error = recognition.heading_error(np.radians([359, 1, 180]), np.radians([1, 359, 0]))
    np.testing.assert_allclose(np.degrees(error), [2, 2, 180])


def heading(values, t=None):
    return lf.Heading(np.arange(len(values)) if t is None else np.array(t), np.radians(values))


def test_heading_score():
    valid = np.array([1, 1, 0, 1])
    status = lf.HeadingStatus(np.arange(4), np.ones(4), np.ones(4), valid, valid, valid)
    out = run_node(
        ScoreHeading, None, estimate=heading([359.0, 3, 30, 0]), truth=heading([1.0, 0, 0, 1]),
        status=status,
    )["out"]  # fmt: skip
    assert np.degrees(out.max[0]) == pytest.approx(30)
    assert np.degrees(out.valid_max[0]) == pytest.approx(3)
    assert np.degrees(out.rmse[0]) == pytest.approx(np.sqrt((4 + 9 + 900 + 1) / 4))
    assert np.degrees(out.last[0]) == pytest.approx(1)
    assert out.valid[0] == 0.75
    assert out.samples[0] == 4


def test_a_missing_heading_is_no_good_heading():
    out = run_node(ScoreHeading, None, estimate=heading([1.0], [1]), truth=heading([1.0, 1, 1]))[
        "out"
    ]
    assert out.missing[0] == 2
    assert np.isnan(out.rmse[0])
    settled = run_node(
        ScoreHeading, {"settle": 1e-9}, estimate=heading([1.0, 1], [1, 2]), truth=heading([1.0] * 3)
    )["out"]
    assert settled.missing[0] == 0
    assert settled.rmse[0] == pytest.approx(0, abs=1e-12)


def test_the_heading_of_one_compass_is_scored_alone():
    n = 3
    two = np.column_stack([np.radians([0.0, 11, 0]), np.zeros(n)])
    features = lf.CompassFeatures(
        np.arange(n), two.mean(axis=1), two, np.zeros(n), np.zeros(n), np.zeros((n, 2)),
        np.zeros((n, 2)), np.zeros((n, 3)), np.zeros((n, 3)),
    )  # fmt: skip
    accepted = lf.Credibility(np.arange(n), np.ones(n), np.ones(n, np.int64))
    wrong = {}
    for compass in ("both", "first", "second"):
        out = run_node(
            ScoreRecognition, {"compass": compass}, features=features, accepted=accepted,
            truth=heading([0.0] * n),
        )["out"]  # fmt: skip
        wrong[compass] = float(out.mistaken[0])
    assert wrong == {"both": pytest.approx(1 / 3), "first": pytest.approx(1 / 3), "second": 0.0}
