"""Peaks of a smoothed signal, as it goes.

A peak counts when the smooth signal has risen to it by the prominence and has fallen from it by
the prominence, which are the peaks that a search by prominence over the whole record finds as
well. A peak closer to the last one than the distance does not count.
"""

import numpy as np
from numba import njit

from lodeflow_plugins.filtering import smoothing

# The state of `count`, float64, beside that of the smoothing.
STARTED = 0
RISEN = 1  # the signal has risen by the prominence since its last low
EXTREME = 2  # the highest value since then, or the lowest before
STATE_SIZE = 3
# And int64: stamp of the highest value, stamp of the last peak, whether there was one.
HIGHEST, LAST, ANY = 0, 1, 2
STAMPS_SIZE = 3


def new_state() -> tuple[np.ndarray, np.ndarray]:
    """State of a counter that has seen nothing: float64 (3,) and int64 (3,)."""
    return np.zeros(STATE_SIZE), np.zeros(STAMPS_SIZE, np.int64)


@njit(cache=True)
def count(
    t: np.ndarray,
    vector: np.ndarray,
    weights: np.ndarray,
    prominence: float,
    distance: int,
    ring: np.ndarray,
    ring_stamps: np.ndarray,
    seen: np.ndarray,
    state: np.ndarray,
    stamps: np.ndarray,
    row: np.ndarray,
    moment: np.ndarray,
) -> int:
    """Find the peaks of the smoothed norm of a vector.

    t: int64 (N,), stamps in ns; vector: (N, 3); weights: of `smoothing`; prominence: in the unit
    of the vector; distance: least time between two peaks, ns.
    ring, ring_stamps, seen, state, stamps: of `smoothing.new_state()` and `new_state()`, written.
    row, moment: int64 (N,), written: the row at which a peak was certain, and its own stamp.

    Returns the number of peaks found.
    """
    found = 0
    for k in range(len(t)):
        x, y, z = vector[k, 0], vector[k, 1], vector[k, 2]
        norm = np.sqrt(x * x + y * y + z * z)
        value, at = smoothing.push(t[k], norm, weights, ring, ring_stamps, seen)
        if state[STARTED] == 0.0:
            state[STARTED] = 1.0
            state[EXTREME] = value
        if state[RISEN] == 0.0:
            state[EXTREME] = min(state[EXTREME], value)
            if value >= state[EXTREME] + prominence:
                state[RISEN] = 1.0
                state[EXTREME] = value
                stamps[HIGHEST] = at
        elif value > state[EXTREME]:
            state[EXTREME] = value
            stamps[HIGHEST] = at
        elif value <= state[EXTREME] - prominence:
            state[RISEN] = 0.0
            state[EXTREME] = value
            peak = stamps[HIGHEST]
            if stamps[ANY] == 0 or peak - stamps[LAST] >= distance:
                stamps[LAST] = peak
                stamps[ANY] = 1
                row[found] = k
                moment[found] = peak
                found += 1
    return found
