"""Statistics over the cells of a study, as a study file names them."""

from __future__ import annotations

import operator
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lodeflow.errors import MessageError, did_you_mean
from lodeflow.messages.units import Unit

Values = NDArray[np.float64]

_PLAIN: dict[str, Callable[[Values], float]] = {
    "mean": lambda x: float(np.mean(x)),
    "median": lambda x: float(np.median(x)),
    "rms": lambda x: float(np.sqrt(np.mean(x * x))),
    "std": lambda x: float(np.std(x)),
    "min": lambda x: float(np.min(x)),
    "max": lambda x: float(np.max(x)),
    "sum": lambda x: float(np.sum(x)),
}
_QUANTILE = re.compile(r"p(\d\d?)")
_COUNTED = re.compile(r"(count|percent) (above|below) (\S.*)")
_COMPARISONS = {"above": operator.gt, "below": operator.lt}
KNOWN = (*_PLAIN, "p95", "count above 10 deg", "percent below 0.5 m")
"""What a statistic may read like."""


@dataclass(frozen=True)
class Statistic:
    """One number for many.

    Attributes:
        text: as written: "mean", "median", "rms", "std", "min", "max", "sum", "p95" (the 95th
            percentile), "count above 10 deg", "percent below 0.5 m".
    """

    text: str

    @property
    def counts(self) -> bool:
        """Whether the outcome is a number of cells, and no longer of the values' unit."""
        return self.text.startswith("count ")

    @property
    def shares(self) -> bool:
        """Whether the outcome is a percentage of the cells."""
        return self.text.startswith("percent ")

    def check(self, unit: type[Unit]) -> str:
        """Return what is wrong with the statistic for values of a unit, or ""."""
        if counted := _COUNTED.fullmatch(self.text):
            try:
                unit.parse(counted[3])
            except MessageError as error:
                return f"{self.text!r}: {error}"
            return ""
        quantile = _QUANTILE.fullmatch(self.text)
        if self.text in _PLAIN or quantile:
            return ""
        near = did_you_mean(self.text, KNOWN) or f" (statistics: {', '.join(KNOWN)})"
        return f"no statistic {self.text!r}{near}"

    def of(self, values: Sequence[float], unit: type[Unit]) -> float:
        """Return the statistic of values in SI units; NaN if one of them is NaN.

        Args:
            values: at least one.
            unit: of the values; a threshold is read in it.
        """
        found = np.asarray(values, dtype=np.float64)
        if np.isnan(found).any():
            return float("nan")
        if counted := _COUNTED.fullmatch(self.text):
            beyond = _COMPARISONS[counted[2]](found, unit.parse(counted[3]))
            return float(beyond.sum() if self.counts else 100 * beyond.mean())
        if quantile := _QUANTILE.fullmatch(self.text):
            return float(np.percentile(found, int(quantile[1])))
        return _PLAIN[self.text](found)
