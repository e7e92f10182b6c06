"""The nodes that benchmarks/families.py measures: a module per family, with its `ROWS`."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

import lodeflow as lf

Blocks = Mapping[str, Any]
"""A block per input port."""
Reference = Callable[[Blocks], object]


@dataclass(frozen=True)
class Row:
    """A node to measure.

    Attributes:
        name: of the plugin.
        make_reference: makes a fresh one: the same by numpy, called with blocks.
        inputs: makes the blocks for its ports, of N rows, or of as many as they have by then.
        params: of the node; its example if None.
        whole: the reference needs the whole record at once, and looks ahead.
    """

    name: str
    make_reference: Callable[[], Reference]
    inputs: Callable[[int], Blocks]
    params: Mapping[str, Any] | None = None
    whole: bool = False


def stateless(reference: Reference) -> Callable[[], Reference]:
    """Return what makes a reference that remembers nothing."""
    return lambda: reference


def norm(vectors: np.ndarray) -> np.ndarray:
    """Norms of rows (N, 3)."""
    return np.sqrt((vectors * vectors).sum(axis=1))


@dataclass
class KalmanByNumpy:
    """The algebra of a Kalman filter with small matrices, row by row: what numpy takes for it.

    Each row is a prediction and some updates by one number each. Not the filter itself.
    """

    port: str
    states: int
    updates: int
    covariance: np.ndarray = field(init=False)
    state: np.ndarray = field(init=False)

    def __post_init__(self) -> None:
        self.covariance, self.state = np.eye(self.states), np.zeros(self.states)

    def __call__(self, blocks: Blocks) -> None:
        n = self.states
        step = np.eye(n) + 1e-3 * np.eye(n, k=1)
        noise, rows = 1e-4 * np.eye(n), np.eye(n)[: self.updates]
        x, p = self.state, self.covariance
        for _ in range(len(blocks[self.port])):
            x, p = step @ x, step @ p @ step.T + noise
            for h in rows:
                ph = p @ h
                gain = ph / (h @ ph + 0.1)
                x = x + gain * (0.1 - h @ x)
                p = p - np.outer(gain, ph)
        self.state, self.covariance = x, p


def stamps(n: int, rate: float) -> np.ndarray:
    """Stamps (N,) in ns at a rate in Hz."""
    return np.arange(n, dtype=np.int64) * round(1e9 / rate)


def imu_and_field(n: int) -> dict[str, lf.Message]:
    """Random rates, forces and fields at 100 Hz."""
    rng, t = np.random.default_rng(0), stamps(n, 100.0)
    return {
        "imu": lf.Imu(t, rng.standard_normal((n, 3)), rng.standard_normal((n, 3))),
        "mag": lf.MagneticField(t, rng.standard_normal((n, 3))),
    }
