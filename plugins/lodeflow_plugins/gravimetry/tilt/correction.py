"""Correction for the tilt of a gravimeter's platform, in three forms.

A rotation keeps the norm of the specific force: with the force f = (x, y, z) along the axes of a
nearly level platform and its true components (E, N, U),

    x^2 + y^2 + z^2 = E^2 + N^2 + U^2,     E = a_E + C_E - d_E,   N = a_N + C_N - d_N

where a is the kinematic acceleration of the vehicle, C its Coriolis acceleration, and d the
horizontal disturbing gravity. What is to be added to the reading z is U - z:

    exact      sqrt(z^2 + x^2 + y^2 - E^2 - N^2) - z
    modified   (x^2 + y^2 - E^2 - N^2) / 2g
    classical  (x^2 + y^2 - a_E^2 - a_N^2) / 2g          C and d left out

Source: Liu, Huang, Ma, Ouyang, Deng, Lu, Zhai 2018, A Modified Correction Model for Platform Tilt
in Air-Sea-Borne Gravimetry, Geomatics and Information Science of Wuhan University 43(4), 586-591,
of which the abstract and the tables were at hand; the formulas are derived.
"""

import math

import numpy as np
from numba import njit

ARCSECOND = math.pi / 648_000.0
CLASSICAL, MODIFIED, EXACT = 0, 1, 2


@njit(cache=True)
def corrections(
    force: np.ndarray,
    acceleration: np.ndarray,
    coriolis: np.ndarray,
    disturbance: np.ndarray,
    gravity: float,
) -> np.ndarray:
    """Classical, modified and exact correction of each row, (N, 3), m/s^2.

    force: (N, 3), along the platform's axes, x east, y north, z up; acceleration, coriolis and
    disturbance: (N, 2), east and north; m/s^2.
    gravity: g of the first two; 0 to take each row's own z for it, which is better where the
    vehicle accelerates vertically. The exact form is NaN where no rotation explains the force.
    """
    n = len(force)
    out = np.empty((n, 3))
    for k in range(n):
        x, y, z = force[k, 0], force[k, 1], force[k, 2]
        a_east, a_north = acceleration[k, 0], acceleration[k, 1]
        east = a_east + coriolis[k, 0] - disturbance[k, 0]
        north = a_north + coriolis[k, 1] - disturbance[k, 1]
        g = gravity if gravity > 0.0 else z
        sensed = x * x + y * y
        excess = sensed - east * east - north * north
        out[k, CLASSICAL] = (sensed - a_east * a_east - a_north * a_north) / (2.0 * g)
        out[k, MODIFIED] = excess / (2.0 * g)
        # sqrt(z^2 + excess) - z, without the difference of two large numbers.
        root = z * z + excess
        out[k, EXACT] = excess / (math.sqrt(root) + z) if root >= 0.0 and z > 0.0 else math.nan
    return out


@njit(cache=True)
def add_rows(vectors: np.ndarray, sums: np.ndarray) -> None:
    """Add the first two components of each row (N, 3) to sums (2,), one row after the other."""
    for k in range(len(vectors)):
        sums[0] += vectors[k, 0]
        sums[1] += vectors[k, 1]


def by_observations(
    force: np.ndarray, acceleration: np.ndarray, error: float, gravity: float
) -> float:
    """Error of the correction for an error (1 sigma) of each component of f and a, m/s^2.

    force, acceleration: (2,), horizontal. First order. Liu et al. 2018, Table 1, column M1.
    """
    return float(np.sqrt(force @ force + acceleration @ acceleration)) * error / gravity


def by_gravity(correction: float, error: float, gravity: float) -> float:
    """Error of the correction for an error of g, m/s^2. Table 1, column M2."""
    return abs(correction) * error / gravity


def tilt_error(error: float, gravity: float) -> float:
    """Error of each tilt angle (f - a) / g in rad. Liu et al. 2018, Table 2."""
    return math.sqrt(2.0) * error / gravity


def by_tilt(force: np.ndarray, angle_error: float) -> float:
    """Error of the correction for an error of both tilt angles (rad), m/s^2. Table 2."""
    return float(np.sqrt(force @ force)) * angle_error
