"""Long series in few points: what is left draws the same picture."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Stamps = NDArray[np.int64]
Values = NDArray[np.float64]

BINS = 2000
"""Columns of pixels, or more, that a figure is wide."""
_FOLD = 20 * BINS


def kept(t: Stamps, values: Values, start: int, end: int, bins: int = BINS) -> NDArray[np.intp]:
    """Return which rows draw the same line as all, where a figure has at most `bins` columns.

    Of each column those are the first, the last, the least and the greatest value, so that a
    spike of a single sample stays; and the first NaN, so that a gap breaks the line.

    Source: Jugel et al. 2014, "M4: A Visualization-Oriented Time Series Data Aggregation".

    Args:
        t: (N,) stamps, ns, not falling; N > 0.
        values: (N,), NaN in gaps.
        start: left edge, ns.
        end: right edge, ns, above `start`.
        bins: columns.

    Returns:
        Indices of rows, rising.
    """
    column = np.clip((t - start) // max(1, -((start - end) // bins)), 0, bins - 1)
    first = np.concatenate([[0], np.flatnonzero(column[1:] != column[:-1]) + 1])
    last = np.append(first[1:], len(t)) - 1
    gap = np.isnan(values)
    found = [first, last, _first_of(gap, first)]
    for least, far in ((values, np.inf), (-values, np.inf)):
        filled = np.where(gap, far, least)
        lowest = np.minimum.reduceat(filled, first)
        found.append(_first_of((filled == np.repeat(lowest, last - first + 1)) & ~gap, first))
    return np.unique(np.concatenate(found))


def _first_of(which: NDArray[np.bool_], starts: NDArray[np.intp]) -> NDArray[np.intp]:
    """Return the first true row of each group of rows that has one."""
    rows = np.flatnonzero(which)
    group = np.searchsorted(starts, rows, side="right")
    new = np.ones(len(rows), dtype=bool)
    new[1:] = group[1:] != group[:-1]
    return rows[new]


class Series:
    """A series that is thinned as it comes, so that its length does not matter.

    Args:
        start: left edge of the figure, ns.
        end: right edge, ns, above `start`.

    Attributes:
        count: how many samples have come.
    """

    def __init__(self, start: int, end: int) -> None:
        self.start, self.end = start, end
        self.count = 0
        self._parts: list[tuple[Stamps, Values]] = []
        self._rows = 0

    def add(self, t: Stamps, values: Values) -> None:
        """Append samples."""
        self._parts.append((t, values))
        self._rows += len(t)
        self.count += len(t)
        if self._rows > _FOLD:
            self._fold()

    def points(self) -> tuple[Stamps, Values]:
        """Return what is left to draw, stamps and values."""
        if self._rows > 4 * BINS:
            self._fold()
        if not self._parts:
            return np.empty(0, np.int64), np.empty(0)
        t, values = zip(*self._parts, strict=True)
        return np.concatenate(t), np.concatenate(values)

    def _fold(self) -> None:
        t, values = (np.concatenate(parts) for parts in zip(*self._parts, strict=True))
        rows = kept(t, values, self.start, self.end)
        self._parts = [(t[rows], values[rows])]
        self._rows = len(rows)


class Spans:
    """A mode that is kept as the stamps at which it changes.

    Attributes:
        count: how many samples have come.
    """

    def __init__(self) -> None:
        self.count = 0
        self._t: list[Stamps] = []
        self._values: list[Values] = []
        self._last = np.nan

    def add(self, t: Stamps, values: Values) -> None:
        """Append samples."""
        self.count += len(t)
        changes = values != np.concatenate([[self._last], values[:-1]])
        self._t.append(t[changes])
        self._values.append(values[changes])
        self._last = values[-1]

    def points(self) -> tuple[Stamps, Values]:
        """Return the stamp of each change, and the value from there on."""
        if not self._t:
            return np.empty(0, np.int64), np.empty(0)
        return np.concatenate(self._t), np.concatenate(self._values)


def broken(t: Values, values: Values, turn: float) -> tuple[Values, Values]:
    """Return a line that does not run across the figure where an angle begins its next turn.

    Args:
        t: (N,).
        values: (N,).
        turn: a whole turn, in the unit of the values.
    """
    with np.errstate(invalid="ignore"):
        ends = np.flatnonzero(np.abs(np.diff(values)) > turn / 2) + 1
    return np.insert(t, ends, t[ends]), np.insert(values, ends, np.nan)
