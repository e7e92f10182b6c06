"""The heading estimator: its algebra, its behaviour, and that it does not lock itself out."""

import numpy as np
import pytest

from lodeflow_plugins.interference.heading_estimator import filter as estimator
from lodeflow_plugins.interference.heading_estimator import linear, model
from lodeflow_plugins.sources.vehicle_in_city.model import MISMATCH, City, World

DEG = np.radians(1.0)


def wrap(angle):
    return (angle + np.pi) % (2 * np.pi) - np.pi


def estimate(rows, every=1, **assumed):
    """Error, sigma and the other columns of the estimator on a drive, deg and deg first."""
    n = len(rows.seconds)
    t = np.rint(rows.seconds * 1e9).astype(np.int64)
    row = np.arange(n)
    compass_row = np.where(row % every == 0, row, -1)
    out = np.empty((n, 5))
    first, second = (np.ascontiguousarray(rows.fields[:, i]) for i in range(2))
    begins = estimator.run(
        t, rows.rate, row, first, second, compass_row,
        model.Assumptions(**assumed).constants(), model.new_state(), out,
    )  # fmt: skip
    assert begins == 0
    return wrap(out[:, 0] - rows.heading) / DEG, out[:, 1] / DEG, out


def drive(seed, duration=300.0, rate=20.0, **city):
    return World(City(**city), seed, duration, rate).rows()


def rms(error):
    return np.sqrt(np.mean(error**2))


def test_gain_is_that_of_a_kalman_filter():
    rng = np.random.default_rng(0)
    root = rng.standard_normal((8, 8))
    P = root @ root.T
    h = rng.standard_normal(8)
    expected_k = P @ h / (h @ P @ h + 0.7)
    expected_P = P - np.outer(expected_k, h @ P)
    k = np.empty(8)
    assert linear.variance(P, h) == pytest.approx(h @ P @ h)
    linear.gain(P, h, 0.7, k)
    np.testing.assert_allclose(k, expected_k)
    np.testing.assert_allclose(P, expected_P, atol=1e-12)


def test_the_measurement_rows_are_the_derivatives_of_the_residuals():
    """By finite differences: small calibration errors move the smoothed residuals as h says."""
    heading = 0.7
    cos, sin = np.cos(heading), np.sin(heading)
    field = np.array([cos, -sin, np.tan(model.Assumptions().dip)])
    small = 1e-6
    across = [-sin, -cos, -sin * cos, sin * cos, sin**2 - cos**2]
    along = [cos, -sin, cos**2, sin**2, -2 * sin * cos]
    moved = [
        np.array([1.0, 0, 0]), np.array([0, 1.0, 0]), np.array([cos, 0, 0]),
        np.array([0, -sin, 0]), np.array([-sin, cos, 0]),
    ]  # fmt: skip
    for i, change in enumerate(moved):
        disturbed = field + small * change
        angle = np.arctan2(-disturbed[1], disturbed[0]) - heading
        strength = np.hypot(disturbed[0], disturbed[1]) - 1
        assert angle / small == pytest.approx(across[i], abs=1e-5)
        assert strength / small == pytest.approx(along[i], abs=1e-5)
    state = model.new_state()
    c = model.Assumptions().constants()
    estimator.begin(field, field, c, state)
    estimator.correct(field, field, 0.05, c, state)
    np.testing.assert_allclose(state.h[0, 2:7], across, atol=1e-12)
    np.testing.assert_allclose(state.h[1, 2:7], along, atol=1e-12)


def test_any_split_gives_the_same_bits():
    rows = drive(7, duration=60)
    whole = estimate(rows)[2]
    n = len(rows.seconds)
    t = np.rint(rows.seconds * 1e9).astype(np.int64)
    first, second = (np.ascontiguousarray(rows.fields[:, i]) for i in range(2))
    state, c = model.new_state(), model.Assumptions().constants()
    out = np.empty((n, 5))
    for begin, end in zip([0, 1, 2, 700], [1, 2, 700, n], strict=True):
        part = slice(begin, end)
        row = np.arange(end - begin)
        estimator.run(
            t[part], rows.rate[part], row, first[part], second[part], row, c, state, out[part]
        )
    assert out.tobytes() == whole.tobytes()


def test_undisturbed_it_is_better_than_the_compass_and_valid():
    rows = drive(1, near=0.0)
    error, sigma, out = estimate(rows)
    assert rms(error) < 0.2
    assert np.mean(sigma < 3.0) > 0.98  # all but the first seconds
    assert np.mean(out[:, 2] < 1.5 * DEG) > 0.99


@pytest.mark.parametrize("vertical", [1.0, 0.0])
@pytest.mark.parametrize("city", [{}, {"near": 0.0, "far": 1.0}], ids=["near", "far"])
def test_disturbed_it_stays_within_a_degree_or_so(city, vertical):
    for seed in range(100, 104):
        rows = drive(seed, **city)
        error, sigma, _ = estimate(rows, vertical=vertical)
        compass = np.arctan2(-rows.fields[..., 1], rows.fields[..., 0])
        middle = compass[:, 0] - wrap(compass[:, 0] - compass[:, 1]) / 2
        settled = rows.seconds > 30
        assert rms(error[settled]) < 1.0
        assert rms(error[settled]) < 0.3 * rms(wrap(middle - rows.heading)[settled] / DEG)
        assert np.abs(error[sigma < 3.0]).max() < 10.0


def test_it_learns_a_gyro_bias():
    rows = drive(3, near=0.0, fixed_bias=0.5 * DEG, gyro_bias=0.0)
    error, _, _ = estimate(rows)
    assert np.abs(error[rows.seconds > 60]).max() < 1.0


def test_a_field_that_is_clean_wins_against_a_wrong_heading():
    """No lock-out: whatever the heading is, some minutes of clean field bring it back."""
    rows = drive(5, duration=500, near=0.0)
    turned = rows.rate.copy()
    turned[1000:1040] += np.radians(60.0)  # the gyro goes mad for 2 s, 120 degrees in all
    error, sigma, _ = estimate(type(rows)(rows.seconds, rows.heading, turned, rows.fields, None))
    assert np.abs(error[1040]) > 60
    assert np.abs(error[-1]) < 1.0
    assert sigma[1100] > 3.0  # and it does not call itself valid meanwhile
    assert sigma[-1] < 3.0


def test_a_long_disturbance_does_not_pass_for_a_heading():
    for seed in (100, 101, 103, 107):
        for carried in (False, True):
            rows = drive(seed, duration=600, near=0.0, far=1.0, long=300.0, carried=carried)
            error, sigma, _ = estimate(rows, vertical=0.0)
            assert np.abs(error[sigma < 3.0]).max() < 10.0
            assert np.abs(error[-1]) < 1.0


def test_a_hard_iron_step_is_learned():
    rows = drive(104, duration=600, step=0.02)
    error, _, _ = estimate(rows)
    assert rms(error) < 1.5


def test_sensors_that_are_not_as_assumed():
    rows = drive(102, **MISMATCH)
    error, sigma, _ = estimate(rows)
    assert rms(error[rows.seconds > 30]) < 1.5
    assert np.abs(error[sigma < 3.0]).max() < 10.0


def test_a_slower_compass_gives_nearly_the_same():
    rows = drive(101, rate=100.0, duration=120)
    errors = [rms(estimate(rows, every=n)[0][1000:]) for n in (1, 2, 5, 10)]
    assert max(errors) < 0.5
    assert max(errors) < 1.2 * min(errors)


def test_a_gap_in_the_rate_is_not_passed_over():
    rows = drive(3, duration=60, near=0.0)
    keep = (rows.seconds < 20) | (rows.seconds > 40)
    cut = type(rows)(*(getattr(rows, name)[keep] for name in rows.__dataclass_fields__))
    error, _, _ = estimate(cut)
    assert np.abs(cut.heading[399] - cut.heading[401]) > 1.0  # it has turned meanwhile
    assert np.abs(error[401:]).max() < 2.0  # and the compass is believed at once
