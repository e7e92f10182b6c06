"""A track against the true one."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import lodeflow as lf
from lodeflow.testing import run_node
from lodeflow_plugins.scoring.track_score import alignment
from lodeflow_plugins.scoring.track_score.node import ScoreTrack

WAY = np.array([[0.0, 0.0], [3.0, 0.0], [3.0, 4.0], [0.0, 4.0]])


def turned(way, angle, start=(0.0, 0.0)):
    c, s = np.cos(angle), np.sin(angle)
    return way @ np.array([[c, s], [-s, c]]) + start


@given(st.floats(-3.2, 3.2), st.floats(-9, 9), st.floats(-9, 9))
def test_neither_heading_nor_start_counts(angle, x, y):
    score = alignment.score(turned(WAY, angle, (x, y)), WAY)
    assert score.rms == pytest.approx(0.0, abs=1e-12)
    assert (score.distance, score.samples) == (10.0, 4)


def test_scale_and_mirror_count():
    longer = alignment.score(1.1 * WAY, WAY)
    assert longer.length == pytest.approx(11.0)
    assert longer.final == pytest.approx(0.4)
    assert longer.maximum == pytest.approx(0.5)
    assert alignment.score(WAY * [1, -1], WAY).rms > 1.0


def test_the_node():
    t = np.arange(6)
    truth = np.full((6, 3), np.nan)
    truth[:4, :2] = WAY
    track = np.zeros((5, 3))
    track[:4, :2] = 1.1 * WAY
    out = run_node(ScoreTrack, track=lf.Position(t[:5], track), truth=lf.PositionTruth(t, truth))[
        "out"
    ]
    assert out.samples[0] == 4  # the fifth has no truth
    assert out.final[0] == pytest.approx(0.4)
    assert out.final_share[0] == pytest.approx(0.04)
    blind = run_node(
        ScoreTrack,
        track=lf.Position(t[:5], track),
        truth=lf.PositionTruth(t, np.full((6, 3), np.nan)),
    )["out"]
    assert np.isnan(blind.rms[0])
    assert blind.samples[0] == 0


def test_who_goes_nowhere_has_no_share():
    still = np.zeros((3, 3))
    out = run_node(
        ScoreTrack,
        track=lf.Position(np.arange(3), still),
        truth=lf.PositionTruth(np.arange(3), still),
    )["out"]
    assert out.final[0] == 0.0
    assert np.isnan(out.final_share[0])
