"""The heading estimator on a tilted body, by an attitude whose heading drifts."""

import numpy as np
from scipy.spatial.transform import Rotation

import lodeflow as lf
from lodeflow.testing import run_node
from lodeflow_plugins.interference.heading_estimator.attitude_node import AttitudeHeadingEstimator

RATE, SECONDS = 50, 90
EARTH = np.array([0.0, 20e-6, -42e-6])
"""Magnetic field, T: east, north, up."""


def tumbling():
    """Stamps, true attitude, attitude with another heading, and the field, of a tumbling body."""
    s = np.arange(RATE * SECONDS) / RATE
    t = np.rint(s * 1e9).astype(np.int64)
    moving = np.clip(s - 3.0, 0.0, None)
    angles = np.stack([0.7 * moving, np.sin(0.9 * moving), 1.2 * np.sin(0.4 * moving)], axis=1)
    truth = Rotation.from_euler("ZYX", angles)
    drifting = Rotation.from_euler("Z", (2.0 + 0.0009 * s)[:, None]) * truth
    noise = 0.3e-6 * np.random.default_rng(2).standard_normal((len(t), 3))
    return t, truth, drifting.as_quat(), truth.inv().apply(EARTH) + noise


def run(t, attitude, field, every=1):
    """Attitudes and status; each so many rows with a field, from row `every` - 1 on."""
    rows = slice(every - 1, -1 if every == len(t) else None, every)
    mag = lf.MagneticField(t[rows].copy(), field[rows].copy())
    out = run_node(AttitudeHeadingEstimator, attitude=lf.Attitude(t, attitude), mag=mag)
    return out["attitude"], out["status"]


def errors(attitude, truth, t):
    """Rotation vectors (N, 3) from the truth to the attitudes, deg, in the earth frame."""
    there = truth[np.searchsorted(t, attitude.t[0]) :]
    return np.degrees((Rotation.from_quat(attitude.quaternion) * there.inv()).as_rotvec())


def test_a_tumbling_body_finds_north_and_keeps_its_inclination():
    t, truth, drifting, field = tumbling()
    attitude, status = run(t, drifting, field)
    error = errors(attitude, truth, t)
    assert attitude.t[0] == 10**9  # the end of start_duration
    assert np.abs(error[:, :2]).max() < 1e-6
    assert np.abs(error[:, 2]).max() < 3.0
    assert np.abs(error[-RATE * 10 :, 2]).max() < 1.0
    assert status.valid[-1] == 1


def test_a_magnet_nearby_does_not_turn_it():
    """Of 20 s, where the compass alone would be off by 45 degrees."""
    t, truth, drifting, field = tumbling()
    near = slice(40 * RATE, 60 * RATE)
    field[near] += truth[near].inv().apply([15e-6, -5e-6, 5e-6])
    attitude, status = run(t, drifting, field)
    assert np.abs(errors(attitude, truth, t)[-RATE * 50 :, 2]).max() < 5.0
    within = (status.t > t[42 * RATE]) & (status.t < t[59 * RATE])
    assert status.undisturbed[within].max() == 0
    assert status.undisturbed[-1] == 1


def test_without_a_field_there_is_no_heading():
    t, _, drifting, field = tumbling()
    attitude, status = run(t, drifting, field, every=len(t))
    assert len(attitude) == len(status) == 0


def test_a_slow_magnetometer_will_do():
    t, truth, drifting, field = tumbling()
    attitude, _ = run(t, drifting, field, every=5)
    assert np.abs(errors(attitude, truth, t)[:, 2]).max() < 3.0
