"""Swings of the foot between two stances, told apart by ratio instead of by threshold.

How much the foot moves is one number for each sample,

    m = sqrt( |a|^2 + (c |w|)^2 )

from the acceleration a without gravity and the angular rate w. In a stance both are small at
once; in a swing at least one of them is large, also where the other crosses zero. Its logarithm,
smoothed a little, falls into each stance and rises into each swing by about the same height
whether the walker strolls or runs, although the values themselves differ by a factor of 30: in a
stride of a runner the foot never comes to rest, but it moves several times less than in the
swing. So a swing is a rise of log m by log(ratio) followed by a fall by log(ratio).
"""

import math

import numpy as np
from numba import njit

from lodeflow_plugins.filtering import smoothing

# The state of `count`, float64: as in peaks; the stamps, int64: of the height of the swing and
# of the sample at which the rise was certain.
STARTED, RISEN, EXTREME = 0, 1, 2
STATE_SIZE = 3
HIGHEST, RISE = 0, 1
STAMPS_SIZE = 2


def new_state() -> tuple[np.ndarray, np.ndarray]:
    """State of a counter that has seen nothing: float64 (3,) and int64 (2,)."""
    return np.zeros(STATE_SIZE), np.zeros(STAMPS_SIZE, np.int64)


@njit(cache=True)
def count(
    t: np.ndarray,
    acceleration: np.ndarray,
    rate: np.ndarray,
    constants: np.ndarray,
    weights: np.ndarray,
    shortest: int,
    ring: np.ndarray,
    ring_stamps: np.ndarray,
    seen: np.ndarray,
    state: np.ndarray,
    stamps: np.ndarray,
    row: np.ndarray,
    moment: np.ndarray,
) -> int:
    """Find the swings, each when the foot has landed.

    t: int64 (N,), stamps in ns; acceleration: (N, 3), without gravity, m/s^2; rate: (N, 3),
    rad/s.
    constants: (3,): c (m/s^2 per rad/s), the m below which all is rest (m/s^2), log(ratio).
    weights: of `smoothing`; shortest: least time between rise and fall of a swing, ns.
    ring, ring_stamps, seen, state, stamps: of `smoothing.new_state()` and `new_state()`, written.
    row, moment: int64 (N,), written: the row at which a swing was over, and the stamp of its
    height.

    Returns the number of swings found.
    """
    c, floor, step = constants[0], constants[1], constants[2]
    found = 0
    for k in range(len(t)):
        ax, ay, az = acceleration[k, 0], acceleration[k, 1], acceleration[k, 2]
        wx, wy, wz = rate[k, 0], rate[k, 1], rate[k, 2]
        square = ax * ax + ay * ay + az * az + c * c * (wx * wx + wy * wy + wz * wz)
        level = 0.5 * math.log(max(square, floor * floor))
        value, at = smoothing.push(t[k], level, weights, ring, ring_stamps, seen)
        if state[STARTED] == 0.0:
            state[STARTED] = 1.0
            state[EXTREME] = value
        if state[RISEN] == 0.0:
            state[EXTREME] = min(state[EXTREME], value)
            if value > state[EXTREME] + step:
                state[RISEN] = 1.0
                state[EXTREME] = value
                stamps[HIGHEST] = stamps[RISE] = at
        elif value > state[EXTREME]:
            state[EXTREME] = value
            stamps[HIGHEST] = at
        elif value < state[EXTREME] - step:
            state[RISEN] = 0.0
            state[EXTREME] = value
            if at - stamps[RISE] >= shortest:
                row[found] = k
                moment[found] = stamps[HIGHEST]
                found += 1
    return found
