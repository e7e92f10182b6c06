"""Rest detection: finds what stands still, at any noise, and breaks at gaps."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from lodeflow_plugins.calibration import rests

STEP = 10_000_000


def stamps(n):
    return np.arange(n, dtype=np.int64) * STEP


def stairs(noise, seed=0, rest=200, move=100, levels=4):
    """Levels held for `rest` rows, with ramps of `move` rows between."""
    rng = np.random.default_rng(seed)
    knots = np.repeat(np.arange(levels) * 1000.0, 2)
    at = np.cumsum([0, *[rest, move] * levels])[: len(knots)]
    level = np.interp(np.arange(levels * (rest + move)), at, knots)
    return level[:, None] * [1.0, -0.5, 0.2] + rng.normal(0.0, noise, (len(level), 3))


@settings(deadline=None, max_examples=25)
@given(st.sampled_from([0.0, 0.5, 3.0, 20.0]), st.integers(0, 1000))
def test_each_level_is_found_whatever_the_noise(noise, seed):
    values = stairs(noise, seed)
    found = rests.find(stamps(len(values)), values, 100, 1.0)
    assert len(found) == 4
    for level, rest in enumerate(found):
        begin = level * 300
        # The last level is held to the end; a ramp belongs to no rest.
        assert begin - 3 <= rest.first
        assert rest.last <= begin + 203 or level == 3
        assert rest.count >= 100
        assert np.abs(rest.mean - level * 1000.0 * np.array([1, -0.5, 0.2])).max() < 1.0 + noise


def test_a_rest_is_as_long_as_asked_for():
    values = stairs(1.0, rest=90)
    assert rests.find(stamps(len(values))[:300], values[:300], 100, 1.0) == []


def test_a_gap_ends_a_rest():
    values = np.random.default_rng(0).normal(0.0, 1.0, (600, 3))
    t = stamps(600)
    t[300:] += 10**12
    found = rests.find(t, values, 100, 1.0)
    assert [rest.first >= 300 for rest in found] == [False, True]
    assert all(rest.last <= 300 or rest.first >= 300 for rest in found)
    assert rests.pieces_of(t) == [(0, 300), (300, 600)]


def test_nothing_is_found_in_nothing():
    none = np.empty((0, 3))
    assert rests.find(stamps(0), none, 100, 1.0) == []
    assert rests.find(stamps(5), np.zeros((5, 3)), 100, 1.0) == []


def test_moving_scatter_is_the_standard_deviation_of_each_window():
    values = np.random.default_rng(1).normal(1e5, 2.0, (50, 2))
    expected = [values[k : k + 10].std(axis=0) for k in range(41)]
    np.testing.assert_allclose(rests.moving_scatter(values, 10), expected, rtol=1e-7)
