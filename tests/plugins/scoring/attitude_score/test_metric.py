"""The attitude score against its definition and against known rotations."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from lodeflow_plugins.scoring.attitude_score import metric


def as_defined(estimate, truth):
    """The formulas of the benchmark, on scalar-last quaternions."""
    e = (Rotation.from_quat(estimate) * Rotation.from_quat(truth).inv()).as_quat()
    z, w = e[:, 2], e[:, 3]
    return np.column_stack(
        [
            2.0 * np.arccos(np.minimum(np.abs(w), 1.0)),
            2.0 * np.arctan(np.abs(z / w)),
            2.0 * np.arccos(np.minimum(np.sqrt(w**2 + z**2), 1.0)),
        ]
    )


def accumulated(estimate, truth, movement):
    state = metric.new_state()
    metric.accumulate(estimate, truth, movement, state)
    return state


def random_pair(n, seed=0):
    rng = np.random.default_rng(seed)
    return Rotation.random(n, rng=rng).as_quat(), Rotation.random(n, rng=rng).as_quat()


def test_errors_are_as_defined():
    estimate, truth = random_pair(1000)
    expected = as_defined(estimate, truth)
    np.testing.assert_allclose(metric.errors(estimate, truth), expected, atol=1e-7)


def test_a_turn_about_the_vertical_is_heading_and_a_lean_is_inclination():
    truth = Rotation.random(50, rng=np.random.default_rng(1))
    turn = Rotation.from_rotvec([0.0, 0.0, np.radians(-7.0)])
    lean = Rotation.from_rotvec(np.radians(4.0) * np.array([0.6, -0.8, 0.0]))
    turned = metric.errors((turn * truth).as_quat(), truth.as_quat())
    leaned = metric.errors((lean * truth).as_quat(), truth.as_quat())
    np.testing.assert_allclose(np.degrees(turned), np.tile([7.0, 7.0, 0.0], (50, 1)), atol=1e-12)
    np.testing.assert_allclose(np.degrees(leaned), np.tile([4.0, 0.0, 4.0], (50, 1)), atol=1e-12)


def test_no_error_is_no_error_and_the_sign_does_not_matter():
    estimate, truth = random_pair(100)
    assert metric.errors(truth, -truth).max() < 1e-15
    flipped = metric.errors(-estimate, truth)
    assert flipped.tobytes() == metric.errors(estimate, truth).tobytes()


def test_score_is_rms_and_maximum_over_the_rows_that_count():
    estimate, truth = random_pair(300)
    movement = (np.arange(300) % 3 > 0).astype(np.uint8)
    truth[10:20] = np.nan
    estimate[0] = np.nan  # not in motion
    estimate[11] = np.nan  # in motion, but no truth to compare with
    counts = (movement == 1) & ~np.isnan(truth).any(axis=1)
    score = metric.score(accumulated(estimate, truth, movement))
    expected = as_defined(estimate[counts], truth[counts])
    assert (score.rows, score.missing) == (counts.sum(), 0)
    rmse = np.sqrt(np.mean(expected**2, axis=0))
    got = [score.total_rmse, score.heading_rmse, score.inclination_rmse]
    np.testing.assert_allclose(got, rmse, rtol=1e-9)
    got = [score.total_max, score.heading_max, score.inclination_max]
    np.testing.assert_allclose(got, expected.max(axis=0), rtol=1e-9)


@pytest.mark.parametrize("component", range(4))
def test_a_nan_in_an_estimate_fails_the_run(component):
    estimate, truth = random_pair(20)
    estimate[4, component] = np.nan
    score = metric.score(accumulated(estimate, truth, np.ones(20, np.uint8)))
    assert (score.rows, score.missing) == (20, 1)
    assert np.isnan([score.total_rmse, score.heading_max, score.inclination_rmse]).all()


def test_a_run_without_rows_has_no_figures():
    estimate, truth = random_pair(5)
    score = metric.score(accumulated(estimate, truth, np.zeros(5, np.uint8)))
    assert score.rows == 0
    assert np.isnan(score.total_rmse)


@settings(deadline=None)
@given(st.lists(st.integers(0, 80), max_size=6).map(sorted), st.integers(0, 999))
def test_any_split_into_blocks_gives_the_same_bytes(cuts, seed):
    estimate, truth = random_pair(80, seed)
    rng = np.random.default_rng(seed)
    truth[rng.random(80) < 0.1] = np.nan
    movement = rng.integers(0, 2, 80).astype(np.uint8)
    state = metric.new_state()
    for part in np.split(np.arange(80), cuts):
        metric.accumulate(estimate[part], truth[part], movement[part], state)
    assert state.tobytes() == accumulated(estimate, truth, movement).tobytes()
    assert state[metric.ROWS] > 0
    pieces = [metric.errors(estimate[part], truth[part]) for part in np.split(np.arange(80), cuts)]
    whole = metric.errors(estimate, truth)
    assert np.concatenate(pieces).tobytes() == whole.tobytes()
