"""Counting the runs of samples in which the foot does not move.

Source: the step counter printed with Liu et al. 2018, Geomatics and Information Science of Wuhan
University 43(4), Eq. 3 and steps (3) and (4): a sample is still where its value lies between two
thresholds; a run of still samples shorter than a tenth of a second is a chance in mid-swing and
is dropped; each run that is left is one stance of the foot, hence one step. The run in which a
recording begins is standing, not stepping. Closing short gaps before runs are measured is not in
the paper.
"""

import math

import numpy as np
from numba import njit

# The state of `count`, int64.
STARTED = 0
FIRST = 1  # stamp of the first sample
SAMPLES = 2
RUN = 3  # samples of the run that is going on, closed gaps included; 0 for none
BEGIN = 4  # stamp of its first sample
GAP = 5  # samples since its last still one
COUNTED = 6  # the run has been told
RUNS = 7  # runs told so far
STATE_SIZE = 8


def new_state() -> np.ndarray:
    """State of a counter that has seen nothing, int64 (8,)."""
    return np.zeros(STATE_SIZE, np.int64)


def samples_of(duration: float, rate: float) -> int:
    """The least number of samples that is not shorter than a duration (s) at a rate (Hz)."""
    return math.ceil(duration * rate - 1e-9)


@njit(cache=True)
def count(
    t: np.ndarray,
    value: np.ndarray,
    lower: float,
    upper: float,
    shortest: int,
    closes: int,
    settle: int,
    state: np.ndarray,
    row: np.ndarray,
    moment: np.ndarray,
) -> int:
    """Find the runs of still samples, each as soon as it is long enough.

    t: int64 (N,), stamps in ns; value: (N,), still where lower < value < upper.
    shortest: samples of the shortest run that counts. closes: gaps of fewer samples are part of
    the run around them; 0 for none. settle: runs that begin less than so many ns after the first
    sample do not count.
    state: of `new_state()`, written. Any split into blocks gives the same.
    row, moment: int64 (N,), written: at which row a run became long enough, and the stamp of its
    first sample.

    Returns the number of runs found. The first of the block is number state[RUNS] - found + 1.
    """
    found = 0
    for k in range(len(t)):
        if state[STARTED] == 0:
            state[STARTED] = 1
            state[FIRST] = t[k]
        state[SAMPLES] += 1
        if not lower < value[k] < upper:
            if state[RUN] > 0:
                state[GAP] += 1
                if state[GAP] >= closes:
                    state[RUN] = 0
            continue
        if state[RUN] == 0:
            state[BEGIN] = t[k]
            state[COUNTED] = 0
            state[GAP] = 0
        state[RUN] += 1 + state[GAP]
        state[GAP] = 0
        if state[COUNTED] == 0 and state[RUN] >= shortest:
            state[COUNTED] = 1
            if state[BEGIN] - state[FIRST] >= settle:
                state[RUNS] += 1
                row[found] = k
                moment[found] = state[BEGIN]
                found += 1
    return found
