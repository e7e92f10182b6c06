"""The score as a node: the metric, and what silence costs."""

import logging
import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import lodeflow as lf
from lodeflow.testing import run_node
from lodeflow_plugins.scoring.attitude_score.node import ScoreAttitude

ROWS = 400
T = np.arange(ROWS, dtype=np.int64) * 10_000_000
RNG = np.random.default_rng(3)
TRUE = Rotation.from_rotvec(RNG.standard_normal((ROWS, 3)))
ERROR = Rotation.from_rotvec(0.1 * RNG.standard_normal((ROWS, 3)))
MOVING = (np.arange(ROWS) % 3 > 0).astype(np.int64)


def truth(nan=()):
    quaternion = TRUE.as_quat()
    quaternion[list(nan)] = np.nan
    return lf.AttitudeTruth(T, quaternion, MOVING)


ESTIMATE = lf.Attitude(T, (ERROR * TRUE).as_quat())


def score(estimate=ESTIMATE, reference=None, **params):
    reference = truth() if reference is None else reference
    return run_node(ScoreAttitude, params, estimate=estimate, truth=reference)["out"]


def test_it_is_the_metric_of_broad():
    nan = range(50, 60)
    out = score(reference=truth(nan))
    scored = (MOVING == 1) & ~np.isin(np.arange(ROWS), list(nan))
    e = ERROR[scored].as_quat()
    heading = 2 * np.arctan(np.abs(e[:, 2] / e[:, 3]))
    inclination = 2 * np.arccos(np.sqrt(e[:, 3] ** 2 + e[:, 2] ** 2))
    assert out.t.tolist() == [T[-1]]
    assert out.samples.tolist() == [scored.sum()]
    assert out.missing.tolist() == [0]
    for name, error in (
        ("total", ERROR[scored].magnitude()),
        ("heading", heading),
        ("inclination", inclination),
    ):
        assert getattr(out, f"{name}_rmse")[0] == pytest.approx(np.sqrt(np.mean(error**2)))
        assert getattr(out, f"{name}_max")[0] == pytest.approx(error.max())


@pytest.mark.parametrize("silent", [[0, 1, 2], [100], [398, 399], list(range(ROWS))])
def test_silence_where_it_is_scored_fails_the_run(silent, caplog):
    keep = np.setdiff1d(np.arange(ROWS), silent)
    with caplog.at_level(logging.WARNING):
        out = score(ESTIMATE[keep])
    missing = int(MOVING[silent].sum())
    assert missing > 0
    assert out.missing.tolist() == [missing]
    assert out.samples.tolist() == [MOVING.sum()]
    assert math.isnan(out.total_rmse[0])
    assert f"{missing} of {MOVING.sum()} scored samples have no estimate" in caplog.text


def test_silence_elsewhere_costs_nothing():
    whole = score()
    assert score(ESTIMATE[MOVING == 1]) == whole
    late = score(ESTIMATE[30:], settle=0.3)
    assert late.samples.tolist() == [MOVING[30:].sum()]
    assert late.missing.tolist() == [0]


def test_an_estimate_of_another_stamp_does_not_count():
    out = score(ESTIMATE.replace(t=T + 1))
    assert out.missing.tolist() == out.samples.tolist() == [MOVING.sum()]
    assert out.t.tolist() == [T[-1] + 1]


def test_nothing_to_score():
    out = score(ESTIMATE[:0], truth()[:0])
    assert len(out) == 0
    still = score(reference=truth().replace(moving=np.zeros(ROWS, np.int64)))
    assert still.samples.tolist() == [0]
    assert math.isnan(still.total_rmse[0])
