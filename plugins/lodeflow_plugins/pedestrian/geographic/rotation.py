"""Rotation from the body into the geographic frame, as a matrix and as a quaternion.

Source: the step counter printed with Liu et al. 2018, Geomatics and Information Science of Wuhan
University 43(4), Eqs. 1 and 2. The matrix printed in Eq. 1 is not orthogonal: its expanded (2,1)
has sin psi where the product has sin gamma and lacks a term, its (2,3) lacks sin psi sin gamma,
and the factor of the pitch has the opposite sign to that of the roll. Here it is the product
Rz(psi, clockwise) Rx(theta) Ry(gamma), which turns the specific force of a body at rest into
(0, 0, g).
"""

import math

import numpy as np
from numba import njit


def direction_cosines(heading: float, pitch: float, roll: float) -> np.ndarray:
    """C_b^t, (3, 3): turns vectors from x right, y front, z up into x east, y north, z up.

    heading: clockwise from north; pitch: nose up; roll: right side down; rad. Eq. 1, corrected.
    """
    return _matrix(heading, pitch, roll)


@njit(cache=True)
def _matrix(heading: float, pitch: float, roll: float) -> np.ndarray:
    sh, ch = math.sin(heading), math.cos(heading)
    sp, cp = math.sin(pitch), math.cos(pitch)
    sr, cr = math.sin(roll), math.cos(roll)
    return np.array(
        [
            [ch * cr + sh * sp * sr, sh * cp, ch * sr - sh * sp * cr],
            [-sh * cr + ch * sp * sr, ch * cp, -sh * sr - ch * sp * cr],
            [-cp * sr, sp, cp * cr],
        ]
    )


@njit(cache=True)
def by_angles(force: np.ndarray, angles: np.ndarray, gravity: float) -> np.ndarray:
    """Acceleration a_t = C_b^t f - (0, 0, gravity) of each row, (N, 3), east, north, up.

    force: (N, 3), specific force, x forward, y left, z up; angles: (N, 3), heading, pitch and
    roll as for `direction_cosines`, rad.
    """
    n = len(force)
    out = np.empty((n, 3))
    for k in range(n):
        c = _matrix(angles[k, 0], angles[k, 1], angles[k, 2])
        right, front, up = -force[k, 1], force[k, 0], force[k, 2]
        for i in range(3):
            out[k, i] = c[i, 0] * right + c[i, 1] * front + c[i, 2] * up
        out[k, 2] -= gravity
    return out


@njit(cache=True)
def by_quaternion(force: np.ndarray, quaternion: np.ndarray, gravity: float) -> np.ndarray:
    """Acceleration a_t = q f q* - (0, 0, gravity) of each row, (N, 3), east, north, up.

    force: (N, 3), specific force; quaternion: (N, 4), earth <- body with z up, scalar last, unit.
    """
    n = len(force)
    out = np.empty((n, 3))
    for k in range(n):
        x, y, z, w = quaternion[k, 0], quaternion[k, 1], quaternion[k, 2], quaternion[k, 3]
        fx, fy, fz = force[k, 0], force[k, 1], force[k, 2]
        # v = f + 2 w (q x f) + 2 q x (q x f)
        cx, cy, cz = y * fz - z * fy, z * fx - x * fz, x * fy - y * fx
        out[k, 0] = fx + 2.0 * (w * cx + y * cz - z * cy)
        out[k, 1] = fy + 2.0 * (w * cy + z * cx - x * cz)
        out[k, 2] = fz + 2.0 * (w * cz + x * cy - y * cx) - gravity
    return out
