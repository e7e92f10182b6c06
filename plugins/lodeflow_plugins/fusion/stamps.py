"""The stamp of the last row in the state of a compiled filter.

A float64 cannot hold nanoseconds since 1970: the first two numbers of the state are whole seconds
and nanoseconds.
"""

import numpy as np

from lodeflow_plugins.fusion.rotations import inlined

SECOND = 1_000_000_000
SECONDS, NANOSECONDS = 0, 1


@inlined
def stamp_of(state: np.ndarray) -> int:
    """Return the stamp, ns."""
    return np.int64(state[SECONDS]) * SECOND + np.int64(state[NANOSECONDS])


@inlined
def keep_stamp(t: int, state: np.ndarray) -> None:
    """Set the stamp, ns."""
    state[SECONDS], state[NANOSECONDS] = t // SECOND, t % SECOND
