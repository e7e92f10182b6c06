"""Tilt-compensated compass against golden numbers and against scipy's rotations."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from lodeflow_plugins.fusion.tilt_compass import compass

DIP = np.radians(48.0)
GOLDEN_EULER = np.radians([30.0, 20.0, -10.0])
GOLDEN_FIELD = np.array([0.2903664, -0.4851621, 0.8248061])  # FRD
GOLDEN_FORCE = np.array([0.3420201, -0.1631759, 0.9254166])  # A^b, FLU
GOLDEN_QUATERNION = np.array([-0.1276794, 0.1448781, 0.2685358, 0.9437144])  # NED <- FRD

ENU_FROM_NED = np.array([[0, 1, 0], [1, 0, 0], [0, 0, -1]])
FRD_FROM_FLU = np.diag([1, -1, -1])


def at_rest(euler):
    """Specific force and field in FLU of attitudes (N, 3) given as heading, pitch, roll."""
    to_body = Rotation.from_euler("ZYX", euler).inv()
    force = to_body.apply([0.0, 0.0, -9.81])
    field = to_body.apply([np.cos(DIP), 0.0, np.sin(DIP)])
    return compass.swap_body(force), compass.swap_body(field)


def random_euler(n, seed=0):
    half = np.pi / 2 - 1e-3  # singular at a pitch of 90 degrees
    return np.random.default_rng(seed).uniform([0, -half, -np.pi], [2 * np.pi, half, np.pi], (n, 3))


def angle_between(a, b):
    return np.abs((a - b + np.pi) % (2 * np.pi) - np.pi)


def test_golden_inputs_are_those_of_the_attitude():
    force, field = at_rest(GOLDEN_EULER[None])
    np.testing.assert_allclose(force[0] / 9.81, GOLDEN_FORCE, atol=5e-8)
    np.testing.assert_allclose(compass.swap_body(field[0]), GOLDEN_FIELD, atol=5e-8)


def test_golden_attitude_equation_by_equation():
    pitch, roll = compass.tilt(*GOLDEN_FORCE)
    np.testing.assert_allclose([pitch, roll], GOLDEN_EULER[1:], atol=1e-7)
    assert compass.heading(*GOLDEN_FIELD, pitch, roll) == pytest.approx(GOLDEN_EULER[0], abs=2e-7)
    quaternion = compass.quaternion_from_euler(*GOLDEN_EULER)
    np.testing.assert_allclose(quaternion, GOLDEN_QUATERNION, atol=5e-8)
    np.testing.assert_allclose(compass.euler_from_quaternion(*quaternion), GOLDEN_EULER, atol=1e-15)


def test_measure_recovers_a_thousand_attitudes():
    truth = random_euler(1000)
    euler, quaternion = compass.measure(*at_rest(truth))
    # Near the singular pitch rounding grows with 1 / cos(pitch).
    error = angle_between(euler, truth) * np.cos(truth[:, 1:2])
    assert error.max() < 2e-15
    dcm = Rotation.from_euler("ZYX", truth).as_matrix()
    enu_flu = ENU_FROM_NED @ dcm @ FRD_FROM_FLU
    gap = Rotation.from_quat(quaternion).as_matrix() - enu_flu
    assert np.abs(gap).max() < 2e-15 / np.cos(truth[:, 1]).min()
    assert quaternion[:, 3].min() >= 0.0
    np.testing.assert_allclose(np.linalg.norm(quaternion, axis=1), 1.0, atol=1e-15)


def test_only_the_direction_of_the_inputs_counts():
    force, field = at_rest(random_euler(50))
    doubled = compass.measure(2.0 * force, 0.25 * field)
    for scaled, plain in zip(doubled, compass.measure(force, field), strict=True):
        assert scaled.tobytes() == plain.tobytes()


def test_a_field_in_the_wrong_frame_is_wrong():
    force, field = at_rest(GOLDEN_EULER[None])
    euler, _ = compass.measure(force, compass.swap_body(field))
    assert angle_between(euler[0, 0], GOLDEN_EULER[0]) > 0.5


def test_roll_beyond_90_degrees_needs_atan2():
    truth = np.radians([[200.0, 10.0, 150.0], [200.0, 10.0, -150.0]])
    euler, _ = compass.measure(*at_rest(truth))
    np.testing.assert_allclose(euler, truth, atol=1e-14)


@pytest.mark.parametrize("heading", [0.0, 1e-17, -1e-17, np.pi, 2 * np.pi, -1e-9])
def test_heading_is_in_one_turn(heading):
    euler, quaternion = compass.measure(*at_rest(np.array([[heading, 0.0, 0.0]])))
    back = compass.euler(quaternion)
    for angle in (euler[0, 0], back[0, 0]):
        assert 0.0 <= angle < 2 * np.pi
        assert angle_between(angle, heading) < 1e-15
    assert compass.wrap(-1e-17) == 0.0


def test_quaternions_swap_frames_as_matrices_do():
    ned = Rotation.random(200, rng=np.random.default_rng(5))
    enu = compass.swap_quaternion(ned.as_quat())
    expected = ENU_FROM_NED @ ned.as_matrix() @ FRD_FROM_FLU
    np.testing.assert_allclose(Rotation.from_quat(enu).as_matrix(), expected, atol=1e-15)
    np.testing.assert_allclose(compass.swap_quaternion(enu), ned.as_quat(), atol=1e-15)
    assert compass.swap_quaternion(ned.as_quat()[3]).tobytes() == enu[3].tobytes()


def test_facing_north_and_level_is_a_quarter_turn_in_enu():
    # Body x points to the north, which is the y axis of ENU.
    _, quaternion = compass.measure(*at_rest(np.zeros((1, 3))))
    np.testing.assert_allclose(quaternion[0], [0.0, 0.0, 0.5**0.5, 0.5**0.5], atol=1e-16)


def test_measured_quaternion_is_eq_27_in_the_other_frames():
    euler, quaternion = compass.measure(*at_rest(random_euler(100)))
    for row in range(100):
        eq_27 = compass.swap_quaternion(np.array(compass.quaternion_from_euler(*euler[row])))
        np.testing.assert_array_equal(np.abs(eq_27 @ quaternion[row]).round(15), 1.0)


def test_eq_30_leads_back_and_survives_rounding_beyond_one():
    truth = random_euler(500)
    quaternion = compass.measure(*at_rest(truth))[1]
    error = angle_between(compass.euler(quaternion), truth) * np.cos(truth[:, 1:2]) ** 2
    assert error.max() < 5e-15
    up = np.nextafter(0.5**0.5, 1.0)  # 2 (q4 q2) is a bit more than 1
    assert compass.euler_from_quaternion(0.0, up, 0.0, up)[1] == np.pi / 2


@settings(deadline=None)
@given(st.lists(st.integers(0, 60), max_size=6).map(sorted), st.integers(0, 99))
def test_any_split_into_blocks_gives_the_same_bytes(cuts, seed):
    rng = np.random.default_rng(seed)
    force, field = rng.standard_normal((2, 60, 3))
    whole = compass.measure(force, field)
    parts = [
        compass.measure(f, h)
        for f, h in zip(np.split(force, cuts), np.split(field, cuts), strict=True)
    ]
    for i in range(2):
        assert np.concatenate([part[i] for part in parts]).tobytes() == whole[i].tobytes()
    for function in (compass.euler, compass.swap_quaternion):
        pieces = [function(piece) for piece in np.split(whole[1], cuts)]
        assert np.concatenate(pieces).tobytes() == function(whole[1]).tobytes()
