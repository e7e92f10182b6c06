"""Dipoles and the two worlds that are made of them."""

import numpy as np
import pytest

from lodeflow.clock import SimClock
from lodeflow_plugins.sources import dipoles
from lodeflow_plugins.sources.turntable.model import Bench
from lodeflow_plugins.sources.turntable.model import Turntable as Table
from lodeflow_plugins.sources.turntable.node import Turntable
from lodeflow_plugins.sources.vehicle_in_city import model
from lodeflow_plugins.sources.vehicle_in_city.node import VehicleInCity

DIP = np.radians(48.0)


def still(distance, moment, heading=0.0, azimuth=0.0, carried=0.0):
    """Field (3,) at the origin of one dipole that stands at a distance."""
    path = np.array([[0, 1, 10, distance, distance, 0, azimuth, 0, carried, 1.0]])
    moments = np.zeros((1, 4, 3))
    moments[0, 0] = moment
    where = np.zeros(3)
    return dipoles.disturbance(
        np.array([5.0]), np.array([heading]), where, path, np.zeros((1, 4, 3)), moments
    )[0]


def test_a_dipole_along_and_across():
    np.testing.assert_allclose(still(0.5, [0.01, 0, 0]), [2 * 0.01 / 0.125, 0, 0], atol=1e-15)
    np.testing.assert_allclose(still(0.5, [0, 0.01, 0]), [0, -0.01 / 0.125, 0], atol=1e-15)
    assert np.linalg.norm(still(1.0, [0.01, 0.0, 0])) / np.linalg.norm(
        still(0.5, [0.01, 0, 0])
    ) == pytest.approx(1 / 8)


def test_a_source_stays_with_the_earth_or_with_the_body():
    north = still(0.5, [0.01, 0.004, 0.002])
    turned = still(0.5, [0.01, 0.004, 0.002], heading=0.6)
    c, s = np.cos(0.6), np.sin(0.6)
    np.testing.assert_allclose(
        turned, [c * north[0] + s * north[1], c * north[1] - s * north[0], north[2]], atol=1e-15
    )
    carried = still(0.5, [0.01, 0.004, 0.002], heading=0.6, carried=1.0)
    np.testing.assert_allclose(carried, north, atol=1e-15)


def test_iron_is_magnetised_along_the_field():
    offsets, moments = dipoles.iron(np.random.default_rng(0), 0.2, 0.1, DIP)
    np.testing.assert_allclose(moments.sum(axis=0), 0.008 * np.array([1, 0, np.tan(DIP)]))
    assert offsets.std() > 0.03


def test_a_source_comes_and_goes():
    path = np.array([[10.0, 5, 2, 0.3, 3.0, 0, 0, 0, 0, 0.0]])
    moments = np.zeros((1, 4, 3))
    moments[0, 0, 0] = 0.01
    seconds = np.arange(0, 30, 0.5)
    field = dipoles.disturbance(
        seconds, np.zeros(60), np.zeros(3), path, np.zeros((1, 4, 3)), moments
    )[:, 0]
    assert (field[(seconds < 10) | (seconds >= 22)] == 0).all()
    assert seconds[field.argmax()] in (15.0, 15.5, 16.0, 16.5, 17.0)
    assert field.max() == pytest.approx(0.02 / 0.3**3)


def test_an_undisturbed_table_reads_what_it_should():
    table = Table(Bench(disturbed=0, offset=0, scale=0, noise=0, resolution=0), 0)
    fields = table.rotation(0)
    heading = np.arctan2(-fields[..., 1], fields[..., 0])
    np.testing.assert_allclose(heading[:, 0] % (2 * np.pi), table.heading, atol=1e-12)
    np.testing.assert_allclose(np.hypot(fields[..., 0], fields[..., 1]), 1)


def read(plugin, **params):
    source = plugin(plugin.Params(**params))
    source.start()
    parts = list(source.read(SimClock()))
    return type(parts[0])(
        *[type(blocks[0]).concat(list(blocks)) for blocks in zip(*parts, strict=True)]
    )


def test_the_table_as_a_source():
    ports = read(Turntable, rotations=2, rest=10, disturbed=0, residual=0, noise=0)
    assert len(ports.first) == 72
    assert np.diff(ports.first.t).max() == 11 * 10**9
    flu = ports.first.magnetic_field
    heading = np.arctan2(flu[:, 1], flu[:, 0]) % (2 * np.pi)
    error = (heading - ports.truth.heading + np.pi) % (2 * np.pi) - np.pi
    assert np.abs(error).max() < 1e-3  # one LSB of 1168
    # The gyro turns by as much as the table, right being negative about up.
    t = ports.gyro.t * 1e-9
    assert -np.trapezoid(ports.gyro.angular_rate[:, 2], t) == pytest.approx(4 * np.pi, abs=0.2)


def test_the_static_iron_is_an_ellipse():
    iron = {"centre": [0.1, -0.2], "radii": [1.1, 0.9], "angle": 0.5}
    plain = read(Turntable, rotations=1, seed=3)
    bent = read(Turntable, rotations=1, seed=3, first_iron=iron)
    c, s = np.cos(0.5), np.sin(0.5)
    turn = np.array([[c, -s], [s, c]])
    soft = turn @ np.diag([1.1, 0.9]) @ turn.T
    expected = plain.first.magnetic_field[:, :2] @ soft.T + 33.5e-6 * np.array([0.1, -0.2])
    np.testing.assert_allclose(bent.first.magnetic_field[:, :2], expected, atol=1e-12)
    assert np.array_equal(bent.second.magnetic_field, plain.second.magnetic_field)


def test_the_rate_of_a_drive_is_the_derivative_of_its_heading():
    world = model.World(model.City(near=0), 1, 60.0, 100.0)
    seconds = np.arange(6000) / 100
    heading, rate = model.drive(seconds, world.start, world.turns, world.wiggle)
    np.testing.assert_allclose(np.gradient(heading, 0.01)[1:-1], rate[1:-1], atol=1e-3)
    assert np.ptp(heading) > 1.0


def test_a_city_is_what_was_asked_for():
    calm = model.World(model.City(near=0), 3, 120, 20).rows()
    assert (calm.disturbance == 0).all()
    strength = np.hypot(calm.fields[..., 0], calm.fields[..., 1])
    assert np.abs(strength - 1).max() < 0.05
    near = model.World(model.City(), 3, 600, 20).rows()
    assert 0.2 < np.mean(near.disturbance > 0.05) < 0.8
    long = model.World(model.City(long=300), 3, 600, 20).rows()
    apart = np.flatnonzero(long.disturbance[:, 0] > 0)
    assert 290 < (apart[-1] - apart[0]) / 20 < 360
    start = model.World(model.City(start=True), 3, 600, 20).rows()
    assert start.disturbance[0].min() > 0
    step = model.World(model.City(near=0, step=0.02), 3, 120, 20).rows()
    change = step.fields[1200:] - calm.fields[1200:]
    assert np.abs(change).max() > 0.01
    assert np.array_equal(step.fields[:1200], calm.fields[:1200])


def test_far_sources_are_alike_at_both_compasses():
    difference = {}
    for name, city in (("near", model.City()), ("far", model.City(near=0, far=1))):
        rows = model.World(city, 11, 600, 20).rows()
        disturbed = rows.disturbance[:, 0] > 0.05
        first, second = rows.disturbance[disturbed].T
        difference[name] = np.median(np.abs(first - second) / first)
    assert difference["far"] < 0.3 * difference["near"]


def test_the_city_as_a_source_and_its_seeds():
    one, same, other = (read(VehicleInCity, seed=s, duration=20) for s in (1, 1, 2))
    assert one.first.magnetic_field.tobytes() == same.first.magnetic_field.tobytes()
    assert one.first.magnetic_field.tobytes() != other.first.magnetic_field.tobytes()
    assert len(one.first) == 400
    assert 0 <= one.truth.heading.min() <= one.truth.heading.max() < 2 * np.pi
