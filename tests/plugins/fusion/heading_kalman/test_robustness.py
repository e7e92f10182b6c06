"""The heading stage in simulated worlds with truth: bad magnetometers, magnets, bad places.

A body is turned about by hand, with pauses; its gyroscope has a bias and noise, so that the
attitude without magnetometer drifts by 8 degrees in 200 s. What is asked of the heading is that it
is right, or that its variance says that it is not, and that it is never much worse than what came
in.
"""

from functools import cache
from typing import NamedTuple

import numpy as np
import pytest

import lodeflow as lf
from lodeflow.testing import run_node
from lodeflow_plugins.fusion.heading_kalman.node import HeadingKalman
from lodeflow_plugins.fusion.inertial_attitude.node import InertialAttitude
from lodeflow_plugins.sources.simulated_vehicle import model

HERTZ = 100
NORM, DIP = 48e-6, np.radians(65.0)


def swaying(*sines):
    return model.Motion(sines=tuple((np.radians(a), hertz, phase) for a, hertz, phase in sines))


HAND = model.Vehicle(
    heading=swaying((60, 0.11, 0), (30, 0.31, 1)),
    pitch=swaying((30, 0.17, 0), (10, 0.5, 2)),
    roll=swaying((40, 0.13, 0), (15, 0.41, 1)),
    dip=float(DIP),
    field=NORM,
)


class World(NamedTuple):
    """What the sensors read, and the truth."""

    t: np.ndarray
    seconds: np.ndarray
    attitude: lf.Attitude  # without heading
    field: np.ndarray
    quaternion: np.ndarray


@cache
def world(seconds=200, dip=float(DIP), lag=0.0, vehicle=HAND, hertz=HERTZ):
    vehicle = model.Vehicle(
        vehicle.heading, vehicle.pitch, vehicle.roll, vehicle.shaking, dip=dip, field=NORM
    )
    t = np.arange(seconds * hertz, dtype=np.int64) * (10**9 // hertz)
    errors = model.Errors(
        gyroscope=model.SensorError(np.radians(0.1), (0.002, -0.003, 0.004)),
        accelerometer=model.SensorError(0.03),
        magnetometer=model.SensorError(0.4e-6),
    )
    truth = model.truth(vehicle, t * 1e-9)
    read = model.readings(truth, errors, 0, 0)
    late = model.readings(model.truth(vehicle, t * 1e-9 - lag), errors, 0, 0)
    imu = lf.Imu(t, read.angular_velocity, read.specific_force)
    attitude = run_node(InertialAttitude, imu=imu)["attitude"]
    return World(t, t * 1e-9, attitude, late.magnetic_field, truth.quaternion)


def in_body(w, earth):
    """An earth vector (3,) or vectors (N, 3) in the body frame."""
    x, y, z, s = w.quaternion.T
    v = np.broadcast_to(earth, (len(x), 3))
    u = -np.stack([x, y, z], axis=1)
    t = 2.0 * np.cross(u, v)
    return v + s[:, None] * t + np.cross(u, t)


class Result(NamedTuple):
    """Heading error and its standard deviation, degrees, and the disturbance level, by sample."""

    error: np.ndarray
    sigma: np.ndarray
    level: np.ndarray
    state: lf.HeadingState

    def rms(self, begin, end):
        return np.sqrt(np.mean(self.error[int(begin * HERTZ) : int(end * HERTZ)] ** 2))

    def worst(self, begin, end):
        return np.abs(self.error[int(begin * HERTZ) : int(end * HERTZ)]).max()


def about_vertical(estimate, truth):
    z = estimate[:, 2] * truth[:, 3] - estimate[:, 3] * truth[:, 2]
    z += estimate[:, 1] * truth[:, 0] - estimate[:, 0] * truth[:, 1]
    return np.degrees(
        (2 * np.arctan2(z, np.sum(estimate * truth, axis=1)) + np.pi) % (2 * np.pi) - np.pi
    )


def heading(w, field=None, rows=slice(None), shift=0, **params):
    field = w.field if field is None else field
    mag = lf.MagneticField(
        np.ascontiguousarray(w.t[rows] + shift), np.ascontiguousarray(field[rows])
    )
    chosen = {"report_interval": 0, **params}
    out = run_node(HeadingKalman, chosen, attitude=w.attitude, mag=mag)
    assert out["attitude"].t.tolist() == w.t.tolist()
    found, state = out["attitude"].quaternion, out["state"]
    assert np.isfinite(found).all()
    sigma = np.degrees(np.sqrt(state.variance))
    return Result(about_vertical(found, w.quaternion), sigma, state.level, state)


def between(w, begin, end=np.inf):
    return ((w.seconds >= begin) & (w.seconds < end))[:, None]


def test_undisturbed():
    out = heading(world())
    assert out.rms(10, 200) < 0.5
    assert out.worst(10, 200) < 1.5
    assert out.sigma[0] > 90.0
    assert out.sigma[1000:].max() < 3.0
    assert out.level[1000:].max() < 1.0
    assert not out.state.hard_iron.any()
    np.testing.assert_allclose(out.state.horizontal[-1], NORM * np.cos(DIP), rtol=0.02)
    np.testing.assert_allclose(out.state.vertical[-1], -NORM * np.sin(DIP), rtol=0.02)


@pytest.mark.parametrize("lag", [0.0, 0.012, 0.04])
def test_the_lag_of_the_magnetometer_is_found(lag):
    out = heading(world(lag=lag))
    # The attitude is ahead of the truth by half a sample: its rates are taken backwards in time.
    assert out.state.magnetometer_lag[-1] == pytest.approx(lag + 0.5 / HERTZ, abs=0.002)
    assert out.rms(20, 200) < 0.6


@pytest.mark.parametrize("every", [4, 10, 50])
@pytest.mark.parametrize("shift", [0, 3_000_000])
def test_a_slow_magnetometer(every, shift):
    out = heading(world(), rows=slice(None, None, every), shift=shift)
    assert out.rms(20, 200) < 0.8


@pytest.mark.parametrize("interval", [0.0, 0.005, 0.1])
def test_any_interval_between_steps(interval):
    out = heading(world(), update_interval=interval)
    assert out.rms(10, 200) < 0.5
    assert out.sigma[1000:].max() < 3.0


def test_readings_that_are_not_numbers_count_as_none():
    w = world()
    bad = np.random.default_rng(0).random(len(w.t)) < 0.5
    bad |= (w.seconds > 60) & (w.seconds < 100)
    field = w.field.copy()
    field[bad] = np.nan
    field[:1] = np.inf
    out, without = heading(w, field), heading(w, rows=np.flatnonzero(~bad)[1:])
    assert out.error[1:].tolist() == without.error[1:].tolist()
    assert out.state.variance[1:].tolist() == without.state.variance[1:].tolist()


def test_stamps_since_1970_change_nothing():
    w = world()
    begin = 1_790_000_000_123_456_789
    late = w._replace(t=w.t + begin, attitude=w.attitude.replace(t=w.t + begin))
    assert heading(late).error.tolist() == heading(w).error.tolist()


def test_a_slow_magnetometer_that_repeats_its_readings():
    w = world()
    repeated = w.field[np.arange(len(w.t)) // 10 * 10]
    every = heading(w, rows=slice(None, None, 10))
    assert heading(w, repeated).error.tolist() == every.error.tolist()


def test_missing_and_lost_readings():
    w = world()
    rng = np.random.default_rng(0)
    here = np.flatnonzero((rng.random(len(w.t)) < 0.2) & ((w.seconds < 60) | (w.seconds > 100)))
    out = heading(w, rows=here)
    assert out.rms(20, 60) < 0.8
    assert out.worst(60, 100) < 3.0
    assert out.sigma[9990] > 2.0 * out.sigma[5990]  # it coasts, and says so
    assert out.rms(105, 200) < 0.8


def test_no_magnetometer_at_all_leaves_the_heading_as_it_came():
    w = world()
    out = heading(w, rows=slice(0, 0))
    assert np.abs(out.error - about_vertical(w.attitude.quaternion, w.quaternion)).max() < 1e-6
    assert (out.sigma > 90.0).all()


def test_a_disturbance_that_comes_and_goes():
    w = world()
    t = w.seconds
    earth = np.stack(
        [15e-6 * np.sin(0.5 * t), 10e-6 * np.cos(0.33 * t), 8e-6 * np.sin(0.21 * t)], 1
    )
    out = heading(w, w.field + between(w, 60, 100) * in_body(w, earth))
    assert out.worst(60, 100) < 5.0
    assert out.level[6500:9900].mean() > 5.0
    assert out.rms(105, 200) < 0.8


def test_a_start_inside_a_changing_disturbance():
    w = world()
    t = w.seconds
    earth = np.stack(
        [15e-6 * np.sin(0.5 * t), 10e-6 * np.cos(0.33 * t), 8e-6 * np.sin(0.21 * t)], 1
    )
    out = heading(w, w.field + between(w, 0, 60) * in_body(w, earth))
    assert out.rms(10, 60) > 10.0
    inside = np.abs(out.error[1000:6000]) < 3.0 * out.sigma[1000:6000]
    assert inside.mean() > 0.9
    assert out.rms(80, 200) < 2.0


def test_a_start_inside_a_steady_disturbance():
    w = world()
    field = w.field + between(w, 0, 60) * in_body(w, np.array([10e-6, -6e-6, 6e-6]))
    out = heading(w, field)
    assert out.rms(10, 60) > 25.0  # nothing tells it
    told = heading(w, field, expected_norm=NORM, expected_dip=float(DIP))
    assert (np.abs(told.error[500:6000]) < 3.0 * told.sigma[500:6000]).all()
    for result in (out, told):
        # As soon as the disturbance has gone, two headings are at odds, and it says so.
        assert (np.abs(result.error[6300:]) < 3.0 * result.sigma[6300:] + 1.0).mean() > 0.95
        assert result.rms(110, 200) < 2.5


@pytest.mark.parametrize("strength", [4e-6, 7e-6, 15e-6, 60e-6])
def test_a_magnet_that_is_put_on_the_body_and_taken_off(strength):
    w = world()
    magnet = strength * np.array([0.9, -0.35, 0.25])
    out = heading(w, w.field + between(w, 60, 130) * magnet)
    found = out.state.hard_iron[12900]
    assert np.linalg.norm(found - magnet) < 0.1 * strength + 1.2e-6
    assert out.worst(60, 80) < 5.0
    assert out.rms(80, 130) < 2.5
    assert not out.state.hard_iron[16000].any()
    assert out.rms(150, 200) < 1.5


@pytest.mark.parametrize("dip", [90.0, 89.5])
def test_without_horizontal_field_it_knows_that_it_knows_nothing(dip):
    w = world(dip=float(np.radians(dip)))
    out = heading(w)
    assert (np.abs(out.error[1000:]) < 3.0 * out.sigma[1000:]).all()
    # It is no worse than what came in: the error at 10 s stays.
    came = about_vertical(w.attitude.quaternion, w.quaternion)
    drift = np.abs(came - came[1000])[1000:].max()
    assert np.abs(out.error - out.error[1000])[1000:].max() < 3.0 * drift


@pytest.mark.parametrize("dip", [-80.0, 0.0, 80.0])
def test_at_other_latitudes(dip):
    out = heading(world(dip=float(np.radians(dip))))
    assert out.rms(20, 200) < 2.5
    assert (np.abs(out.error[2000:]) < 3.0 * out.sigma[2000:]).all()


def useless(kind, w):
    rng = np.random.default_rng(0)
    if kind == "noise":
        return rng.normal(0.0, 30e-6, w.field.shape)
    if kind == "zero":
        return np.zeros_like(w.field)
    if kind == "stuck":
        return np.broadcast_to(w.field[6000], w.field.shape)
    return np.cumsum(rng.normal(0.0, 2e-6, w.field.shape), axis=0)


@pytest.mark.parametrize("kind", ["noise", "zero", "stuck", "wandering"])
def test_a_magnetometer_that_fails_is_not_followed(kind):
    w = world()
    out = heading(w, np.where(between(w, 60), useless(kind, w), w.field))
    came = about_vertical(w.attitude.quaternion, w.quaternion)
    drift = np.abs(came - came[6000])[6000:].max()
    assert out.worst(60, 200) < 1.5 * drift
    assert (out.sigma[-100:] > 4.0 * out.sigma[5990]).all()
    assert (np.abs(out.error[6000:]) < 3.0 * out.sigma[6000:]).mean() > 0.97


@pytest.mark.parametrize("kind", ["noise", "zero", "stuck", "wandering"])
def test_a_magnetometer_that_never_worked_is_not_trusted(kind):
    w = world()
    out = heading(w, useless(kind, w))
    assert (out.sigma[500:] > 30.0).mean() > 0.95
    if kind in ("zero", "stuck"):  # no reading, or one: the heading is turned once, and coasts
        came = about_vertical(w.attitude.quaternion, w.quaternion)
        apart = (out.error - came - (out.error - came)[500] + 180.0) % 360.0 - 180.0
        assert np.abs(apart[500:]).max() < 1e-6


def test_hours():
    slow = model.Vehicle(
        heading=model.Motion(slope=0.3, sines=((0.5, 0.011, 0.0),)),
        pitch=swaying((20, 0.031, 0)),
        roll=swaying((25, 0.023, 1)),
    )
    hertz, seconds = 20, 3 * 3600
    w = world(seconds=seconds, vehicle=slow, hertz=hertz)
    out = heading(w)
    error = np.abs(out.error[60 * hertz :])
    assert np.sqrt(np.mean(error**2)) < 1.0
    assert error.max() < 3.0
    assert (error < 3.0 * out.sigma[60 * hertz :]).all()
    assert out.state.magnetometer_lag[-1] == pytest.approx(0.5 / hertz, abs=0.015)
    # It is as lively as at first.
    assert out.sigma[-1] == pytest.approx(out.sigma[300 * hertz], rel=0.5)
