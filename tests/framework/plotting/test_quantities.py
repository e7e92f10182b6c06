"""Names, units and values of what can be drawn."""

from typing import ClassVar

import numpy as np
import pytest
from recordings import random_block

import lodeflow as lf
from lodeflow.messages.vocabulary import AttitudeTruth, Mode
from lodeflow.plotting.quantities import euler, quantities
from lodeflow_plugins.fusion.tilt_compass import compass


class TwoCodes(lf.Message, ros="plot_test_msgs/msg/TwoCodes"):
    """Two codes, of which one has names."""

    GATE_OPEN: ClassVar = 1
    SHUT: ClassVar = 0

    gate: lf.UInt8
    flags: lf.UInt8


def by_name(kind, **options):
    return {quantity.name: quantity for quantity in quantities(kind, **options)}


def test_fields_are_shown_component_by_component_in_units_that_people_read():
    block = random_block(lf.Imu, np.arange(5))
    found = by_name(lf.Imu)
    assert list(found) == [
        f"{field}.{axis}" for field in ("angular_velocity", "linear_acceleration") for axis in "xyz"
    ]
    rate = found["angular_velocity.y"]
    assert (rate.unit, rate.turn, rate.whole) == ("°/s", 0.0, False)
    assert np.allclose(rate.take(block), np.degrees(block.angular_velocity[:, 1]), rtol=1e-15)
    force = found["linear_acceleration.z"]
    assert force.unit == "m/s²"
    assert np.array_equal(force.take(block), block.linear_acceleration[:, 2])
    field = by_name(lf.MagneticField)["magnetic_field.x"]
    sample = lf.MagneticField(np.arange(1), np.full((1, 3), 50e-6))
    assert (field.unit, field.take(sample).tolist()) == ("µT", [50.0])


def test_si_units_on_demand():
    block = random_block(lf.Heading, np.arange(5))
    heading = by_name(lf.Heading, si=True)["heading"]
    assert (heading.unit, heading.turn) == ("rad", 2 * np.pi)
    assert np.array_equal(heading.take(block), block.heading)
    assert by_name(lf.Heading)["heading"].turn == 360.0
    assert by_name(lf.Attitude, si=True)["pitch"].unit == "rad"


def test_an_attitude_has_euler_angles_beside_its_quaternion():
    found = by_name(AttitudeTruth)
    axes = [f"quaternion.{axis}" for axis in "xyzw"]
    assert list(found) == [*axes, "moving", "heading", "pitch", "roll"]
    assert found["moving"].whole
    assert not found["moving"].modes
    block = random_block(AttitudeTruth, np.arange(50))
    angles = np.degrees(
        compass.euler(block.quaternion / np.linalg.norm(block.quaternion, axis=1)[:, None])
    )
    for name, expected in zip(("heading", "pitch", "roll"), angles.T, strict=True):
        assert np.allclose(found[name].take(block), expected, atol=1e-9)


def test_euler_angles_of_a_gap_are_a_gap():
    assert all(np.isnan(angle).all() for angle in euler(np.full((2, 4), np.nan)))


def test_codes_with_names_are_modes():
    assert by_name(Mode)["mode"].modes == {0: "none", 1: "compass", 2: "gyro"}
    two = by_name(TwoCodes)
    assert two["gate"].modes == {1: "open"}
    assert two["flags"].modes == {}


@pytest.mark.parametrize("kind", [lf.Imu, AttitudeTruth, Mode, lf.Heading, TwoCodes])
def test_values_are_columns_of_floats(kind):
    for quantity in quantities(kind):
        found = quantity.take(random_block(kind, np.arange(4)))
        assert found.dtype == np.float64
        assert found.shape == (4,)
