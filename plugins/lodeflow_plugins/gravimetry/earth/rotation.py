"""Coriolis and centrifugal acceleration of a vehicle over the WGS84 ellipsoid.

With the earth rate w, latitude p, height h, velocity v (east, north, up), and the radii of
curvature N (prime vertical) and M (meridian), the specific force contains, beside the vehicle's
own acceleration, C = (2 w_ie + w_en) x v:

    C_E = -(2 w sin p + v_E tan p / (N + h)) v_N + (2 w cos p + v_E / (N + h)) v_U
    C_N =  (2 w sin p + v_E tan p / (N + h)) v_E + v_N v_U / (M + h)
    C_U = -(2 w cos p v_E + v_E^2 / (N + h) + v_N^2 / (M + h)) = -Eotvos correction

The platform senses +C. Source: derived from the navigation equation for Liu et al. 2018,
Geomatics and Information Science of Wuhan University 43(4), whose Table 3 follows from it.
"""

import math

import numpy as np
from numba import njit

SEMI_MAJOR_AXIS = 6_378_137.0  # m, WGS84
ECCENTRICITY_SQUARED = 0.00669437999014  # WGS84
EARTH_RATE = 7.292115e-5  # rad/s
EQUATORIAL_GRAVITY = 9.7803253359  # m/s^2, normal gravity of WGS84 (Somigliana)
GRAVITY_CONSTANT = 0.00193185265241


@njit(cache=True)
def radii(latitude: float) -> tuple[float, float]:
    """Radii of curvature of the ellipsoid in m: prime vertical N, and meridian M."""
    root = 1.0 - ECCENTRICITY_SQUARED * math.sin(latitude) ** 2
    n = SEMI_MAJOR_AXIS / math.sqrt(root)
    return n, n * (1.0 - ECCENTRICITY_SQUARED) / root


@njit(cache=True)
def normal_gravity(latitude: float) -> float:
    """Normal gravity on the ellipsoid, m/s^2 (Somigliana)."""
    square = math.sin(latitude) ** 2
    return (
        EQUATORIAL_GRAVITY
        * (1.0 + GRAVITY_CONSTANT * square)
        / math.sqrt(1.0 - ECCENTRICITY_SQUARED * square)
    )


@njit(cache=True)
def coriolis(latitude: np.ndarray, height: np.ndarray, velocity: np.ndarray) -> np.ndarray:
    """C of each row, (N, 3), east, north, up, m/s^2.

    latitude: (N,), rad; height: (N,), m; velocity: (N, 3), east, north, up, m/s. Not for the
    poles, where east has no meaning.
    """
    count = len(latitude)
    out = np.empty((count, 3))
    for k in range(count):
        n, m = radii(latitude[k])
        n, m = n + height[k], m + height[k]
        east, north, up = velocity[k, 0], velocity[k, 1], velocity[k, 2]
        vertical = 2.0 * EARTH_RATE * math.sin(latitude[k]) + east * math.tan(latitude[k]) / n
        horizontal = 2.0 * EARTH_RATE * math.cos(latitude[k])
        out[k, 0] = -vertical * north + (horizontal + east / n) * up
        out[k, 1] = vertical * east + north * up / m
        out[k, 2] = -(horizontal * east + east * east / n + north * north / m)
    return out


@njit(cache=True)
def disturbance(latitude: np.ndarray, north: np.ndarray, east: np.ndarray) -> np.ndarray:
    """Horizontal disturbing gravity, (N, 3), east, north and 0, m/s^2: -gravity times deflection.

    latitude: (N,); north, east: (N,), deflection of the vertical xi and eta, rad.
    """
    out = np.zeros((len(latitude), 3))
    for k in range(len(latitude)):
        gravity = normal_gravity(latitude[k])
        out[k, 0] = -gravity * east[k]
        out[k, 1] = -gravity * north[k]
    return out
