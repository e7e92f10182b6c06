"""Compass, filter and heading as nodes: golden numbers, gaps, slow sensors, gates."""

import numpy as np
import pytest

import lodeflow as lf
from lodeflow.testing import check_node, run_node
from lodeflow_plugins.fusion.heading_from_attitude import HeadingFromAttitude
from lodeflow_plugins.fusion.quaternion_kalman import filter as kalman
from lodeflow_plugins.fusion.quaternion_kalman.node import ChuFuser, QuaternionKalman
from lodeflow_plugins.fusion.tilt_compass import compass
from lodeflow_plugins.fusion.tilt_compass.node import TiltCompass
from lodeflow_plugins.sources.simulated_vehicle import model

STEP = 10_000_000
ROWS = 2000
SMOOTH = model.Vehicle(shaking=(model.Motion(),) * 3)
TURNING = model.Vehicle(
    heading=model.Motion(slope=np.radians(30.0)),
    pitch=model.Motion(),
    roll=model.Motion(),
    shaking=(model.Motion(),) * 3,
)
QUIET = model.Errors(gyroscope=model.SensorError())


def sensors(vehicle, t, errors=QUIET):
    state = model.truth(vehicle, t * 1e-9)
    read = model.readings(state, errors, 0, 0)
    imu = lf.Imu(t, read.angular_velocity, read.specific_force)
    return imu, lf.MagneticField(t, read.magnetic_field), state


def angle(a, b):
    """Angle between quaternions, degrees."""
    return np.degrees(2.0 * np.arccos(np.minimum(1.0, np.abs(np.sum(a * b, axis=1)))))


STAMPS = np.arange(ROWS, dtype=np.int64) * STEP


def test_golden_attitude_and_heading():
    imu = lf.Imu.of(7, linear_acceleration=[0.3420201, -0.1631759, 0.9254166])
    mag = lf.MagneticField.of(7, magnetic_field=[0.2903664, 0.4851621, -0.8248061])
    out = run_node(TiltCompass, imu=[imu], mag=[mag])
    euler = out["euler"]
    got = np.degrees([euler.heading[0], euler.pitch[0], euler.roll[0]])
    np.testing.assert_allclose(got, [30.0, 20.0, -10.0], atol=1e-5)
    golden = compass.swap_quaternion(np.array([[-0.1276794, 0.1448781, 0.2685358, 0.9437144]]))
    np.testing.assert_allclose(angle(out["attitude"].quaternion, golden), 0.0, atol=1e-5)
    heading = run_node(HeadingFromAttitude, attitude=out["attitude"])["out"]
    assert heading.t.tolist() == [7]
    assert np.degrees(heading.heading[0]) == pytest.approx(30.0, abs=1e-5)


def test_compass_measures_once_for_each_field_reading():
    imu, mag, state = sensors(SMOOTH, STAMPS)
    slow = mag[::4].replace(t=mag.t[::4] + 2_000_000)
    attitude = run_node(TiltCompass, imu=imu, mag=slow)["attitude"]
    assert attitude.t.tolist() == slow.t.tolist()
    assert angle(attitude.quaternion, state.quaternion[::4]).max() < 1e-5
    far = mag[::4].replace(t=mag.t[::4] + 6_000_000)
    gap = imu[np.arange(ROWS) % 4 == 0]  # no sample within 5 ms
    assert len(run_node(TiltCompass, imu=gap, mag=far)["attitude"]) == 0


def test_gated_compass_says_nothing_while_it_accelerates():
    imu, mag, _ = sensors(model.Vehicle(), STAMPS)
    off = np.abs(np.linalg.norm(imu.linear_acceleration, axis=1) - lf.STANDARD_GRAVITY)
    out = run_node(TiltCompass, {"gate": 0.5}, imu=imu, mag=mag)
    expected = imu.t[off < 0.5].tolist()
    assert 100 < len(expected) < ROWS - 100
    assert out["attitude"].t.tolist() == out["euler"].t.tolist() == expected


@pytest.mark.parametrize("gate", [None, 0.5])
def test_chu_fuser_is_compass_and_filter(gate):
    imu, mag, _ = sensors(model.Vehicle(), STAMPS, model.Errors())
    measured = run_node(TiltCompass, {"gate": gate}, imu=imu, mag=mag)["attitude"]
    in_two = run_node(QuaternionKalman, imu=imu, measured=measured)["out"]
    in_one = run_node(ChuFuser, {"gate": gate}, imu=imu, mag=mag)["out"]
    assert in_one.t.tolist() == in_two.t.tolist() == imu.t.tolist()
    assert in_one.quaternion.tobytes() == in_two.quaternion.tobytes()


def test_the_node_is_the_filter():
    imu, mag, _ = sensors(model.Vehicle(), STAMPS, model.Errors())
    measured = run_node(TiltCompass, imu=imu, mag=mag)["attitude"]
    chosen = {"gyro_noise": "0.2 deg/s", "measurement_variance": 0.02, "initial_variance": 0.1}
    out = run_node(QuaternionKalman, chosen, imu=imu, measured=measured[50:])["out"]
    row = np.where(np.arange(ROWS) < 50, -1, np.arange(ROWS))
    expected = np.empty((ROWS, 4))
    constants = kalman.constants(np.radians(0.2), 0.02, 0.1)
    state = kalman.new_state()
    z = measured.quaternion
    assert kalman.run(imu.t, imu.angular_velocity, z, row, constants, state, expected) == 50
    assert out.t.tolist() == imu.t[50:].tolist()
    assert out.quaternion.tobytes() == expected[50:].tobytes()


CASES = {
    "slow": (slice(0, None, 4), 0),
    "between": (slice(0, None, 4), 3_000_000),
    "late and with gaps": (np.r_[300:400, 900:1000], 7_000_000),
    "fast": (slice(0, None), 5_000_000),
}


@pytest.mark.parametrize("case", CASES)
def test_measurements_at_their_own_stamps(case):
    # A steady turn: whoever uses a measurement at another stamp is off by 30 degrees/s times that.
    rows, shift = CASES[case]
    imu, _, state = sensors(TURNING, STAMPS)
    _, mag, at_field = sensors(TURNING, STAMPS[rows] + shift)
    measured = lf.Attitude(mag.t, at_field.quaternion)
    truth = state.quaternion[np.searchsorted(imu.t, mag.t[0]) :]
    for out in (
        run_node(QuaternionKalman, imu=imu, measured=measured)["out"],
        # At rest and level the last specific force is as good as one of the field's own stamp.
        run_node(ChuFuser, imu=imu, mag=mag)["out"],
    ):
        assert out.t.tolist() == imu.t[-len(truth) :].tolist()
        assert angle(out.quaternion, truth).max() < 0.002


@pytest.mark.parametrize("plugin", [QuaternionKalman, ChuFuser])
def test_no_estimate_before_a_measurement_and_a_sample(plugin):
    imu, mag, state = sensors(TURNING, STAMPS[:20])
    second = (
        {"mag": mag} if plugin is ChuFuser else {"measured": lf.Attitude(mag.t, state.quaternion)}
    )
    ((name, early),) = second.items()
    early = early.replace(t=early.t - 10**9)
    assert len(run_node(plugin, imu=imu[:0], **{name: early})["out"]) == 0
    assert len(run_node(plugin, imu=imu, **{name: early[:0]})["out"]) == 0
    out = run_node(plugin, imu=imu, **{name: early})["out"]
    # A field alone is no attitude; a measured attitude is.
    assert len(out) == (0 if plugin is ChuFuser else 20)


@pytest.mark.parametrize("plugin", [QuaternionKalman, ChuFuser])
def test_any_split_gives_the_same_bytes_with_slow_and_shifted_inputs(plugin):
    imu, mag, state = sensors(model.Vehicle(), STAMPS[:300], model.Errors())
    keep = np.sort(np.random.default_rng(0).choice(300, 120, replace=False))
    t = mag.t[keep] + 4_000_000 * (keep % 2)
    second = (
        {"mag": mag[keep].replace(t=t)}
        if plugin is ChuFuser
        else {"measured": lf.Attitude(t, state.quaternion[keep])}
    )
    check_node(plugin, inputs={"imu": imu[keep.max() // 3 :], **second})


def test_gate_helps_while_the_vehicle_shakes_hard():
    level = [model.Motion(sines=((4.0, hertz, 0.0),)) for hertz in (0.2, 0.3)]
    rough = model.Vehicle(shaking=(*level, model.Motion()))
    imu, mag, state = sensors(rough, STAMPS, model.Errors())
    free = run_node(ChuFuser, imu=imu, mag=mag)["out"]
    gated = run_node(ChuFuser, {"gate": "0.3 m/s^2"}, imu=imu, mag=mag)["out"]
    rms = [np.sqrt(np.mean(angle(o.quaternion, state.quaternion) ** 2)) for o in (free, gated)]
    assert rms[1] < 0.7 * rms[0]
