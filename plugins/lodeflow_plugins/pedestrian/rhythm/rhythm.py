"""Steps from the autocorrelation of a signal: how often the last seconds repeat themselves."""

import math

import numpy as np
from numba import njit


@njit(cache=True)
def period(window: np.ndarray, shortest: int, longest: int, least: float, quiet: float) -> float:
    """Lag, in samples, at which a signal repeats itself best; 0 where it does not.

    window: (W,). shortest, longest: the lags that are looked at, both included. least: smallest
    correlation coefficient that counts. quiet: a signal whose standard deviation is below it has
    no rhythm. The lag is the highest local maximum of the correlation between the window and
    itself, shifted, over the part that both have, and is refined by a parabola.
    """
    n = len(window)
    total = 0.0
    for value in window:
        total += value
    mean = total / n
    power = 0.0
    for value in window:
        power += (value - mean) ** 2
    if power < quiet * quiet * n:
        return 0.0
    before, here = 0.0, _correlation(window, mean, shortest - 1)
    after = _correlation(window, mean, shortest)
    best, lag = least, 0.0
    for shift in range(shortest, longest + 1):
        before, here, after = here, after, _correlation(window, mean, shift + 1)
        if here > best and here >= before and here > after:
            best = here
            lag = shift + 0.5 * (after - before) / (2.0 * here - before - after)
    return lag


@njit(cache=True)
def _correlation(window: np.ndarray, mean: float, shift: int) -> float:
    both = one = other = 0.0
    for k in range(len(window) - shift):
        a, b = window[k] - mean, window[k + shift] - mean
        both += a * b
        one += a * a
        other += b * b
    return both / math.sqrt(one * other) if one > 0.0 and other > 0.0 else 0.0


# The state of `count`, float64: samples so far, the steps so far as a fraction, and then a ring.
SEEN, STEPS, RING = 0, 1, 2


def new_state(window: int) -> np.ndarray:
    """State of a counter that has seen nothing, float64 (2 + window,)."""
    return np.zeros(RING + window)


@njit(cache=True)
def count(
    vector: np.ndarray,
    hop: int,
    lags: np.ndarray,
    limits: np.ndarray,
    state: np.ndarray,
    row: np.ndarray,
    times: np.ndarray,
) -> int:
    """Add hop / period to the number of steps after each hop; report where it passes an integer.

    vector: (N, 3), whose norm is the signal. hop: samples. lags: int64 (2,), shortest and longest.
    limits: (2,), least correlation and quiet level, as for `period`. state: written.
    row, times: int64 (N,), written: the rows at which steps were found, and how many.

    Returns the number of such rows.
    """
    size = len(state) - RING
    found = 0
    window = np.empty(size)
    for k in range(len(vector)):
        x, y, z = vector[k, 0], vector[k, 1], vector[k, 2]
        seen = int(state[SEEN])
        state[RING + seen % size] = math.sqrt(x * x + y * y + z * z)
        state[SEEN] = seen = seen + 1
        if seen < size or seen % hop:
            continue
        for j in range(size):
            window[j] = state[RING + (seen + j) % size]
        lag = period(window, lags[0], lags[1], limits[0], limits[1])
        if lag > 0.0:
            before = math.floor(state[STEPS])
            # The first window brings along all of the steps in it.
            state[STEPS] += (size if seen - size < hop else hop) / lag
            more = math.floor(state[STEPS]) - before
            if more > 0:
                row[found] = k
                times[found] = more
                found += 1
    return found
