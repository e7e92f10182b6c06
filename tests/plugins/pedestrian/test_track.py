"""Tracks, on motions of which the way is known."""

import numpy as np
import pytest

import lodeflow as lf
from lodeflow.testing import run_node
from lodeflow_plugins.pedestrian.dead_reckoning.node import StanceTrack, StepTrack

RATE = 100
SWING, STANCE = 60, 40  # samples


def strides(ways, *, drift=(0.0, 0.0, 0.0), pause=100):
    """IMU and acceleration of a foot that stands, goes the ways (m), and stands."""
    u = (np.arange(SWING) + 0.5) / SWING
    # The second derivative of a way s(u) = u - sin(2 pi u) / 2 pi, which begins and ends at rest.
    shape = 2 * np.pi * np.sin(2 * np.pi * u) * (RATE / SWING) ** 2
    parts = [np.zeros((pause, 3))]
    for way in ways:
        parts += [shape[:, None] * np.array(way, float), np.zeros((STANCE, 3))]
    parts.append(np.zeros((pause, 3)))
    acceleration = np.concatenate(parts)
    moving = np.linalg.norm(acceleration, axis=1) > 0
    acceleration[moving] += drift
    rate = np.zeros_like(acceleration)
    rate[:, 1] = np.where(moving, 4.0, 0.0)
    t = np.arange(len(rate)) * (10**9 // RATE)
    return {"imu": lf.Imu(t, rate, rate), "acceleration": lf.Acceleration(t, acceleration)}


WAYS = [(1.0, 0.0, 0.0), (1.0, 0.5, 0.1), (0.0, 1.2, -0.1), (-0.8, 0.0, 0.0)]


def test_from_stance_to_stance():
    track = run_node(StanceTrack, **strides(WAYS))["out"]
    expected = np.concatenate([np.zeros((1, 3)), np.cumsum(WAYS, axis=0)])
    np.testing.assert_allclose(track.position, expected, atol=0.02)


def test_a_constant_error_of_a_swing_is_removed():
    clean = run_node(StanceTrack, **strides(WAYS))["out"].position[-1]
    drifting = run_node(StanceTrack, **strides(WAYS, drift=(0.3, -0.2, 0.1)))["out"].position[-1]
    assert np.linalg.norm(0.5 * np.array([0.3, -0.2, 0.1]) * 2.4**2) > 1.0  # what it would be
    np.testing.assert_allclose(drifting, clean, atol=0.05)


def test_standing_is_no_way():
    quick, slow = (run_node(StanceTrack, **strides(WAYS, pause=p))["out"] for p in (50, 2000))
    np.testing.assert_allclose(quick.position, slow.position, atol=1e-9)
    motion = strides([])
    motion["acceleration"].acceleration[:] = 0.2  # an attitude that is off by a degree
    assert np.abs(run_node(StanceTrack, **motion)["out"].position).max() < 1e-12


def test_who_is_still_swinging_at_the_end_has_no_last_stance():
    motion = strides(WAYS)
    cut = {name: block[: 100 + 20] for name, block in motion.items()}
    assert len(run_node(StanceTrack, **cut)["out"]) == 1


def attitude(t, headings):
    """Level, the x axis to the heading, clockwise from north."""
    half = 0.5 * (np.pi / 2 - np.asarray(headings))
    zero = np.zeros_like(half)
    return lf.Attitude(t, np.column_stack([zero, zero, np.sin(half), np.cos(half)]))


def test_from_step_to_step():
    t = np.array([10, 20, 30])
    steps = lf.Step(t, np.array([1, 2, 4]), t)  # the last one is two
    headings = attitude(np.array([0, 15, 25]), np.radians([0.0, 90.0, 180.0]))
    params = {"step_length": 1.5}
    track = run_node(StepTrack, params, steps=steps, attitude=headings)["out"]
    expected = [[0.0, 1.5, 0.0], [1.5, 1.5, 0.0], [1.5, -1.5, 0.0]]
    np.testing.assert_allclose(track.position, expected, atol=1e-12)
    turned = run_node(StepTrack, {**params, "mounting": np.pi / 2}, steps=steps, attitude=headings)[
        "out"
    ]
    assert turned.position[0] == pytest.approx([1.5, 0.0, 0.0], abs=1e-12)


def test_a_foot_on_its_tip_has_no_heading():
    steps = lf.Step(np.array([5]), np.array([1]), np.array([5]))
    tip = lf.Attitude(np.array([0]), np.array([[0.0, -np.sqrt(0.5), 0.0, np.sqrt(0.5)]]))
    assert np.isfinite(run_node(StepTrack, steps=steps, attitude=tip)["out"].position).all()
