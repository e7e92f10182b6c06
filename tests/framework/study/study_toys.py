"""A source with a seed, and a node with a score that can fail in several ways."""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Iterator
from typing import Annotated, Literal

import numpy as np

import lodeflow as lf

GRAPH = """\
lodeflow: 1
name: toy
args: {seed: 0, count: 10}
nodes:
  noise: {use: "study_toys:Noise", params: {seed: "${seed}", count: "${count}"}}
  level: {use: "study_toys:Level", inputs: {rate: noise}}
"""


class LevelScore(lf.Score, ros="lodeflow_study_test/msg/LevelScore"):
    """How far the rate is from zero."""

    error: Annotated[lf.Scalar[lf.RadPerSecond], lf.GAPS]
    axes: lf.Vector3[lf.RadPerSecond]
    samples: lf.Int64


class Noise(lf.Source):
    """Angular rate at random."""

    class Params(lf.Params):
        seed: int = 0
        count: int = 10
        file: str = ""

    def read(self, clock: lf.Clock) -> Iterator[lf.AngularRate]:
        rng = np.random.default_rng(self.params.seed)
        t = np.arange(self.params.count) * 10_000_000
        yield lf.AngularRate(t, rng.standard_normal((self.params.count, 3)))


class Level(lf.Node):
    """Root mean square of the rate."""

    class Params(lf.Params):
        gain: Annotated[float, lf.RadPerSecond] = 1.0
        fault: Literal["none", "raise", "kill", "exit", "nan", "warn", "sleep", "silent"] = "none"
        faulty_seed: int | None = None

    def start(self) -> None:
        self.sum, self.count, self.last = 0.0, 0, 0

    def step_block(self, rate: lf.AngularRate) -> None:
        fault = self.params.fault
        if fault == "raise":
            raise ArithmeticError("too level")
        if fault == "kill":
            os.kill(os.getpid(), signal.SIGKILL)
        if fault == "exit":
            os._exit(3)
        if fault == "sleep":
            time.sleep(60)
        self.sum += float((rate.angular_rate**2).sum())
        self.count += len(rate.t)
        self.last = int(rate.t[-1])

    def finish(self) -> LevelScore | None:
        print("not a result")
        if self.params.fault == "silent":
            return None
        if self.params.fault == "warn":
            self.log.warning("rather %s", "level")
        error = self.params.gain * (self.sum / max(1, self.count)) ** 0.5
        error = float("nan") if self.params.fault == "nan" else error
        return LevelScore(self.last, error, np.array([error, 0.0, 1.0]), self.count)


class Steep(Level):
    """Twice as far."""

    def finish(self) -> LevelScore | None:
        found = super().finish()
        return found and found.replace(error=2 * found.error)
