"""`filter.run` and `fuse.fuse` on one row, in the shapes of one sample.

Live, the way into a compiled function costs more than the filter: fewer and simpler arguments
save a third of a step. The bytes are those of a block of one row.
"""

import numpy as np
from numba import njit

from lodeflow_plugins.fusion.quaternion_kalman.filter import run
from lodeflow_plugins.fusion.quaternion_kalman.fuse import fuse


@njit(cache=True)
def run_one(
    t: int,
    rate: np.ndarray,
    measured: np.ndarray,
    row: int,
    constants: np.ndarray,
    state: np.ndarray,
) -> tuple[int, np.ndarray]:
    """`filter.run` on a row: rate (3,), measured (4,), row 0, or -1 for no measurement.

    Returns (first, quaternion): quaternion (4,) is the estimate if first is 0.
    """
    quaternion = np.empty((1, 4))
    stamps, rows = np.empty(1, np.int64), np.empty(1, np.int64)
    stamps[0], rows[0] = t, row
    first = run(
        stamps,
        rate.reshape(1, 3),
        measured.reshape(1, 4),
        rows,
        constants,
        state,
        quaternion,
    )
    return first, quaternion[0]


@njit(cache=True)
def fuse_one(
    t: int,
    rate: np.ndarray,
    specific_force: np.ndarray,
    field: np.ndarray,
    row: int,
    gravity: float,
    tolerance: float,
    constants: np.ndarray,
    state: np.ndarray,
) -> tuple[int, np.ndarray]:
    """`fuse.fuse` on a row: rate, specific_force and field (3,), row 0, or -1 for no field.

    Returns (first, quaternion): quaternion (4,) is the estimate if first is 0.
    """
    stamps, rows = np.empty(1, np.int64), np.empty(1, np.int64)
    stamps[0], rows[0] = t, row
    first, quaternion = fuse(
        stamps,
        rate.reshape(1, 3),
        specific_force.reshape(1, 3),
        field.reshape(1, 3),
        rows,
        gravity,
        tolerance,
        constants,
        state,
    )
    return first, quaternion[0]
