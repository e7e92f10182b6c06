"""From the body into the geographic frame."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

import lodeflow as lf
from lodeflow.testing import run_node
from lodeflow_plugins.fusion.tilt_compass import compass
from lodeflow_plugins.pedestrian.geographic import rotation
from lodeflow_plugins.pedestrian.geographic.node import EulerToGeographic, ToGeographic

ANGLES = np.radians([30.0, 10.0, -5.0])
MATRIX = [
    [0.8551627, 0.49240388, -0.16197278],
    [-0.51120416, 0.85286853, -0.10623361],
    [0.08583165, 0.17364818, 0.98106026],
]
AT_REST = np.array([0.84115018, 1.70175214, 9.61439057])  # right, front, up, for g = 9.8
FLU = AT_REST[[1, 0, 2]] * [1.0, -1.0, 1.0]

angle = st.floats(-3.1, 3.1)


def test_the_matrix():
    found = rotation.direction_cosines(*ANGLES)
    np.testing.assert_allclose(found, MATRIX, atol=1e-8)
    np.testing.assert_allclose(found @ AT_REST, [0.0, 0.0, 9.8], atol=1e-7)


@settings(deadline=None)  # the first example compiles
@given(angle, st.floats(-1.5, 1.5), angle)
def test_it_is_a_rotation(heading, pitch, roll):
    found = rotation.direction_cosines(heading, pitch, roll)
    np.testing.assert_allclose(found @ found.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(found) > 0.99


def test_nose_up_and_right_side_down_are_positive():
    front, right = np.array([0.0, 1.0, 0.0]), np.array([1.0, 0.0, 0.0])
    assert (rotation.direction_cosines(0.0, 0.3, 0.0) @ front)[2] > 0  # the nose points up
    assert (rotation.direction_cosines(0.0, 0.0, 0.3) @ right)[2] < 0  # the right side, down
    np.testing.assert_allclose(
        rotation.direction_cosines(np.pi / 2, 0, 0) @ front, right, atol=1e-15
    )


@settings(deadline=None)  # the first example compiles
@given(angle, st.floats(-1.5, 1.5), angle)
def test_angles_and_quaternion_say_the_same(heading, pitch, roll):
    force = np.array([[1.0, -2.0, 9.0]])
    q = np.array([compass.quaternion_from_euler(heading, pitch, roll)])  # NED <- FRD
    by_quaternion = rotation.by_quaternion(force, compass.swap_quaternion(q), 9.8)
    by_angles = rotation.by_angles(force, np.array([[heading, pitch, roll]]), 9.8)
    np.testing.assert_allclose(by_quaternion, by_angles, atol=1e-12)


def test_a_body_at_rest_does_not_accelerate():
    imu = lf.Imu(np.array([0]), np.zeros((1, 3)), FLU[None])
    q = compass.swap_quaternion(np.array([compass.quaternion_from_euler(*ANGLES)]))
    attitude = lf.Attitude(imu.t, q)
    euler = lf.EulerAngles(imu.t, *ANGLES[:, None])
    for out in (
        run_node(ToGeographic, {"gravity": 9.8}, imu=imu, attitude=attitude),
        run_node(EulerToGeographic, {"gravity": 9.8}, imu=imu, euler=euler),
    ):
        np.testing.assert_allclose(out["out"].acceleration, 0.0, atol=1e-7)
