"""Counted steps against the true ones, each by itself."""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Score:
    """Numbers of steps.

    counted, true: in all. missed: true steps without a counted one between the two stances
    around them. extra: counted ones too many there, or outside of all true steps.
    """

    counted: int
    true: int
    missed: int
    extra: int


def score(moments: np.ndarray, times: np.ndarray, stances: np.ndarray, counts: np.ndarray) -> Score:
    """Match steps to the intervals between stances.

    moments: (M,), when steps were made; times: (M,), how many steps each of them is.
    stances: (S,), increasing, when the reference has its counts; counts: (S,), steps up to then.
    """
    counted = int(times.sum())
    if len(stances) == 0:
        return Score(counted, 0, 0, counted)
    true = np.diff(counts)
    # A foot that comes to rest does so before the stance is in its middle: (before, stance].
    interval = np.searchsorted(stances, moments, side="left") - 1
    inside = (interval >= 0) & (interval < len(true))
    hits = np.bincount(interval[inside], weights=times[inside], minlength=len(true)).astype(int)
    outside = counted - int(hits.sum())
    return Score(
        counted,
        int(true.sum()),
        int(np.maximum(true - hits, 0).sum()),
        int(np.maximum(hits - true, 0).sum()) + outside,
    )
