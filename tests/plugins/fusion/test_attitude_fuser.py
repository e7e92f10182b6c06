"""Both stages in one node are the two nodes."""

import numpy as np

import lodeflow as lf
from lodeflow.testing import check_node, run_node
from lodeflow_plugins.fusion.attitude_fuser.node import AttitudeFuser
from lodeflow_plugins.fusion.heading_kalman.node import HeadingKalman
from lodeflow_plugins.fusion.inertial_attitude.node import InertialAttitude
from lodeflow_plugins.sources.simulated_vehicle import model


def sensors(rows):
    t = np.arange(rows, dtype=np.int64) * 10_000_000
    read = model.readings(model.truth(model.Vehicle(), t * 1e-9), model.Errors(), 0, 0)
    imu = lf.Imu(t, read.angular_velocity, read.specific_force)
    slow = np.arange(3, rows, 4)
    return imu, lf.MagneticField(t[slow] + 2_000_000 * (slow % 8 == 3), read.magnetic_field[slow])


def test_it_is_the_two_nodes():
    imu, mag = sensors(1500)
    first, second = {"force_time_constant": 2.0}, {"drift": "0.2 deg/s", "start_duration": 1.0}
    inclined = run_node(InertialAttitude, first, imu=imu)["attitude"]
    in_two = run_node(HeadingKalman, second, attitude=inclined, mag=mag)["attitude"]
    in_one = run_node(AttitudeFuser, {**first, **second}, imu=imu, mag=mag)["out"]
    assert in_one.t.tolist() == in_two.t.tolist() == imu.t.tolist()
    assert in_one.quaternion.tobytes() == in_two.quaternion.tobytes()


def test_any_split_gives_the_same_bytes():
    imu, mag = sensors(500)
    check_node(AttitudeFuser, {"start_duration": 0.5}, inputs={"imu": imu, "mag": mag})
