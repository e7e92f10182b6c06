"""The tilt-compensated compass and the quaternion Kalman filter as one compiled call.

Source: Chu et al. 2017, section 4. The bytes are those of `compass.measure` followed by
`filter.run`; for single samples one call in the place of two saves half the time.
"""

import math

import numpy as np
from numba import njit

from lodeflow_plugins.fusion.quaternion_kalman.filter import run
from lodeflow_plugins.fusion.tilt_compass.compass import attitude


@njit(cache=True)
def fuse(
    t: np.ndarray,
    rate: np.ndarray,
    specific_force: np.ndarray,
    field: np.ndarray,
    row: np.ndarray,
    gravity: float,
    tolerance: float,
    constants: np.ndarray,
    state: np.ndarray,
) -> tuple[int, np.ndarray]:
    """Attitude from angular rate, specific force and field; any split gives the same bytes.

    t: int64 (N,), stamps in ns, strictly increasing over all calls; rate: (N, 3), rad/s, FLU;
    specific_force: (N, 3), m/s^2, FLU; field: (M, 3), any unit, FLU.
    row: int64 (N,), the row of `field` that belongs to each stamp, or -1 for none.
    gravity, tolerance: m/s^2; a row corrects the estimate only while | |f| - gravity | is less
    than the tolerance, which is infinite for the filter of the paper.
    constants, state: of `filter.constants` and `filter.new_state`; state is written.

    Returns (first, quaternion): quaternion (N, 4), ENU <- FLU, scalar last, w >= 0, is written
    from the row `first` on; `first` is N as long as no row has started the filter.
    """
    n = len(t)
    measured = np.empty((n, 4))
    used = np.empty(n, np.int64)
    for k in range(n):
        fx, fy, fz = specific_force[k, 0], specific_force[k, 1], specific_force[k, 2]
        off = abs(math.sqrt(fx * fx + fy * fy + fz * fz) - gravity)
        used[k] = -1
        if row[k] >= 0 and off < tolerance:
            used[k] = k
            h = field[row[k]]
            _, q = attitude(fx, fy, fz, h[0], h[1], h[2])
            measured[k, 0], measured[k, 1], measured[k, 2], measured[k, 3] = q
    quaternion = np.empty((n, 4))
    first = run(t, rate, measured, used, constants, state, quaternion)
    return first, quaternion
