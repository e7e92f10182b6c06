"""Calibration fits: exact on exact data, as good as they should be on noisy data."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from lodeflow_plugins.calibration import chu2017, least_squares
from lodeflow_plugins.fusion.tilt_compass import compass

DIP = np.radians(48.0)


def fields(euler_degrees):
    attitudes = Rotation.from_euler("ZYX", euler_degrees, degrees=True)
    return attitudes.inv().apply([np.cos(DIP), 0.0, np.sin(DIP)])


def platform():
    return fields([[h, p, r] for h in range(0, 360, 60) for p in (-50, 0, 50) for r in (-40, 40)])


def turntable():
    """Three axes at six rates, as in the paper."""
    return np.vstack([np.outer([30, 60, 90, -30, -60, -90], axis) for axis in np.eye(3)])


def test_magnetometer_separates_the_errors_exactly():
    field = platform()
    fit = least_squares.magnetometer(chu2017.MAGNETOMETER(field), field)
    # Row y of Table 1 is a unit vector to the digits printed, which is 6e-9.
    norms = np.linalg.norm(chu2017.MAGNETOMETER_MISALIGNMENT, axis=1)
    np.testing.assert_allclose(
        fit.sensitivity, chu2017.MAGNETOMETER_SENSITIVITY * norms, rtol=1e-13
    )
    np.testing.assert_allclose(
        fit.misalignment, chu2017.MAGNETOMETER_MISALIGNMENT / norms[:, None], atol=1e-13
    )
    np.testing.assert_allclose(fit.bias, chu2017.MAGNETOMETER_BIAS, atol=1e-11)
    assert fit.residual_rms.max() < 1e-11
    np.testing.assert_allclose(fit.model(field), chu2017.MAGNETOMETER(field), atol=1e-10)


def test_magnetometer_residual_is_the_noise():
    field = np.repeat(platform(), 20, axis=0)
    noise = np.random.default_rng(2).normal(0.0, [1.0, 2.0, 4.0], field.shape)
    fit = least_squares.magnetometer(chu2017.MAGNETOMETER(field) + noise, field)
    np.testing.assert_allclose(fit.residual_rms, [1.0, 2.0, 4.0], rtol=0.1)


def test_six_positions_give_table_3():
    raw = chu2017.ACCELEROMETER.inverse()(chu2017.SIX_POSITIONS)
    design = np.column_stack([raw, np.ones(6)])
    assert np.linalg.cond(design) == pytest.approx(3294, abs=0.5)  # as Eqs. 13-15 have it
    fit = least_squares.accelerometer(raw, chu2017.SIX_POSITIONS)
    assert fit.condition < 1.1
    np.testing.assert_allclose(fit.gain, chu2017.ACCELEROMETER_GAIN, atol=1e-18)
    np.testing.assert_allclose(fit.offset, chu2017.ACCELEROMETER_OFFSET, atol=1e-16)


def test_six_noisy_positions():
    exact = chu2017.ACCELEROMETER.inverse()(chu2017.SIX_POSITIONS)
    tilt = []
    for seed in range(20):
        rng = np.random.default_rng(seed)
        raw = (exact[:, None] + rng.normal(0.0, 10.0, (6, 100, 3))).mean(axis=1)
        fit = least_squares.accelerometer(raw, chu2017.SIX_POSITIONS)
        assert np.abs(fit.gain - chu2017.ACCELEROMETER_GAIN).max() <= 8.5e-8
        assert np.abs(fit.offset - chu2017.ACCELEROMETER_OFFSET).max() <= 3e-4
        attitude = rng.uniform([0, -60, -60], [360, 60, 60], (200, 3))
        up = Rotation.from_euler("ZYX", attitude, degrees=True).inv().apply([0.0, 0.0, -1.0])
        force = fit.model(chu2017.ACCELEROMETER.inverse()(compass.swap_body(up)))
        angles, _ = compass.measure(force, force)
        tilt.append(np.abs(np.degrees(angles[:, 1:]) - attitude[:, 1:]))
    assert np.mean(tilt) == pytest.approx(0.008, abs=0.001)
    assert np.max(tilt) <= 0.046


def test_eighteen_rates_give_eq_17():
    rate = turntable()
    fit = least_squares.gyroscope(chu2017.GYROSCOPE.inverse()(rate), rate)
    assert len(rate) == 18
    np.testing.assert_allclose(fit.k, chu2017.GYROSCOPE_K, atol=2e-15)
    assert fit.residual_rms.max() < 1e-13
    np.testing.assert_allclose(fit.model.matrix, chu2017.GYROSCOPE.matrix, atol=1e-15)


def test_four_rows_are_enough():
    field = platform()[[0, 9, 17, 30]]
    fit = least_squares.magnetometer(chu2017.MAGNETOMETER(field), field)
    np.testing.assert_allclose(fit.bias, chu2017.MAGNETOMETER_BIAS, atol=1e-9)


BAD = np.array([[np.nan, 0.0, 0.0]])


@pytest.mark.parametrize(
    ("raw", "rate", "message"),
    [
        (np.eye(3), np.eye(3), "at least 4 rows"),
        (np.zeros((5, 3)), np.zeros((4, 3)), "same number of rows, got 5 and 4"),
        (np.zeros((5, 2)), np.zeros((5, 3)), r"raw has to have the shape \(N, 3\), got \(5, 2\)"),
        (np.zeros(3), np.zeros((5, 3)), r"raw has to have the shape \(N, 3\), got \(3,\)"),
        (np.vstack([np.eye(3), BAD]), np.zeros((4, 3)), "raw has to be finite, row 3 is not"),
        (np.vstack([np.eye(3), [[1, 1, 1]]]), BAD.repeat(4, 0), "rate has to be finite, row 0"),
        (np.zeros((6, 3)), np.zeros((6, 3)), "raw varies .* more attitudes or axes"),
    ],
)
def test_bad_data_is_refused_in_one_sentence(raw, rate, message):
    with pytest.raises(ValueError, match=message) as caught:
        least_squares.gyroscope(raw, rate)
    assert "\n" not in str(caught.value)


def test_level_turns_alone_cannot_calibrate_a_magnetometer():
    field = fields([[heading, 0, 0] for heading in range(0, 360, 10)])
    with pytest.raises(ValueError, match="field varies"):
        least_squares.magnetometer(chu2017.MAGNETOMETER(field), field)


def test_noise_does_not_pass_for_an_axis_that_was_not_turned():
    raw = chu2017.ACCELEROMETER.inverse()(chu2017.SIX_POSITIONS[:4])
    raw += np.random.default_rng(0).normal(0.0, 1.0, raw.shape)
    with pytest.raises(ValueError, match="raw varies"):
        least_squares.accelerometer(raw, chu2017.SIX_POSITIONS[:4])


def test_a_dead_sensor_axis_is_named():
    field = platform()
    raw = chu2017.MAGNETOMETER(field) * [1.0, 0.0, 1.0]
    with pytest.raises(ValueError, match="does not depend on field"):
        least_squares.magnetometer(raw, field)
