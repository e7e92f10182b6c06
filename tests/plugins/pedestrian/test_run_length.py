"""Runs of still samples."""

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lodeflow_plugins.pedestrian.zero_velocity import run_length

STILL, MOVING = 1.0, 9.0


def count(still, *, shortest=5, closes=0, settle=0, cuts=()):
    """Rows and first samples of the runs."""
    value = np.where(np.array(still, bool), STILL, MOVING)
    t = np.arange(len(value))
    state = run_length.new_state()
    found = []
    for a, b in zip([0, *cuts], [*cuts, len(value)], strict=True):
        row, moment = np.empty(b - a, np.int64), np.empty(b - a, np.int64)
        n = run_length.count(
            t[a:b], value[a:b], -np.inf, 2.5, shortest, closes, settle, state, row, moment
        )
        found += zip((row[:n] + a).tolist(), moment[:n].tolist(), strict=True)
    assert state[run_length.RUNS] == len(found)
    return found


def by_definition(still, shortest, closes, settle):
    """Close the gaps, then look at whole runs: the first samples of those that count."""
    still = list(map(bool, still))
    at = [k for k, s in enumerate(still) if s]
    for a, b in itertools.pairwise(at):
        if 0 < b - a - 1 < closes:
            still[a:b] = [True] * (b - a)
    edges = np.flatnonzero(np.diff([0, *still, 0]))
    runs = edges.reshape(-1, 2)
    return [int(a) for a, b in runs if b - a >= shortest and a >= settle]


def test_a_run_of_four_is_dropped_and_one_of_five_is_kept():
    assert count([0, 1, 1, 1, 1, 0]) == []
    assert count([0, 1, 1, 1, 1, 1, 0]) == [(5, 1)]
    assert count([0, *[1] * 50, 0]) == [(5, 1)]


@pytest.mark.parametrize(("rate", "samples"), [(50, 5), (200, 20), (100, 10), (47, 5), (99.4, 10)])
def test_a_tenth_of_a_second(rate, samples):
    assert run_length.samples_of(0.1, rate) == samples


def test_a_short_gap_may_be_closed():
    steps = [0, 1, 1, 1, 0, 0, 1, 1, 1, 0]
    assert count(steps) == []
    assert count(steps, closes=3) == [(6, 1)]  # known at its fifth sample, and one stance
    assert count(steps, closes=2) == []


def test_who_stands_at_the_beginning_does_not_step():
    still = [1] * 10 + [0] * 5 + [1] * 10
    assert len(count(still)) == 2
    assert count(still, settle=3) == [(19, 15)]


@settings(deadline=None)  # the first example compiles
@given(
    st.lists(st.booleans(), max_size=60),
    st.integers(1, 6),
    st.integers(0, 5),
    st.integers(0, 20),
    st.lists(st.integers(0, 60), max_size=4),
)
def test_as_it_goes_is_as_over_the_whole(still, shortest, closes, settle, cuts):
    cuts = sorted(min(cut, len(still)) for cut in cuts)
    found = count(still, shortest=shortest, closes=closes, settle=settle, cuts=cuts)
    assert [moment for _, moment in found] == by_definition(still, shortest, closes, settle)
    assert all(row - moment >= shortest - 1 for row, moment in found)
