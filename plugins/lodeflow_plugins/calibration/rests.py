"""Where a recording stands still: stretches over which the readings scatter as their noise does.

The noise of each channel is read off the recording itself: it is what the least restless tenth of
all windows shows. A sample is at rest if the window around it scatters at most twice as much, so
that a recording has to be at rest for a tenth of its time at least.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

QUIET = 0.1
"""Share of windows that are taken to be at rest when the noise is read off."""
MARGIN = 2.0
"""How many times as much as the noise a window at rest may scatter."""
GAP = 5.0
"""A distance between stamps of so many times the usual one ends a stretch."""


@dataclass(frozen=True, eq=False)
class Rest:
    """A stretch at rest: rows first <= row < last of a recording, and what they read.

    mean: (K,), of each channel; scatter: (K,), standard deviation of a row.
    """

    first: int
    last: int
    mean: np.ndarray
    scatter: np.ndarray

    @property
    def count(self) -> int:
        return self.last - self.first


def find(t: np.ndarray, values: np.ndarray, samples: int, floor: float) -> list[Rest]:
    """Return the stretches of at least `samples` rows at rest, in order.

    t: (N,), stamps in ns; values: (N, K); floor: scatter, in the unit of the values, that is no
    motion however little noise there is, such as half a step of the converter.
    """
    window = max(samples // 4, 8)
    pieces = pieces_of(t)
    scatters = [moving_scatter(values[first:last], window) for first, last in pieces]
    if not sum(map(len, scatters)):
        return []
    noise = np.quantile(np.concatenate(scatters), QUIET, axis=0)
    bound = np.maximum(MARGIN * noise, floor)
    found = []
    for (first, _), scatter in zip(pieces, scatters, strict=True):
        still = np.concatenate([[False], (scatter <= bound).all(axis=1), [False]])
        edges = np.flatnonzero(np.diff(still.astype(np.int8)))
        for begin, end in edges.reshape(-1, 2) + first + window // 2:
            if end - begin >= samples:
                rows = values[begin:end]
                found.append(Rest(int(begin), int(end), rows.mean(axis=0), rows.std(axis=0)))
    return found


def pieces_of(t: np.ndarray) -> list[tuple[int, int]]:
    """Return the rows (first, last) of each piece of a recording without a gap in its stamps."""
    if not len(t):
        return []
    steps = np.diff(t)
    usual = float(np.median(steps)) if len(steps) else 0.0
    cuts = np.flatnonzero(steps > GAP * usual) + 1
    edges = [0, *cuts.tolist(), len(t)]
    return list(pairwise(edges))


def moving_scatter(values: np.ndarray, window: int) -> np.ndarray:
    """Return the standard deviation of each window of rows, (N - window + 1, K)."""
    if len(values) < window:
        return np.empty((0, values.shape[1]))
    centred = values - values.mean(axis=0)  # sums of squares of large numbers cancel
    zero = np.zeros((1, values.shape[1]))
    sums = np.concatenate([zero, np.cumsum(centred, axis=0)])
    squares = np.concatenate([zero, np.cumsum(centred**2, axis=0)])
    mean = (sums[window:] - sums[:-window]) / window
    square = (squares[window:] - squares[:-window]) / window
    return np.sqrt(np.maximum(square - mean**2, 0.0))
