"""How well good compass samples are told from bad ones: RP, MP and WP.

A sample is good when its heading error is below a limit, 5 degrees in the paper.

    RP  accepted good / all good                 recognised
    MP  accepted bad / accepted                  mistaken
    WP  the accepted samples' heading error      its maximum, and its 99th percentile

The paper does not say what statistic WP is. The maximum fits its Table 2 and the 99th percentile
its Table 1, so both are given.

Source: Hao, Yang and Huang, note under Table 1.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

TURN = 2.0 * np.pi


@dataclass(frozen=True)
class Scores:
    """Shares and errors, rad; NaN where there is nothing to divide by.

    kept: accepted good / good among the candidates; accepted: share of all samples.
    """

    recognised: float
    mistaken: float
    kept: float
    error_max: float
    error_p99: float
    accepted: float
    good: int
    samples: int


def heading_error(heading: np.ndarray, truth: np.ndarray) -> np.ndarray:
    """Size of the difference of two headings (N,), rad, in [0, pi]."""
    return np.abs((heading - truth + np.pi) % TURN - np.pi)


def score(error: np.ndarray, accepted: np.ndarray, candidates: np.ndarray, limit: float) -> Scores:
    """Score samples with heading errors (N,), rad.

    accepted, candidates: (N,) bool; candidates are what the stage before accepts.
    """
    good = error < limit
    right = accepted & good
    taken = error[accepted]
    return Scores(
        _share(right.sum(), good.sum()),
        _share((accepted & ~good).sum(), accepted.sum()),
        _share((right & candidates).sum(), (good & candidates).sum()),
        float(taken.max()) if len(taken) else np.nan,
        float(np.percentile(taken, 99)) if len(taken) else np.nan,
        _share(accepted.sum(), len(error)),
        int(good.sum()),
        len(error),
    )


def _share(part: int, whole: int) -> float:
    return float(part / whole) if whole else np.nan
