"""The inclination filter and the heading filter as one compiled call.

The bytes are those of `inertial_attitude.filter.run` followed by `heading_kalman.filter.run`. One
after the other in each row, the two keep the processor busier than in two loops.
"""

import numpy as np

from lodeflow_plugins.fusion.heading_kalman import filter as heading
from lodeflow_plugins.fusion.inertial_attitude import filter as inertial
from lodeflow_plugins.fusion.rotations import kernel
from lodeflow_plugins.fusion.stamps import keep_stamp, stamp_of

INCLINATION = inertial.STATE_SIZE


def new_state(inclination: np.ndarray, north: np.ndarray) -> np.ndarray:
    """State of filters that have seen nothing; arguments: the constants of the two."""
    return np.concatenate([inertial.new_state(inclination), heading.new_state(north)])


@kernel
def fuse(
    t: np.ndarray,
    rate: np.ndarray,
    force: np.ndarray,
    imu_row: np.ndarray,
    field: np.ndarray,
    field_row: np.ndarray,
    state: np.ndarray,
    out: np.ndarray,
) -> None:
    """Take the rows of a block; any split into blocks gives the same bytes.

    t: int64 (N,), stamps in ns, strictly increasing over all calls.
    rate: (M, 3), rad/s, and force: (M, 3), specific force, m/s^2, in the body frame; imu_row:
    int64 (N,), which of them belongs to each stamp, or -1. field: (F, 3), tesla, in the body
    frame, and field_row alike.
    state: of `new_state`; written, as is out (M, 4), magnetic ENU <- body, scalar last, w >= 0.
    """
    level, north = state[:INCLINATION], state[INCLINATION:]
    if len(t) == 0:
        return
    last_imu, last = stamp_of(level), heading.first_or_last(t[0], north)
    q, m = (0.0, 0.0, 0.0, 1.0), (0.0, 0.0, 0.0)
    for k in range(len(t)):
        i, f = imu_row[k], field_row[k]
        if i >= 0:
            w = rate[i, 0], rate[i, 1], rate[i, 2]
            q = inertial.take(t[k] - last_imu, w, (force[i, 0], force[i, 1], force[i, 2]), level)
            last_imu = t[k]
        if f >= 0:
            m = field[f, 0], field[f, 1], field[f, 2]
        turned = heading.take(t[k] - last, i >= 0, q, f >= 0, m, north)
        last = t[k]
        if i >= 0:
            out[i, 0], out[i, 1], out[i, 2], out[i, 3] = turned
    keep_stamp(last_imu, level)
    keep_stamp(last, north)


@kernel
def fuse_one(
    t: int,
    rate: np.ndarray,
    force: np.ndarray,
    has_field: bool,
    field: np.ndarray,
    state: np.ndarray,
    out: np.ndarray,
) -> None:
    """`fuse` on one row with a rate, force and perhaps field (3,); out: (4,)."""
    level, north = state[:INCLINATION], state[INCLINATION:]
    w, f = (rate[0], rate[1], rate[2]), (force[0], force[1], force[2])
    q = inertial.take(t - stamp_of(level), w, f, level)
    keep_stamp(t, level)
    interval, m = t - heading.first_or_last(t, north), (field[0], field[1], field[2])
    out[0], out[1], out[2], out[3] = heading.take(interval, True, q, has_field, m, north)
    keep_stamp(t, north)
