"""Test statistics of zero-velocity detectors, over a sliding window that ends at each sample.

With the specific force a, its mean over the window m, the angular rate w, and gravity g:

    SHOE  mean( |a - g m/|m||^2 / sigma_a^2 + |w|^2 / sigma_w^2 )
    ARED  mean( |w|^2 )
    AMVD  mean( |a - m|^2 )
    MAG   mean( (|a| - g)^2 )

Source: Skog, Handel, Nilsson, Rantakokko 2010, Zero-Velocity Detection - An Algorithm
Evaluation, IEEE Transactions on Biomedical Engineering 57(11), 2657-2666.
"""

import math

import numpy as np
from numba import njit

SHOE, ARED, AMVD, MAG = 0, 1, 2, 3


def new_state(window: int) -> np.ndarray:
    """State before the first sample: (window + 1, 6), a ring of samples, and how many came."""
    return np.zeros((window + 1, 6))


@njit(cache=True)
def norms(vectors: np.ndarray) -> np.ndarray:
    """The norm of each row, (N,), of (N, 3)."""
    out = np.empty(len(vectors))
    for k in range(len(vectors)):
        x, y, z = vectors[k, 0], vectors[k, 1], vectors[k, 2]
        out[k] = math.sqrt(x * x + y * y + z * z)
    return out


@njit(cache=True)
def statistic(
    kind: int,
    force: np.ndarray,
    rate: np.ndarray,
    constants: np.ndarray,
    state: np.ndarray,
    out: np.ndarray,
) -> None:
    """Write the statistic of each row into out (N,), infinity until the window is full.

    kind: SHOE, ARED, AMVD or MAG. force, rate: (N, 3), m/s^2 and rad/s.
    constants: (3,), gravity (m/s^2), sigma_a (m/s^2) and sigma_w (rad/s).
    state: of `new_state()`, written; sums are taken anew over each window, so that any split
    into blocks gives the same bytes.
    """
    gravity, sigma_a, sigma_w = constants[0], constants[1], constants[2]
    window = len(state) - 1
    for k in range(len(force)):
        seen = int(state[window, 0])
        slot = seen % window
        for i in range(3):
            state[slot, i] = force[k, i]
            state[slot, 3 + i] = rate[k, i]
        state[window, 0] = seen + 1
        if seen + 1 < window:
            out[k] = math.inf
            continue
        mx = my = mz = 0.0
        for j in range(1, window + 1):  # from the oldest on
            s = (slot + j) % window
            mx += state[s, 0]
            my += state[s, 1]
            mz += state[s, 2]
        mx, my, mz = mx / window, my / window, mz / window
        scale = 1.0
        if kind == SHOE:
            scale = gravity / math.sqrt(mx * mx + my * my + mz * mz)
        total = 0.0
        for j in range(1, window + 1):
            s = (slot + j) % window
            ax, ay, az = state[s, 0], state[s, 1], state[s, 2]
            wx, wy, wz = state[s, 3], state[s, 4], state[s, 5]
            turning = wx * wx + wy * wy + wz * wz
            if kind == ARED:
                total += turning
            elif kind == MAG:
                excess = math.sqrt(ax * ax + ay * ay + az * az) - gravity
                total += excess * excess
            else:
                dx, dy, dz = ax - scale * mx, ay - scale * my, az - scale * mz
                moving = dx * dx + dy * dy + dz * dz
                if kind == SHOE:
                    moving = moving / (sigma_a * sigma_a) + turning / (sigma_w * sigma_w)
                total += moving
        out[k] = total / window
