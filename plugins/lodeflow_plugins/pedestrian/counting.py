"""What all step counters share: their parameters, and the messages that they send."""

import math
from typing import Annotated, Literal

import numpy as np
from pydantic import Field

import lodeflow as lf

RATE_TOLERANCE = 0.1
"""Share by which the rate of the input may differ from the parameter without a warning."""


class CounterParams(lf.Params):
    """What a counter has to know of its input, and what it calls a step."""

    sample_rate: Annotated[float, lf.Hertz] = Field(50.0, gt=0)
    """Rate of the input; windows and delays are whole numbers of samples."""
    steps_per_stance: Literal[1, 2] = 1
    """1 counts the steps of the foot that wears the sensor (strides), 2 those of both feet."""


class Counter(lf.Node):
    """Base of the step counters: numbers what they find, and looks at the rate of their input."""

    Params = CounterParams

    def start(self) -> None:
        self.found = 0
        self.first: int | None = None
        self.last = 0
        self.samples = 0

    def seen(self, t: np.ndarray) -> None:
        """Take note of the stamps of a block."""
        if not len(t):
            return
        if self.first is None:
            self.first = int(t[0])
        self.last = int(t[-1])
        self.samples += len(t)

    def steps(
        self, t: np.ndarray, moment: np.ndarray, times: np.ndarray | None = None
    ) -> lf.Step | None:
        """Steps that were found at the stamps t (M,), each made at `moment` (M,); None for none.

        times: (M,), how many steps each of them is; one if None.
        """
        if not len(t):
            return None
        times = np.ones(len(t), np.int64) if times is None else times
        counts = self.found + np.cumsum(times)
        self.found = int(counts[-1])
        return lf.Step(t.copy(), counts * self.params.steps_per_stance, moment.copy())

    def finish(self) -> None:
        if self.first is None or self.samples < 2:
            return
        rate = (self.samples - 1) / (self.last - self.first) * 1e9
        if math.fabs(rate / self.params.sample_rate - 1.0) > RATE_TOLERANCE:
            self.log.warning(
                "the input came at %.1f Hz, and sample_rate says %g Hz",
                rate,
                self.params.sample_rate,
            )
