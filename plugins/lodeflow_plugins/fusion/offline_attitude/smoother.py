"""Attitude of a whole recording: the two stages forwards and backwards in time, put together.

A filter is late: what it makes of a turn or a disturbance comes after it. Run backwards it is late
the other way. The vertical is the mean of the two verticals. The heading is the mean of the two
headings on it, weighed with their variances, so that behind a disturbance the one counts that has
not passed it yet (two filters as a smoother: Fraser and Potter 1969, IEEE Trans. Autom. Control
14(4) 387-390; here both have seen the sample itself).
"""

from __future__ import annotations

import numpy as np

from lodeflow_plugins.fusion.heading_kalman import filter as heading
from lodeflow_plugins.fusion.inertial_attitude import filter as inertial


def smooth(
    t: np.ndarray,
    rate: np.ndarray,
    force: np.ndarray,
    field_t: np.ndarray,
    field: np.ndarray,
    inclination: np.ndarray,
    north: np.ndarray,
) -> np.ndarray:
    """Return the attitude, magnetic ENU <- body, (N, 4), unit quaternions, scalar last, w >= 0.

    t: int64 (N,), stamps in ns, with rate (N, 3), rad/s, and force (N, 3), m/s^2, in the body
    frame; field_t: int64 (M,), stamps in ns, with field (M, 3), tesla.
    inclination, north: constants of the two filters, for a report with each attitude and without
    an advance of the output.
    """
    level = levelled(t, rate, force, inclination)
    # Backwards, a turn leads from a sample to the one before: its rate is that of the former.
    turns = -np.concatenate([rate[-1:], rate[:0:-1]])
    mirrored = np.ascontiguousarray(-t[::-1])
    back = levelled(mirrored, turns, np.ascontiguousarray(force[::-1]), inclination)[::-1]
    level = product(upright(level, vertical(level) + vertical(back)), level)

    ahead, variance = headed(t, level, field_t, field, north)
    flipped = [np.ascontiguousarray(a[::-1]) for a in (level, -field_t, field)]
    back, back_variance = headed(mirrored, *flipped, north)
    back, back_variance = back[::-1], back_variance[::-1]
    between = product(back, ahead * [-1.0, -1.0, -1.0, 1.0])  # a turn about the vertical
    angle = np.arctan2(between[:, 2], between[:, 3])
    half = (angle - np.pi * np.round(angle / np.pi)) * variance / (variance + back_variance)
    nothing = np.zeros_like(half)
    out = product(np.stack([nothing, nothing, np.sin(half), np.cos(half)], axis=1), ahead)
    return np.where(out[:, 3:] < 0.0, -out, out)


def levelled(
    t: np.ndarray, rate: np.ndarray, force: np.ndarray, constants: np.ndarray
) -> np.ndarray:
    """Attitudes (N, 4) of the inclination filter."""
    n = len(t)
    attitude = np.empty((n, 4))
    spare = np.empty((n, 3)), np.empty((n, 3, 3)), *[np.empty(n, np.int64) for _ in range(3)]
    inertial.run(t, rate, force, inertial.new_state(constants), attitude, *spare)
    return attitude


def headed(
    t: np.ndarray,
    attitude: np.ndarray,
    field_t: np.ndarray,
    field: np.ndarray,
    constants: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:
    """Attitudes (N, 4) of the heading filter, and the variance of each heading (N,)."""
    stamps = np.union1d(t, field_t)
    rows = [np.full(len(stamps), -1) for _ in range(2)]
    for row, of in zip(rows, (t, field_t), strict=True):
        row[np.searchsorted(stamps, of)] = np.arange(len(of))
    n = len(t)
    out, believed, reports = (
        np.empty((n, 4)),
        np.empty((n, heading.REPORTED)),
        np.empty(n, np.int64),
    )
    state = heading.new_state(constants)
    heading.run(stamps, attitude, rows[0], field, rows[1], state, out, believed, reports)
    return out, believed[:, 0]


def product(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Quaternion products a b, (N, 4), normalised."""
    ax, ay, az, aw = a.T
    bx, by, bz, bw = b.T
    q = np.stack(
        [
            aw * bx + ax * bw + ay * bz - az * by,
            aw * by - ax * bz + ay * bw + az * bx,
            aw * bz + ax * by - ay * bx + az * bw,
            aw * bw - ax * bx - ay * by - az * bz,
        ],
        axis=1,
    )
    return q / np.linalg.norm(q, axis=1, keepdims=True)


def vertical(q: np.ndarray) -> np.ndarray:
    """The vertical in the body frame, (N, 3)."""
    x, y, z, w = q.T
    up = 2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)
    return np.stack(up, axis=1)


def upright(q: np.ndarray, up: np.ndarray) -> np.ndarray:
    """Least turns (N, 4) of the frames of q after which up (N, 3), in the body frame, is up."""
    axis, w = q[:, :3], q[:, 3:]
    twice = 2.0 * np.cross(axis, up)
    x, y, z = (up + w * twice + np.cross(axis, twice)).T
    # Half way between the vector and the vertical: (x, y, z) + |.| e_z, as a quaternion.
    turn = np.stack([y, -x, np.zeros_like(x), z + np.sqrt(x * x + y * y + z * z)], axis=1)
    turn[(turn == 0.0).all(axis=1), 3] = 1.0  # the two are opposite: no mean
    return turn / np.linalg.norm(turn, axis=1, keepdims=True)
