"""Coriolis acceleration and Eotvos correction, against worked numbers."""

import numpy as np
import pytest
import scipy.optimize

import lodeflow as lf
from lodeflow.testing import run_node
from lodeflow_plugins.gravimetry.earth import rotation
from lodeflow_plugins.gravimetry.earth.node import (
    DisturbingGravity,
    Eotvos,
    HorizontalCoriolis,
    KinematicAcceleration,
)

MGAL = 1e-5


def coriolis(latitude, height, east, north, up=0.0):
    """In mGal."""
    c = rotation.coriolis(
        np.radians([latitude]), np.array([float(height)]), np.array([[east, north, up]], float)
    )
    return c[0] / MGAL


def on_course(azimuth, speed):
    return speed * np.sin(np.radians(azimuth)), speed * np.cos(np.radians(azimuth))


@pytest.mark.parametrize(
    ("azimuth", "east", "north", "eotvos"),
    [(129.35, 340.6657, 415.4718, 1160.4647), (309.31, -286.8024, -350.2793, -870.4234)],
)
def test_a_line_and_its_return(azimuth, east, north, eotvos):
    c = coriolis(20.66, 3000.0, *on_course(azimuth, 96.2))
    np.testing.assert_allclose(c, [east, north, -eotvos], atol=1e-3)


def test_a_row_of_a_survey_in_the_south():
    c = coriolis(-36.3078306, 308.57, 49.007, 37.671)
    np.testing.assert_allclose(c, [346.556, -450.842, -635.8913], atol=1e-3)


def test_table_3_follows_from_the_coriolis_acceleration_alone():
    # Means of both components, in mGal, on a line and on its return. With equal ground speed they
    # give the latitude, the speed and both courses, which come out plausible and reciprocal.
    printed = np.array([340.17, 414.90, -286.49, -349.90])

    def sensed(unknown):
        latitude, speed, there, back = unknown
        courses = [on_course(azimuth, speed) for azimuth in (there, back)]
        return np.concatenate([coriolis(latitude, 3000.0, *course)[:2] for course in courses])

    found = scipy.optimize.least_squares(lambda x: sensed(x) - printed, [20.0, 90.0, 130.0, 310.0])
    assert np.abs(found.fun).max() < 0.015
    latitude, speed, there, back = found.x
    assert latitude == pytest.approx(20.68, abs=0.02)
    assert speed == pytest.approx(96.01, abs=0.03)
    assert there == pytest.approx(129.35, abs=0.01)
    assert back == pytest.approx(309.31, abs=0.01)


def test_normal_gravity():
    for latitude, expected in [(0.0, 9.7803253359), (45.0, 9.8061977), (90.0, 9.8321849379)]:
        assert rotation.normal_gravity(np.radians(latitude)) == pytest.approx(expected, abs=1e-6)


def motion(n=5, velocity=None):
    t = np.arange(n) * 500_000_000
    full = np.full(n, np.radians(-36.0))
    velocity = np.tile([50.0, 30.0, 1.0], (n, 1)) if velocity is None else velocity
    return lf.GeodeticMotion(t, full, full, np.full(n, 300.0), velocity)


def test_the_eotvos_correction_is_the_vertical_coriolis_acceleration():
    flight = motion()
    c = run_node(HorizontalCoriolis, motion=flight)["out"].acceleration
    e = run_node(Eotvos, motion=flight)["out"].correction
    assert e.tolist() == (-c[:, 2]).tolist()
    assert e[0] / MGAL == pytest.approx(642.8, abs=1)


def test_disturbing_gravity_is_sensed_against_the_deflection():
    deflection = lf.Deflection(np.array([0, 10**9]), np.array([0.0, 1e-5]), np.array([2e-5, 0.0]))
    out = run_node(DisturbingGravity, motion=motion(), deflection=deflection)["out"].acceleration
    g = rotation.normal_gravity(np.radians(-36.0))
    np.testing.assert_allclose(out[0], [-2e-5 * g, 0.0, 0.0], rtol=1e-12)
    np.testing.assert_allclose(out[-1], [0.0, -1e-5 * g, 0.0], rtol=1e-12)


def test_the_acceleration_of_a_parabola_is_exact():
    t = np.arange(6) * 0.5
    velocity = np.column_stack([3.0 + 2.0 * t, -t, 0.1 * t])
    out = run_node(KinematicAcceleration, motion=motion(6, velocity))["out"]
    assert out.t.tolist() == [500_000_000 * k for k in range(1, 5)]
    np.testing.assert_allclose(out.acceleration, np.tile([2.0, -1.0, 0.1], (4, 1)), atol=1e-12)
