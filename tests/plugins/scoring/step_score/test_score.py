"""Counted steps against the true ones."""

import numpy as np
import pytest

import lodeflow as lf
from lodeflow.testing import run_node
from lodeflow_plugins.scoring.step_score.node import ScoreSteps

SECOND = 10**9
STANCES = np.array([1, 2, 4, 6]) * SECOND
TRUTH = lf.StepTruth(STANCES, np.arange(4))


def score(moments, times=None, truth=TRUTH, **params):
    moments = (np.array(moments, float) * SECOND).astype(np.int64)
    times = np.ones(len(moments), np.int64) if times is None else np.array(times)
    steps = lf.Step(moments + 50, np.cumsum(times), moments)
    out = run_node(ScoreSteps, params, steps=steps, truth=truth)["out"]
    return [int(getattr(out, name)[0]) for name in ("counted", "true", "error", "missed", "extra")]


@pytest.mark.parametrize(
    ("moments", "expected"),
    [
        ([1.5, 3.0, 5.0], [3, 3, 0, 0, 0]),
        ([2.0, 4.0, 6.0], [3, 3, 0, 0, 0]),  # the stance itself ends the step
        ([1.5, 1.7, 5.0], [3, 3, 0, 1, 1]),  # the right number for the wrong reason
        ([1.5], [1, 3, 2, 2, 0]),
        ([0.5, 1.5, 3.0, 5.0, 7.0], [5, 3, 2, 0, 2]),
        ([], [0, 3, 3, 3, 0]),
    ],
)
def test_steps_are_matched_one_by_one(moments, expected):
    assert score(moments) == expected


def test_a_message_may_stand_for_several_steps():
    assert score([1.5, 5.0], times=[1, 2]) == [3, 3, 0, 1, 1]


def test_a_truth_that_is_a_number_alone():
    total = lf.StepTruth(np.array([0, 9 * SECOND]), np.array([0, 3]))
    assert score([1, 2, 8], truth=total) == [3, 3, 0, 0, 0]
    assert score([1, 2], truth=total) == [2, 3, 1, 1, 0]
    nothing = lf.StepTruth.empty()
    assert score([1, 2], truth=nothing) == [2, 0, 2, 0, 2]


def test_both_feet():
    assert score([1.5, 3.0, 5.0], times=[2, 2, 2], steps_per_stance=2) == [6, 6, 0, 0, 0]


def test_silence_has_no_score():
    out = run_node(ScoreSteps, steps=lf.Step.empty(), truth=lf.StepTruth.empty())
    assert len(out["out"]) == 0
