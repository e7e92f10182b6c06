"""The tilt correction, against worked numbers, and the tables of Liu et al. 2018."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from lodeflow_plugins.gravimetry.tilt import correction

MGAL = 1e-5
G = 979_000.0  # mGal; the formulas hold in any unit


def corrections(force, acceleration, coriolis, disturbance, gravity=G):
    """Classical, modified, exact."""
    columns = [np.array([c], float) for c in (force, acceleration, coriolis, disturbance)]
    return correction.corrections(*columns, gravity)[0]


@pytest.mark.parametrize(
    ("force", "acceleration", "coriolis", "disturbance", "expected"),
    [
        (
            (15497.8729, -9274.9056, 983999.7527),
            (15000, -10000),
            (340.17, 414.90),
            (33.12, -23.96),
            (0.61692, 0.24860, 0.24734),
        ),
        (
            (38711.0766, 31127.4047, 998993.7886),
            (40000, 30000),
            (-286.49, -349.90),
            (33.8, -24.35),
            (-16.61758, 6.33831, 6.21144),
        ),
        (
            (340.17 - 33.12, 414.90 + 23.96, G),
            (0, 0),
            (340.17, 414.90),
            (33.12, -23.96),
            (0.14652, 0.0, 0.0),
        ),
    ],
    ids=["small tilt", "large tilt", "level"],
)
def test_worked_numbers(force, acceleration, coriolis, disturbance, expected):
    found = corrections(force, acceleration, coriolis, disturbance)
    np.testing.assert_allclose(found, expected, atol=2e-4)


def test_the_vertical_force_of_the_sample_is_the_better_divisor():
    case = (38711.0766, 31127.4047, 998993.7886), (40000, 30000), (-286.49, -349.90), (33.8, -24.35)
    by_gravity, by_force = (corrections(*case, gravity=g) for g in (G, 0.0))
    assert abs(by_gravity[1] - by_gravity[2]) == pytest.approx(0.127, abs=1e-3)
    assert abs(by_force[1] - by_force[2]) < 3e-5


small = st.floats(-3e4, 3e4)
arc = st.floats(-1e-3, 1e-3)


@settings(deadline=None)  # the first example compiles
@given(arc, arc, small, small, st.floats(-400, 400), st.floats(-400, 400))
def test_the_exact_form_undoes_any_tilt(about_x, about_y, a_east, a_north, c_east, c_north):
    true = np.array([a_east + c_east, a_north + c_north, G])
    sensed = Rotation.from_rotvec([about_x, about_y, 0.0]).apply(true)
    found = corrections(sensed, (a_east, a_north), (c_east, c_north), (0, 0))
    assert found[correction.EXACT] == pytest.approx(G - sensed[2], abs=1e-6)
    # What the classical form leaves out: [2 (a . c) + c . c] / 2g.
    omitted = (2 * (a_east * c_east + a_north * c_north) + c_east**2 + c_north**2) / (2 * G)
    assert found[0] - found[1] == pytest.approx(omitted, abs=1e-6)


def test_a_force_that_no_rotation_explains():
    found = corrections((0, 0, 10.0), (50, 0), (0, 0), (0, 0))
    assert math.isnan(found[correction.EXACT])
    assert np.isfinite(found[:2]).all()


# Errors M of the observations in mGal, and what the paper prints for them.
TABLE_1 = {2: 0.05, 10: 0.27, 30: 0.82, 50: 1.36, 100: 2.72}
TABLE_2 = {
    2: (0.60, 0.06),
    10: (2.98, 0.27),
    30: (8.93, 0.82),
    50: (14.88, 1.37),
    100: (29.76, 2.73),
}
FORCE, ACCELERATION = np.full(2, 13_400.0), np.full(2, 13_250.0)


@pytest.mark.parametrize("m", TABLE_1)
def test_table_1(m):
    found = correction.by_observations(FORCE, ACCELERATION, m, 980_000.0)
    assert round(found, 2) == TABLE_1[m]
    assert round(correction.by_gravity(5.0, m, 980_000.0), 2) == 0.0  # column M2


@pytest.mark.parametrize("m", TABLE_2)
def test_table_2(m):
    angle, effect = TABLE_2[m]
    seconds = correction.tilt_error(m, 980_000.0) / correction.ARCSECOND
    assert seconds == pytest.approx(angle, rel=5e-4, abs=0.005)
    rounded = round(correction.tilt_error(m, 980_200.0) / correction.ARCSECOND, 2)
    assert rounded == angle
    assert round(correction.by_tilt(FORCE, rounded * correction.ARCSECOND), 2) == effect
