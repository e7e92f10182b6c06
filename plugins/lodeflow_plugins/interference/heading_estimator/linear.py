"""The few operations of linear algebra that the filter needs, on arrays of fixed size."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

TURN = 2.0 * math.pi


@njit(cache=True, inline="always")
def wrap(angle: float) -> float:
    """The same angle in [-pi, pi)."""
    return angle - TURN * math.floor(angle / TURN + 0.5)


@njit(cache=True)
def variance(P: np.ndarray, h: np.ndarray) -> float:
    """H P h' for P (n, n) and the first n of h."""
    total = 0.0
    for i in range(len(P)):
        for j in range(len(P)):
            total += h[i] * P[i, j] * h[j]
    return total


@njit(cache=True)
def gain(P: np.ndarray, h: np.ndarray, r: float, k: np.ndarray) -> None:
    """Write K = P h' / (h P h' + r) into k (n,), and take K h P off P; one measurement."""
    n = len(P)
    innovation = r
    for i in range(n):
        total = 0.0
        for j in range(n):
            total += P[i, j] * h[j]
        k[i] = total
        innovation += h[i] * total
    for i in range(n):
        for j in range(i + 1):
            P[i, j] -= k[i] * k[j] / innovation
            P[j, i] = P[i, j]
    for i in range(n):
        k[i] /= innovation
