"""Programmes of the platform: rates are the derivatives of angles, positions are held."""

import numpy as np
import pytest

from lodeflow.clock import SimClock
from lodeflow_plugins.sources.simulated_platform import programme
from lodeflow_plugins.sources.simulated_platform.node import SimulatedPlatform

PROGRAMMES = [
    programme.Stops(programme.ATTITUDES, 2.0, 1.0),
    programme.Stops(programme.SIX_POSITIONS, 1.0, 0.5),
    programme.Turns(programme.RATES, 2.0, 1.0),
    programme.Tumble(np.array(programme.TUMBLE), 60.0),
]


@pytest.mark.parametrize("made", PROGRAMMES, ids=lambda made: type(made).__name__)
def test_rates_are_the_derivatives(made):
    seconds = np.linspace(0.01, made.duration - 0.01, 5000)
    step = 1e-6
    before, after = made(seconds - step)[0], made(seconds + step)[0]
    change = (after - before + np.pi) % (2.0 * np.pi) - np.pi
    smooth = np.abs(change).max(axis=1) < 1e-4  # not where the sensor is put on the table anew
    np.testing.assert_allclose((change / (2.0 * step))[smooth], made(seconds)[1][smooth], atol=1e-5)
    assert smooth.mean() > 0.99


@pytest.mark.parametrize("made", PROGRAMMES[:2])
def test_positions_are_held(made):
    for number, angles in enumerate(made.angles):
        begun = number * (made.rest + made.move)
        found, rates, stop = made(begun + np.linspace(0.0, made.rest, 5))
        np.testing.assert_allclose(found, np.tile(angles, (5, 1)), atol=1e-12)
        assert (rates == 0.0).all()
        assert stop.tolist() == [number] * 5


def test_each_rate_is_held_about_each_axis():
    made = PROGRAMMES[2]
    begun = 0.5 + np.arange(18) * 3.0
    held = made(begun + 1.0)[1]
    expected = [np.outer(programme.RATES, axis) for axis in np.eye(3)[::-1]]
    np.testing.assert_allclose(held, np.concatenate(expected), atol=1e-12)


def read(**params):
    source = SimulatedPlatform(SimulatedPlatform.Params(**params))
    source.start()
    return list(source.read(SimClock()))


def test_the_reading_error_is_one_turn_for_each_position():
    exact, off = (
        np.concatenate([block.attitude.quaternion for block in read(reading_error=error)])
        for error in (0.0, "1 deg")
    )
    angle = 2.0 * np.degrees(np.arccos(np.abs(np.sum(exact * off, axis=1)).clip(0.0, 1.0)))
    by_position = angle.reshape(96, 300)
    np.testing.assert_allclose(by_position, by_position[:, :1] * np.ones((1, 300)), atol=1e-4)
    rms = np.sqrt(np.mean(by_position[:, 0] ** 2))
    assert rms == pytest.approx(np.sqrt(3.0), rel=0.15)  # a degree about each axis


def test_the_walk_goes_on_from_block_to_block():
    blocks = read(programme="rest", duration=100, gyro_walk=1e-3, gyro_noise=0.0)
    rate = np.concatenate([block.raw_rate.counts for block in blocks])
    assert np.abs(np.diff(rate, axis=0)).max() < 3.0
    assert np.ptp(rate, axis=0).min() > 3.0
