"""Attitude error of an estimate against the truth, split into heading and inclination.

Source: Laidig, Caruso, Cereatti, Seel 2021, BROAD - A Benchmark for Robust Inertial Orientation
Estimation, Data 6(7):72, doi 10.3390/data6070072; the error of a trial is the root mean square
over the samples in motion, and no heading offset is removed.

With the error e = q_estimate q_truth* in the earth frame, whose z axis is vertical:

    total       2 acos |e_w|                    the angle between the two attitudes
    heading     2 atan |e_z / e_w|              its part about the vertical
    inclination 2 acos sqrt(e_w^2 + e_z^2)      the angle between the two verticals
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numba import njit

# The state of `accumulate`: rows that count, rows among them without an estimate, then the sums
# of squares and the maxima of total, heading and inclination.
ROWS = 0
MISSING = 1
SQUARES = 2
MAXIMA = 5
STATE_SIZE = 8


@dataclass(frozen=True)
class Score:
    """Errors over a run, in rad; rmse and maximum of total, heading and inclination.

    rows: number of rows that count; missing: those of them whose estimate is NaN. One missing
    row makes all figures NaN, and so does a run without rows.
    """

    rows: int
    missing: int
    total_rmse: float
    heading_rmse: float
    inclination_rmse: float
    total_max: float
    heading_max: float
    inclination_max: float


def new_state() -> np.ndarray:
    """State of a score that has seen nothing, float64 (8,)."""
    return np.zeros(STATE_SIZE)


@njit(cache=True)
def errors(estimate: np.ndarray, truth: np.ndarray) -> np.ndarray:
    """Total, heading and inclination error of each row, (N, 3), rad, not negative.

    estimate, truth: (N, 4), unit quaternions, scalar last, earth <- body with z vertical. NaN in
    either gives NaN. The arcs are taken as atan2, which for unit quaternions is the same as acos
    and stays exact near zero.
    """
    n = len(estimate)
    angles = np.empty((n, 3))
    for k in range(n):
        ax, ay, az, aw = estimate[k, 0], estimate[k, 1], estimate[k, 2], estimate[k, 3]
        bx, by, bz, bw = truth[k, 0], truth[k, 1], truth[k, 2], truth[k, 3]
        x = ax * bw - aw * bx - ay * bz + az * by
        y = ay * bw - aw * by - az * bx + ax * bz
        z = az * bw - aw * bz - ax * by + ay * bx
        w = aw * bw + ax * bx + ay * by + az * bz
        angles[k, 0] = 2.0 * math.atan2(math.sqrt(x * x + y * y + z * z), abs(w))
        angles[k, 1] = 2.0 * math.atan2(abs(z), abs(w))
        angles[k, 2] = 2.0 * math.atan2(math.sqrt(x * x + y * y), math.sqrt(w * w + z * z))
    return angles


@njit(cache=True)
def accumulate(
    estimate: np.ndarray, truth: np.ndarray, movement: np.ndarray, state: np.ndarray
) -> None:
    """Add the rows of a block to the state; any split into blocks gives the same bytes.

    estimate, truth: (N, 4), as for `errors`; movement: (N,). A row counts where movement is 1
    and the truth has no NaN.
    """
    angles = errors(estimate, truth)
    for k in range(len(angles)):
        truth_sum = truth[k, 0] + truth[k, 1] + truth[k, 2] + truth[k, 3]
        if movement[k] != 1 or math.isnan(truth_sum):
            continue
        state[ROWS] += 1.0
        if math.isnan(angles[k, 0]):
            state[MISSING] += 1.0
            continue
        for i in range(3):
            # One after the other: numpy's pairwise sum would depend on the blocks.
            state[SQUARES + i] += angles[k, i] * angles[k, i]
            state[MAXIMA + i] = max(state[MAXIMA + i], angles[k, i])


def score(state: np.ndarray) -> Score:
    """The score of all rows accumulated in state."""
    rows, missing = int(state[ROWS]), int(state[MISSING])
    if rows == 0 or missing:
        return Score(rows, missing, *[math.nan] * 6)
    rmse = np.sqrt(state[SQUARES : SQUARES + 3] / rows)
    return Score(rows, missing, *rmse.tolist(), *state[MAXIMA : MAXIMA + 3].tolist())
