"""Tilt-compensated compass: attitude from one accelerometer and one magnetometer reading.

Source: Chu et al. 2017, Magnetic orientation system based on magnetometer, accelerometer and
gyroscope, CAAI Transactions on Intelligence Technology 2(4), Eqs. 1, 2, 9, 10, 27 and 30.

The paper mixes two body frames, and so does this file, on purpose and only here:

- the field h^b is in FRD (x forward, y right, z down), the earth frame is magnetic NED;
- A^b (Table 2) is the specific force in FLU (x forward, y left, z up), which is lodeflow's own
  body frame. At rest and level A^b = (0, 0, +g). With it Eqs. 9 and 10 need no extra sign.

Heading, pitch and roll are the Z-Y-X Euler angles from NED to FRD. Everything is compiled row by
row, so the bits of a row do not depend on how many rows come with it.
"""

import math

import numpy as np
from numba import njit

SQRT_HALF = math.sqrt(0.5)
TURN = 2.0 * math.pi

# q_enu_flu = r (x) q_ned_frd (x) s, where r turns NED into ENU (180 degrees about the bisector of
# the first two axes) and s turns FLU into FRD (180 degrees about x), as one matrix. It is
# orthogonal and symmetric, so the same matrix leads back.
SWAP_QUATERNION = SQRT_HALF * np.array(
    [[1.0, 1.0, 0.0, 0.0], [1.0, -1.0, 0.0, 0.0], [0.0, 0.0, -1.0, 1.0], [0.0, 0.0, 1.0, 1.0]]
)
SWAP_BODY = np.array([1.0, -1.0, -1.0])


def swap_body(vector: np.ndarray) -> np.ndarray:
    """Turn body vectors (..., 3) from FLU into FRD, or from FRD into FLU."""
    return vector * SWAP_BODY


def swap_quaternion(quaternion: np.ndarray) -> np.ndarray:
    """Turn quaternions (..., 4) from NED <- FRD into ENU <- FLU, or back. The sign is kept."""
    return (SWAP_QUATERNION @ quaternion[..., None])[..., 0]


@njit(cache=True)
def wrap(angle: float) -> float:
    """The angle in [0, 2 pi), rad."""
    angle %= TURN
    return angle if angle < TURN else 0.0  # -1e-17 + 2 pi rounds to a full turn


@njit(cache=True)
def tilt(forward: float, left: float, up: float) -> tuple[float, float]:
    """Pitch and roll in rad from the specific force A^b, of which only the direction counts.

    Chu et al. 2017, Eqs. 9 and 10. Eq. 10 has to be atan2, or attitudes with the z axis up are
    lost. At a pitch of +-90 degrees roll is undefined, and heading and roll are not separable.
    """
    return math.atan2(forward, math.sqrt(left * left + up * up)), math.atan2(left, up)


@njit(cache=True)
def heading(hx: float, hy: float, hz: float, pitch: float, roll: float) -> float:
    """Magnetic heading in rad, in [0, 2 pi), from the field in FRD. Chu et al. 2017, Eqs. 1, 2."""
    sin_pitch, cos_pitch = math.sin(pitch), math.cos(pitch)
    sin_roll, cos_roll = math.sin(roll), math.cos(roll)
    north = hx * cos_pitch + (hy * sin_roll + hz * cos_roll) * sin_pitch
    east = hy * cos_roll - hz * sin_roll
    return wrap(math.atan2(-east, north))


@njit(cache=True)
def quaternion_from_euler(
    heading: float, pitch: float, roll: float
) -> tuple[float, float, float, float]:
    """Quaternion (x, y, z, w), NED <- FRD, from Euler angles in rad. Chu et al. 2017, Eq. 27."""
    s3, c3 = math.sin(0.5 * heading), math.cos(0.5 * heading)
    s2, c2 = math.sin(0.5 * pitch), math.cos(0.5 * pitch)
    s1, c1 = math.sin(0.5 * roll), math.cos(0.5 * roll)
    return (
        s1 * c2 * c3 - c1 * s2 * s3,
        c1 * s2 * c3 + s1 * c2 * s3,
        c1 * c2 * s3 - s1 * s2 * c3,
        c1 * c2 * c3 + s1 * s2 * s3,
    )


@njit(cache=True)
def euler_from_quaternion(q1: float, q2: float, q3: float, q4: float) -> tuple[float, float, float]:
    """Heading in (-pi, pi], pitch and roll in rad from a quaternion NED <- FRD, scalar last.

    Chu et al. 2017, Eq. 30 (with the cubes of its print read as squares).
    """
    sin_pitch = 2.0 * (q4 * q2 - q1 * q3)
    return (
        math.atan2(2.0 * (q4 * q3 + q1 * q2), 1.0 - 2.0 * (q2 * q2 + q3 * q3)),
        math.asin(min(1.0, max(-1.0, sin_pitch))),  # rounding may step past 1
        math.atan2(2.0 * (q4 * q1 + q2 * q3), 1.0 - 2.0 * (q1 * q1 + q2 * q2)),
    )


@njit(cache=True)
def attitude(
    fx: float, fy: float, fz: float, hx: float, hy: float, hz: float
) -> tuple[tuple[float, float, float], tuple[float, float, float, float]]:
    """Euler angles and quaternion of one row, as `measure` has them, from f and h in FLU."""
    pitch, roll = tilt(fx, fy, fz)
    psi = heading(hx, -hy, -hz, pitch, roll)
    q1, q2, q3, q4 = quaternion_from_euler(psi, pitch, roll)
    scale = SQRT_HALF if q4 + q3 >= 0.0 else -SQRT_HALF  # q and -q are one attitude
    quaternion = (  # the rows of SWAP_QUATERNION
        scale * (q1 + q2),
        scale * (q1 - q2),
        scale * (q4 - q3),
        scale * (q4 + q3),
    )
    return (psi, pitch, roll), quaternion


@njit(cache=True)
def measure(specific_force: np.ndarray, field: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Attitude of each row from its specific force and its magnetic field, both in FLU.

    specific_force: (N, 3), any unit; field: (N, 3), any unit. Rows with non-gravitational
    acceleration give a wrong attitude: this is a measurement, not an estimate.

    Returns (euler, quaternion): euler (N, 3) is heading in [0, 2 pi), pitch and roll in rad from
    magnetic NED to FRD; quaternion (N, 4), scalar last with w >= 0, turns FLU into magnetic ENU.
    """
    n = len(specific_force)
    euler = np.empty((n, 3))
    quaternion = np.empty((n, 4))
    for k in range(n):
        f, h = specific_force[k], field[k]
        angles, q = attitude(f[0], f[1], f[2], h[0], h[1], h[2])
        euler[k, 0], euler[k, 1], euler[k, 2] = angles
        quaternion[k, 0], quaternion[k, 1], quaternion[k, 2], quaternion[k, 3] = q
    return euler, quaternion


@njit(cache=True)
def euler(quaternion: np.ndarray) -> np.ndarray:
    """Heading in [0, 2 pi), pitch and roll in rad, (N, 3), of quaternions ENU <- FLU, (N, 4).

    The Euler angles are those of NED and FRD, as `measure` gives them.
    """
    n = len(quaternion)
    angles = np.empty((n, 3))
    for k in range(n):
        x, y, z, w = quaternion[k, 0], quaternion[k, 1], quaternion[k, 2], quaternion[k, 3]
        psi, pitch, roll = euler_from_quaternion(
            SQRT_HALF * (x + y), SQRT_HALF * (x - y), SQRT_HALF * (w - z), SQRT_HALF * (w + z)
        )
        angles[k, 0], angles[k, 1], angles[k, 2] = wrap(psi), pitch, roll
    return angles
