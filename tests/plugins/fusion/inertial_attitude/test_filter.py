"""The inertial attitude filter against the authors' package and against truth."""

import broad_figures
import numpy as np
import pytest
import scipy.io
import vqf

import lodeflow as lf
from lodeflow.testing import check_node, run_node
from lodeflow_plugins.fusion.inertial_attitude.node import InertialAttitude
from lodeflow_plugins.sources.simulated_vehicle import model

DEGREE = np.pi / 180.0
EVERY_SAMPLE = {"report_interval": 0}
STILL = (model.Motion(),) * 3
ROUGH = model.Vehicle()


def estimates(t, rate, force, **params):
    return run_node(InertialAttitude, {**EVERY_SAMPLE, **params}, imu=lf.Imu(t, rate, force))


def simulated(seconds, hertz=100, bias=(0.0, 0.0, 0.0), vehicle=ROUGH, seed=0):
    """Stamps, rate with noise and a bias, force with noise, and the true state."""
    t = np.arange(int(seconds * hertz), dtype=np.int64) * round(1e9 / hertz)
    errors = model.Errors(
        gyroscope=model.SensorError(0.1 * DEGREE, bias), accelerometer=model.SensorError(0.02)
    )
    truth = model.truth(vehicle, t * 1e-9)
    read = model.readings(truth, errors, seed, 0)
    return t, read.angular_velocity, read.specific_force, truth


def inclination_error(quaternion, truth):
    """Angle between the two verticals, in the body frame; degrees."""

    def vertical(q):
        x, y, z, w = q.T
        return np.stack([2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)], 1)

    gap = np.linalg.norm(vertical(quaternion) - vertical(truth.quaternion), axis=1)
    return np.degrees(2.0 * np.arcsin(0.5 * gap))


def rest_at_each(t, rest):
    """The rest flag of every stamp."""
    return rest.rest[np.searchsorted(rest.t, t, side="right") - 1]


def compare(t, rate, force, interval):
    """Our estimates are the package's from the second sample on."""
    theirs = vqf.VQF(interval).updateBatch(rate, force)
    ours = estimates(t, rate, force)
    expected = np.roll(theirs["quat6D"], -1, axis=1)
    found = ours["attitude"].quaternion
    expected *= np.sign(np.sum(expected * found, axis=1))[:, None]
    angle = 2.0 * np.linalg.norm(expected - found, axis=1)
    assert angle[1:].max() < 1e-10
    # The first sample of theirs has turned for one interval; nothing tells us which.
    assert angle[0] < 1.1 * interval * np.linalg.norm(rate[0])
    np.testing.assert_allclose(ours["bias"].bias[1:], theirs["bias"][1:], atol=1e-12)
    assert rest_at_each(t, ours["rest"]).tolist() == theirs["restDetected"].tolist()
    assert 0.0 < theirs["restDetected"].mean() < 1.0


@broad_figures.needs_data
@pytest.mark.parametrize("trial", broad_figures.FIGURES)
def test_agrees_with_the_package_on_broad(trial):
    data = scipy.io.loadmat(broad_figures.path_of(trial))
    rate, force = [np.ascontiguousarray(data[name]) for name in ("imu_gyr", "imu_acc")]
    t = np.arange(len(rate), dtype=np.int64) * 3_500_000  # 2000/7 Hz
    compare(t, rate, force, 0.0035)


def test_agrees_with_the_package_on_a_vehicle_that_stops():
    t, rate, force, _ = simulated(40, bias=(0.01, -0.02, 0.005))
    still = slice(1500, 2500)
    rate[still] = (0.01, -0.02, 0.005)
    force[still] = force[1499]
    compare(t, rate, force, 0.01)


def test_bias_is_found_in_motion_and_the_covariance_says_how_well():
    # Tumbling turns each axis out of the vertical.
    vehicle = model.Vehicle(
        pitch=model.Motion(sines=((1.2, 0.11, 0.0),)), roll=model.Motion(slope=0.7), shaking=STILL
    )
    bias = np.array([0.4, -0.3, 0.2]) * DEGREE
    t, rate, force, truth = simulated(120, bias=tuple(bias), vehicle=vehicle)
    out = estimates(t, rate, force, rest_rate=0)
    assert len(out["rest"]) == 1
    sigma = np.sqrt(np.diagonal(out["bias"].covariance, axis1=1, axis2=2)) / DEGREE
    assert sigma[0] == pytest.approx([0.5, 0.5, 0.5])
    assert (sigma[-1] < 0.25).all()
    assert (np.abs(out["bias"].bias[-1] - bias) < sigma[-1] * DEGREE).all()
    assert inclination_error(out["attitude"].quaternion, truth)[4000:].max() < 0.5


def test_bias_is_found_at_rest_on_all_axes():
    bias = np.array([0.4, -0.3, 1.2]) * DEGREE
    level = model.Vehicle(model.Motion(), model.Motion(), model.Motion(), STILL)
    t, rate, force, _ = simulated(20, bias=tuple(bias), vehicle=level)
    out = estimates(t, rate, force)
    assert out["rest"].rest.tolist() == [lf.Rest.MOVING, lf.Rest.RESTING]
    # VQF's low-passes settle for half a second, then 1.5 s must pass.
    assert 1.4 < out["rest"].t[1] * 1e-9 < 2.5
    assert np.abs(out["bias"].bias[-1] - bias).max() < 0.02 * DEGREE


def test_uneven_stamps_and_lost_samples_are_turned_for_as_long_as_they_lasted():
    vehicle = model.Vehicle(heading=model.Motion(slope=0.6), shaking=STILL)
    t, rate, force, truth = simulated(60, hertz=200, vehicle=vehicle)
    keep = np.sort(np.random.default_rng(0).choice(len(t), len(t) // 3, replace=False))
    out = estimates(t[keep], rate[keep], force[keep])
    truth = model.truth(vehicle, t[keep] * 1e-9)
    assert inclination_error(out["attitude"].quaternion, truth)[500:].max() < 0.5
    turned, expected = [
        np.unwrap(2.0 * np.arctan2(q[:, 2], q[:, 3]))
        for q in (out["attitude"].quaternion, truth.quaternion)
    ]
    drift = np.degrees(turned - expected)
    assert np.abs(drift - drift[500])[500:].max() < 5.0


def test_a_gap_of_seconds_is_survived():
    t, rate, force, _ = simulated(60)
    keep = np.r_[0:2000, 2900:6000]
    out = estimates(t[keep], rate[keep], force[keep])
    error = inclination_error(out["attitude"].quaternion, model.truth(ROUGH, t[keep] * 1e-9))
    assert error[300:2000].max() < 2.0
    assert error[2000 + 300 :].max() < 2.0
    assert np.abs(out["bias"].bias).max() < 0.2 * DEGREE


def test_without_force_it_is_the_gyroscope_alone():
    t, rate, force, _ = simulated(2)
    out = estimates(t, rate, np.zeros_like(force), bias_motion=0)
    assert out["attitude"].quaternion[0].tolist() == [0.0, 0.0, 0.0, 1.0]
    assert np.isfinite(out["attitude"].quaternion).all()
    assert not out["bias"].bias.any()


def test_the_bias_is_reported_at_its_interval():
    t, rate, force, _ = simulated(2)
    out = run_node(InertialAttitude, {"report_interval": 0.25}, imu=lf.Imu(t, rate, force))
    assert out["bias"].t.tolist() == list(range(0, 2 * 10**9, 250_000_000))
    assert out["attitude"].t.tolist() == t.tolist()


def test_any_split_gives_the_same_bytes_on_real_motion():
    t, rate, force, _ = simulated(4)
    rate[100:300], force[100:300] = 0.0, (0.0, 0.0, 9.8)
    force[350:360] = 0.0
    t[200:] += 123_456
    check_node(InertialAttitude, {"report_interval": 0.03}, inputs={"imu": lf.Imu(t, rate, force)})
