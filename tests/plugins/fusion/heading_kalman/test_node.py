"""The heading stage as a node, behind the inclination stage."""

import broad_figures
import numpy as np
import pytest
import scipy.io
from pydantic import ValidationError

import lodeflow as lf
from lodeflow.testing import check_node, run_node
from lodeflow_plugins.fusion.heading_kalman.node import HeadingKalman
from lodeflow_plugins.fusion.inertial_attitude.node import InertialAttitude
from lodeflow_plugins.scoring.attitude_score import metric
from lodeflow_plugins.sources.simulated_vehicle import model

# Total, heading and inclination RMSE in degrees, with the defaults.
FIGURES = {
    "02_undisturbed_slow_rotation_B": (1.34, 1.26, 0.43),
    "18_undisturbed_fast_translation_with_breaks_B": (0.78, 0.48, 0.61),
    "25_disturbed_tapping_B": (1.66, 1.61, 0.38),
    "27_disturbed_phone_vibration_B": (6.75, 6.74, 0.37),
    "31_disturbed_stationary_magnet_D": (1.77, 1.35, 1.14),
    "34_disturbed_attached_magnet_3cm": (1.04, 0.81, 0.65),
}


def turn(a, b):
    """Rotation vector in the body frame that leads from attitude a to b."""
    x, y, z, w = (a * [-1, -1, -1, 1]).T
    p, q, r, s = b.T
    v = [
        w * p + x * s + y * r - z * q,
        w * q - x * r + y * s + z * p,
        w * r + x * q - y * p + z * s,
    ]
    real = w * s - x * p - y * q - z * r
    return 2.0 * np.sign(real)[:, None] * np.stack(v, axis=1)


def sensors(rows, vehicle=model.Vehicle):
    t = np.arange(rows, dtype=np.int64) * 10_000_000
    truth = model.truth(vehicle(), t * 1e-9)
    read = model.readings(truth, model.Errors(magnetometer=model.SensorError(2e-7)), 0, 0)
    imu = lf.Imu(t, read.angular_velocity, read.specific_force)
    return run_node(InertialAttitude, imu=imu)["attitude"], lf.MagneticField(t, read.magnetic_field)


@broad_figures.needs_data
@pytest.mark.parametrize("trial", FIGURES)
def test_broad(trial):
    data = scipy.io.loadmat(broad_figures.path_of(trial))
    rate, force, field = [
        np.ascontiguousarray(data[name], float) for name in ("imu_gyr", "imu_acc", "imu_mag")
    ]
    t = np.arange(len(rate), dtype=np.int64) * 3_500_000
    attitude = run_node(InertialAttitude, imu=lf.Imu(t, rate, force))["attitude"]
    out = run_node(HeadingKalman, attitude=attitude, mag=lf.MagneticField(t, field * 1e-6))
    truth = np.ascontiguousarray(np.roll(data["opt_quat"], -1, axis=1))
    state = metric.new_state()
    metric.accumulate(out["attitude"].quaternion, truth, data["movement"].ravel(), state)
    score = metric.score(state)
    figures = np.degrees([score.total_rmse, score.heading_rmse, score.inclination_rmse])
    np.testing.assert_allclose(figures, FIGURES[trial], atol=0.01)
    # The magnetometer of this set lags, and only one trial has a magnet on the body.
    assert 0.009 < out["state"].magnetometer_lag[-1] < 0.016
    assert out["state"].hard_iron.any() == ("attached" in trial)


def test_inclination_stays_as_it_came():
    attitude, mag = sensors(1000)
    out = run_node(HeadingKalman, attitude=attitude, mag=mag)["attitude"]
    a, b = attitude.quaternion, out.quaternion
    np.testing.assert_allclose(a[:, 0] ** 2 + a[:, 1] ** 2, b[:, 0] ** 2 + b[:, 1] ** 2, atol=1e-12)
    np.testing.assert_allclose(np.linalg.norm(b, axis=1), 1.0, atol=1e-12)


def test_the_advance_turns_the_output_forward():
    attitude, mag = sensors(2000)
    now, ahead = [
        run_node(HeadingKalman, {"output_advance": 0.01}, attitude=attitude, mag=mag)["attitude"]
        if advance
        else run_node(HeadingKalman, attitude=attitude, mag=mag)["attitude"]
        for advance in (False, True)
    ]
    # One sample ahead is, but for the change of the rate, the next sample.
    rest = turn(ahead.quaternion[1000:-1], now.quaternion[1001:])
    moved = turn(now.quaternion[1000:-1], now.quaternion[1001:])
    assert np.linalg.norm(rest, axis=1).mean() < 0.1 * np.linalg.norm(moved, axis=1).mean()


def test_fields_between_attitudes_and_before_the_first():
    attitude, mag = sensors(1200)
    early = mag.replace(t=mag.t - 2_000_000_000 + 4_000_000)
    out = run_node(HeadingKalman, attitude=attitude, mag=early)
    assert out["attitude"].t.tolist() == attitude.t.tolist()
    assert out["state"].variance[0] > 3.0


def test_reports():
    attitude, mag = sensors(1000)
    out = run_node(HeadingKalman, {"report_interval": 0.5}, attitude=attitude, mag=mag)["state"]
    assert out.t.tolist() == list(range(0, 10 * 10**9, 500_000_000))


@pytest.mark.parametrize("interval", [0.0, 0.0175, 0.05])
def test_any_split_gives_the_same_bytes(interval):
    attitude, mag = sensors(600)
    keep = np.sort(np.random.default_rng(0).choice(600, 250, replace=False))
    field = mag.magnetic_field[keep]
    field[100:140] += 2e-5
    field[150:155] = field[150]
    field[160] = 0.0
    mag = lf.MagneticField(mag.t[keep] + 3_000_000 * (keep % 3), field)
    params = {"update_interval": interval, "start_duration": 0.5, "report_interval": 0.04}
    check_node(HeadingKalman, params, inputs={"attitude": attitude, "mag": mag})


def test_expected_norm_and_dip_belong_together():
    with pytest.raises(ValidationError, match="belong together"):
        HeadingKalman.Params(expected_norm="50 uT")
    given = HeadingKalman.Params(expected_norm="50 uT", expected_dip="60 deg").constants()
    np.testing.assert_allclose(given[14:16], [25e-6, -50e-6 * np.sqrt(0.75)])
