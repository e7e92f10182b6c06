"""Smoothing by a symmetric window, sample by sample, with the delay of half the window."""

import math

import numpy as np
from numba import njit

DECAYS = 5.0
"""Time constants after which the kernel of a low-pass ends; 0.7 % of it are left there."""


def reach(cutoff: float) -> float:
    """Half the length in s of the kernel of a low-pass, which is its delay."""
    return DECAYS / (math.sqrt(2.0) * math.pi * cutoff)


def low_pass(cutoff: float, rate: float) -> np.ndarray:
    """Weights of a low-pass without phase, of odd length, their sum 1.

    A Butterworth filter of second order, run forwards and backwards, has the gain
    1 / (1 + (f / cutoff)^4); the kernel is its impulse response,
    exp(-a |t|) (cos a t + sin a |t|) with a = sqrt(2) pi cutoff.

    cutoff: frequency at which the gain is 1/2, Hz; rate: of the samples, Hz.
    """
    a = math.sqrt(2.0) * math.pi * cutoff
    half = math.ceil(reach(cutoff) * rate)
    phase = a * np.abs(np.arange(-half, half + 1)) / rate
    return _normal(np.exp(-phase) * (np.cos(phase) + np.sin(phase)))


def hann(duration: float, rate: float) -> np.ndarray:
    """Weights of a Hann window of a duration (s) at a rate (Hz), of odd length, their sum 1."""
    half = max(0, round(0.5 * duration * rate))
    return _normal(np.cos(0.5 * np.pi * np.arange(-half, half + 1) / (half + 1)) ** 2)


def _normal(weights: np.ndarray) -> np.ndarray:
    return weights / weights.sum()


def new_state(weights: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """State of `push` before the first sample: values (2n,), stamps (n,), samples so far (1,).

    Each value stands twice, n apart, so that the last n are always in one piece.
    """
    n = len(weights)
    return np.zeros(2 * n), np.zeros(n, np.int64), np.zeros(1, np.int64)


@njit(cache=True)
def _weighted(weights: np.ndarray, values: np.ndarray, first: int) -> float:
    """The weighted sum of the values from `first` on, always taken in this order.

    Four sums at a time, because a processor need not wait for one to begin the next.
    """
    n = len(weights)
    a = b = c = d = 0.0
    whole = n - n % 4
    for j in range(0, whole, 4):
        a += weights[j] * values[first + j]
        b += weights[j + 1] * values[first + j + 1]
        c += weights[j + 2] * values[first + j + 2]
        d += weights[j + 3] * values[first + j + 3]
    for j in range(whole, n):
        a += weights[j] * values[first + j]
    return (a + b) + (c + d)


@njit(cache=True)
def push(
    t: int,
    value: float,
    weights: np.ndarray,
    ring: np.ndarray,
    stamps: np.ndarray,
    seen: np.ndarray,
) -> tuple[float, int]:
    """Take a sample; return the smooth value half a window ago, and the stamp that it belongs to.

    Before the first sample everything was as it is there. weights: (n,), n odd; ring, stamps,
    seen: of `new_state()`, written. The sum is taken in one order, so blocks do not matter.
    """
    n = len(weights)
    if seen[0] == 0:
        ring[:] = value
        stamps[:] = t
    slot = seen[0] % n
    ring[slot] = ring[slot + n] = value
    stamps[slot] = t
    seen[0] += 1
    first = slot + 1
    return _weighted(weights, ring, first), stamps[(first + n // 2) % n]


def new_columns(weights: np.ndarray, columns: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """State of `smooth`: columns (C, 2n), stamps (n,), and how many rows came (1,)."""
    n = len(weights)
    return np.zeros((columns, 2 * n)), np.zeros(n, np.int64), np.zeros(1, np.int64)


@njit(cache=True)
def smooth(
    t: np.ndarray,
    values: np.ndarray,
    weights: np.ndarray,
    ring: np.ndarray,
    stamps: np.ndarray,
    seen: np.ndarray,
    at: np.ndarray,
    out: np.ndarray,
) -> int:
    """Smooth all columns by the same weights, where a whole window of rows is there.

    t: int64 (N,), stamps in ns; values: (N, C); weights: (n,), n odd.
    ring, stamps, seen: of `new_columns()`, written.
    at: int64 (N,), out: (N, C), written: the stamps in the middle of the windows, and the smooth
    values there. The rows of half a window at either end have none.

    Returns the number of rows written.
    """
    n, columns = len(weights), values.shape[1]
    found = 0
    for k in range(len(t)):
        slot = seen[0] % n
        for i in range(columns):
            ring[i, slot] = ring[i, slot + n] = values[k, i]
        stamps[slot] = t[k]
        seen[0] += 1
        if seen[0] < n:
            continue
        for i in range(columns):
            out[found, i] = _weighted(weights, ring[i], slot + 1)
        at[found] = stamps[(slot + 1 + n // 2) % n]
        found += 1
    return found
