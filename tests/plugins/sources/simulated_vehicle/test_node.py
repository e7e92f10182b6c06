"""The simulated vehicle as a source."""

import numpy as np
import pytest
from pydantic import ValidationError

from lodeflow.clock import SimClock
from lodeflow_plugins.calibration import chu2017
from lodeflow_plugins.sources.simulated_vehicle.node import SimulatedVehicle


def read(start=0, **params):
    source = SimulatedVehicle(SimulatedVehicle.Params(**params))
    source.start()
    parts = list(source.read(SimClock(start)))
    return {
        name: type(block).concat([getattr(part, name) for part in parts])
        for name, block in parts[0]._asdict().items()
    }


def as_bytes(block):
    return [column.tobytes() for column in (block.t, *block.values())]


@pytest.mark.parametrize("rows", [1, 7, 999, 100_000])
def test_bytes_do_not_depend_on_the_block_size(rows, monkeypatch):
    noise = {"accel_noise": 0.05, "mag_noise": "0.1 uT", "seed": 5, "duration": 13, "rate": 285.7}
    whole = read(**noise)
    monkeypatch.setattr(SimulatedVehicle, "rows", rows)
    again = read(**noise)
    for port, block in whole.items():
        assert as_bytes(again[port]) == as_bytes(block), port


def test_length_rate_and_start():
    ports = read(start=10**18, duration=2.5, rate=40)
    for block in ports.values():
        assert (block.t - 10**18).tolist() == list(range(0, 2_500_000_000, 25_000_000))


def test_stamps_increase_at_the_highest_rate():
    t = read(rate="100 kHz", duration=0.01)["imu"].t
    assert t.tolist() == list(range(0, 10_000_000, 10_000))
    with pytest.raises(ValidationError, match="less than or equal to 100000"):
        SimulatedVehicle.Params(rate=2e9)


def test_raw_counts_are_the_calibrated_readings():
    ports = read(duration=30)
    frd = np.array([1.0, -1.0, -1.0])
    raw_field = ports["raw_mag"].counts
    assert np.array_equal(raw_field, np.rint(raw_field))
    expected = chu2017.MAGNETOMETER(ports["mag"].magnetic_field * frd / 50e-6)
    assert np.abs(raw_field - expected).max() <= 0.5
    rate = np.radians(chu2017.GYROSCOPE(ports["raw_rate"].counts)) * frd
    assert np.abs(rate - ports["imu"].angular_velocity).max() < np.radians(0.07)
    force = 9.80665 * chu2017.ACCELEROMETER(ports["raw_force"].counts)
    assert np.abs(force - ports["imu"].linear_acceleration).max() < 0.001


def test_motion_and_errors_are_those_asked_for():
    level = {"start": "90 deg"}
    ports = read(
        duration=5, shaking=0, gyro_noise=0, dip="60 deg", field="40 uT",
        heading={**level, "slope": "2 deg/s"}, pitch={}, roll={"sines": [
            {"amplitude": "10 deg", "frequency": 0.5, "phase": "90 deg"}]},
        gyro_bias=["1 deg/s", 0, 0], accel_bias=[0, 0, "1 mg"], mag_bias=["1 uT", 0, 0],
    )  # fmt: skip
    assert np.degrees(ports["euler"].heading[-1]) == pytest.approx(90 + 2 * 4.99)
    assert np.degrees(ports["euler"].roll[0]) == pytest.approx(10)
    field = ports["mag"].magnetic_field - [1e-6, 0, 0]
    np.testing.assert_allclose(np.linalg.norm(field, axis=1), 40e-6)
    force = ports["imu"].linear_acceleration - [0, 0, 9.80665e-3]
    np.testing.assert_allclose(np.linalg.norm(force, axis=1), 9.80665)
    roll_rate = (
        -np.radians(10) * np.pi * np.sin(np.pi * ports["imu"].t * 1e-9 + np.pi / 2 - np.pi / 2)
    )
    np.testing.assert_allclose(
        ports["imu"].angular_velocity[:, 0] - np.radians(1), roll_rate, atol=1e-12
    )
    assert set(ports["truth"].moving.tolist()) == {1}


def test_seeds_differ():
    one, other = read(seed=1, duration=1), read(seed=2, duration=1)
    assert as_bytes(one["imu"]) != as_bytes(other["imu"])
    assert as_bytes(one["truth"]) == as_bytes(other["truth"])
