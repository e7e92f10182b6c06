"""The calibrators as nodes: golden numbers of Chu et al. 2017, axes, units, and refusals."""

import numpy as np
import pytest
from pydantic import ValidationError

import lodeflow as lf
from lodeflow.testing import run_node
from lodeflow_plugins.calibration import chu2017
from lodeflow_plugins.calibration.node import (
    AccelCalibrator,
    GyroCalibrator,
    ImuCombiner,
    MagCalibrator,
)

FRD = np.array([1.0, -1.0, -1.0])


def test_golden_field():
    raw = lf.RawField.of(5, counts=[582.60845, -975.8843049, 1180.4662998])
    out = run_node(MagCalibrator, raw=[raw])["out"]
    assert out.t.tolist() == [5]
    expected = 50e-6 * np.array([0.2903664, -0.4851621, 0.8248061]) * FRD
    np.testing.assert_allclose(out.magnetic_field[0], expected, atol=5e-12)


def test_table_1_in_degrees_is_the_same_magnetometer():
    angles = [[f"{angle!r} deg" for angle in row] for row in chu2017.TABLE_1.tolist()]
    example = {k: v for k, v in MagCalibrator.example.items() if k != "misalignment"}
    raw = lf.RawField.of(0, counts=[582.0, -975.0, 1180.0])
    by_angle = run_node(MagCalibrator, {**example, "axis_angles": angles}, raw=[raw])["out"]
    by_cosine = run_node(MagCalibrator, raw=[raw])["out"]
    np.testing.assert_allclose(by_angle.magnetic_field, by_cosine.magnetic_field, rtol=1e-13)


GOLDEN_FORCE = [  # z down, z up, y down, y up, x down, x up
    (-36.2697, 104.0041, 5580.2297),
    (-136.0936, 145.1300, -5522.6253),
    (-136.4276, -5431.9773, 17.4656),
    (-35.9357, 5681.1113, 40.1389),
    (5554.0114, 240.9418, -83.6805),
    (-5726.3747, 8.1923, 141.2850),
]


def test_golden_force_in_six_positions():
    raw = [lf.RawForce.of(k, counts=counts) for k, counts in enumerate(GOLDEN_FORCE)]
    out = run_node(AccelCalibrator, raw=raw)["out"]
    expected = lf.STANDARD_GRAVITY * chu2017.SIX_POSITIONS
    np.testing.assert_allclose(out.specific_force, expected, atol=1e-6)


GOLDEN_RATE = [
    (-260.4818, -22.0872, -10.2358),
    (-18.5702, 222.9392, -14.8791),
    (-19.9152, -19.8073, -257.8508),
]


def test_golden_rate_about_each_axis():
    raw = [lf.RawRate.of(k, counts=counts) for k, counts in enumerate(GOLDEN_RATE)]
    out = run_node(GyroCalibrator, raw=raw)["out"]
    expected = np.radians(30.0) * np.diag(FRD)
    np.testing.assert_allclose(out.angular_rate, expected, atol=1e-6)


def test_body_axes_turn_y_and_z():
    raw = [lf.RawForce.of(0, counts=GOLDEN_FORCE[2])]
    as_flu = run_node(AccelCalibrator, raw=raw)["out"]
    as_frd = run_node(AccelCalibrator, {**AccelCalibrator.example, "body_axes": "frd"}, raw=raw)
    np.testing.assert_array_equal(as_frd["out"].specific_force, as_flu.specific_force * FRD)


def test_combiner_takes_equal_stamps():
    force = [lf.SpecificForce.of(t, specific_force=[t, 0, 9.8]) for t in (1, 2, 4)]
    rate = [lf.AngularRate.of(t, angular_rate=[0, t, 0]) for t in (2, 3, 4)]
    out = run_node(ImuCombiner, force=force, rate=rate)["out"]
    assert out.t.tolist() == [2, 4]
    assert out.linear_acceleration.tolist() == [[2, 0, 9.8], [4, 0, 9.8]]
    assert out.angular_velocity.tolist() == [[0, 2, 0], [0, 4, 0]]


@pytest.mark.parametrize(
    ("changes", "why"),
    [
        ({"misalignment": (2 * np.eye(3)).tolist()}, "rows of misalignment have to be unit vec"),
        ({"misalignment": [[1, 0, 0]] * 3}, "has to be invertible"),
        ({"misalignment": None}, "give one of misalignment and axis_angles"),
        ({"axis_angles": np.eye(3).tolist()}, "give one of misalignment and axis_angles"),
        ({"sensitivity": [1, 0, 1]}, "sensitivity has to be positive"),
        ({"unit": "50 mg"}, "'mg' is not a unit of T"),
        ({"body_axes": "ned"}, "'flu' or 'frd'"),
    ],
)
def test_a_magnetometer_that_cannot_be_is_refused(changes, why):
    with pytest.raises(ValidationError, match=why):
        MagCalibrator.Params(**{**MagCalibrator.example, **changes})
