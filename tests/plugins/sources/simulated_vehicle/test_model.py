"""The simulated vehicle: consistent with itself, deterministic, and independent of blocks."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from lodeflow_plugins.calibration import chu2017
from lodeflow_plugins.fusion.tilt_compass import compass
from lodeflow_plugins.sources.simulated_vehicle import model

SECONDS = np.arange(12000) * 0.01
VEHICLE = model.Vehicle()
NOISY = model.Errors(
    gyroscope=model.SensorError(0.003, (0.01, -0.02, 0.03)),
    accelerometer=model.SensorError(0.05, (0.1, 0.0, 0.0)),
    magnetometer=model.SensorError(2e-7, (0.0, 1e-6, 0.0)),
)
MODELS = model.RawModels(
    chu2017.GYROSCOPE.inverse(), chu2017.ACCELEROMETER.inverse(), chu2017.MAGNETOMETER
)


def test_default_run_has_the_size_it_says():
    truth = model.truth(VEHICLE, SECONDS)
    tilt = np.degrees(np.abs(truth.euler[:, 1:]).max(axis=0))
    assert 24.0 < tilt[0] <= 25.0
    assert 29.0 < tilt[1] <= 30.0
    assert np.ptp(truth.euler[:, 0]) > np.radians(350.0)
    assert truth.euler[:, 0].min() >= 0.0
    assert truth.euler[:, 0].max() < 2 * np.pi
    for motion in VEHICLE.shaking:
        assert 1.2 < np.abs(motion.value(SECONDS)).max() <= 1.5
    np.testing.assert_array_equal(truth.euler[0], 0.0)
    np.testing.assert_allclose(truth.specific_force[0], [0.0, 0.0, 9.80665], atol=1e-14)


def test_heading_stays_in_one_turn_and_the_attitude_goes_on():
    spinning = model.Vehicle(heading=model.Motion(slope=-0.5))
    truth = model.truth(spinning, SECONDS)
    heading = truth.euler[:, 0]
    assert heading.min() >= 0.0
    assert heading.max() < 2 * np.pi
    assert np.sum(np.diff(heading) > 1.0) == 10  # 60 rad to the left
    turned = np.abs(np.sum(truth.quaternion[1:] * truth.quaternion[:-1], axis=1))
    assert turned.min() > 0.9999


def test_rate_is_the_derivative_of_the_attitude():
    step = 1e-4
    middle = model.truth(VEHICLE, SECONDS)
    before = Rotation.from_quat(model.truth(VEHICLE, SECONDS - step).quaternion)
    after = Rotation.from_quat(model.truth(VEHICLE, SECONDS + step).quaternion)
    rate = (before.inv() * after).as_rotvec() / (2.0 * step)  # body frame
    np.testing.assert_allclose(middle.angular_velocity, rate, atol=1e-9)
    assert np.abs(middle.angular_velocity).max() > 0.1


def test_attitude_force_and_field_belong_together():
    truth = model.truth(VEHICLE, SECONDS)
    to_earth = Rotation.from_quat(truth.quaternion)
    shaking = np.column_stack([motion.value(SECONDS) for motion in VEHICLE.shaking])
    force = to_earth.apply(truth.specific_force)
    up = np.tile([0.0, 0.0, 9.80665], (len(force), 1))
    np.testing.assert_allclose(force - shaking, up, atol=1e-13)
    field = to_earth.apply(truth.magnetic_field)
    dip = np.radians(48.0)
    expected = np.tile([0.0, 50e-6 * np.cos(dip), -50e-6 * np.sin(dip)], (len(field), 1))
    np.testing.assert_allclose(field, expected, atol=1e-19)


def test_a_compass_on_a_vehicle_that_does_not_shake_shows_its_attitude():
    still = model.Vehicle(shaking=(model.Motion(),) * 3)
    truth = model.truth(still, SECONDS[::50])
    euler, quaternion = compass.measure(truth.specific_force, truth.magnetic_field)
    error = np.abs((euler - truth.euler + np.pi) % (2 * np.pi) - np.pi)
    assert error.max() < 1e-14
    np.testing.assert_allclose(quaternion, truth.quaternion, atol=1e-14)


def test_motion_and_its_derivative():
    motion = model.Motion(0.5, -0.2, ((2.0, 0.25, np.pi / 2), (1.0, 0.5, 0.0)))
    t = np.array([0.0, 1.0, 2.0])
    np.testing.assert_allclose(motion.value(t), [2.5, 0.3, -1.9], atol=1e-14)
    np.testing.assert_allclose(
        motion.derivative(t), [-0.2 + np.pi, -0.2 - 2 * np.pi, -0.2 + np.pi], atol=1e-14
    )


def test_noise_is_white_normal_and_its_own_for_each_seed_and_stream():
    streams = [model.noise(seed, stream, 0, 20_000) for seed, stream in ((0, 0), (0, 1), (1, 0))]
    for rows in streams:
        np.testing.assert_allclose(rows.mean(axis=0), 0.0, atol=0.03)
        np.testing.assert_allclose(rows.std(axis=0), 1.0, atol=0.02)
        assert abs(np.mean(rows[1:] * rows[:-1])) < 0.02
        # Frames must not repeat each other.
        assert abs(np.mean(rows[model.FRAME :] * rows[: -model.FRAME])) < 0.02
    for i, j in ((0, 1), (0, 2), (1, 2)):
        assert abs(np.mean(streams[i] * streams[j])) < 0.02


def test_noise_of_a_row_does_not_depend_on_its_neighbours():
    whole = model.noise(7, 2, 0, 1000)
    assert model.noise(7, 2, 255, 2).tobytes() == whole[255:257].tobytes()
    assert model.noise(7, 2, 999, 1).tobytes() == whole[999:].tobytes()
    assert model.noise(7, 2, 10**12, 1).shape == (1, 3)
    assert model.noise(7, 2, 0, 0).shape == (0, 3)


def test_readings_have_the_bias_and_noise_asked_for():
    truth = model.truth(VEHICLE, SECONDS)
    readings = model.readings(truth, NOISY, 3, 0)
    for error, got, exact in (
        (NOISY.gyroscope, readings.angular_velocity, truth.angular_velocity),
        (NOISY.accelerometer, readings.specific_force, truth.specific_force),
        (NOISY.magnetometer, readings.magnetic_field, truth.magnetic_field),
    ):
        gap = (got - exact) / error.noise
        np.testing.assert_allclose(gap.mean(axis=0), np.array(error.bias) / error.noise, atol=0.04)
        np.testing.assert_allclose(gap.std(axis=0), 1.0, atol=0.03)
    clean = model.readings(truth, model.Errors(gyroscope=model.SensorError()), 3, 0)
    assert clean.angular_velocity.tobytes() == truth.angular_velocity.tobytes()


def test_counts_are_what_the_sensors_of_the_paper_would_show():
    level = model.truth(model.Vehicle(), np.zeros(1))
    counts = model.counts(
        model.Readings(level.angular_velocity, level.specific_force, level.magnetic_field),
        VEHICLE,
        MODELS,
    )
    # z down at rest, section 3.2
    assert counts.accelerometer[0].tolist() == [-36.0, 104.0, 5580.0]
    field = np.array([np.cos(np.radians(48.0)), 0.0, np.sin(np.radians(48.0))])  # FRD
    assert counts.magnetometer[0].tolist() == np.rint(chu2017.MAGNETOMETER(field)).tolist()
    frd_rate = np.degrees(level.angular_velocity * [1.0, -1.0, -1.0])
    gap = chu2017.GYROSCOPE(counts.gyroscope) - frd_rate
    assert np.abs(gap).max() < 0.07  # half an LSB, 0.0622 deg/s, and some misalignment


@settings(deadline=None)
@given(
    st.lists(st.integers(0, 300), max_size=6).map(sorted),
    st.integers(0, 2**64 - 1),
    st.integers(0, 10**9),
)
def test_any_split_into_blocks_gives_the_same_bytes(cuts, seed, start):
    def evaluated(rows):
        truth = model.truth(VEHICLE, rows * 0.01)
        readings = model.readings(truth, NOISY, seed, int(rows[0]))
        counts = model.counts(readings, VEHICLE, MODELS)
        return [
            getattr(part, name)
            for part in (truth, readings, counts)
            for name in part.__dataclass_fields__
        ]

    rows = start + np.arange(300)
    whole = evaluated(rows)
    parts = [evaluated(part) for part in np.split(rows, cuts) if len(part)]
    for i, column in enumerate(whole):
        assert np.concatenate([part[i] for part in parts]).tobytes() == column.tobytes()


@pytest.mark.parametrize("seed", [-1, 2**64])
def test_a_seed_out_of_range_is_refused(seed):
    with pytest.raises(ValueError, match=f"seed has to be in .*, got {seed}"):
        model.noise(seed, 0, 0, 1)
