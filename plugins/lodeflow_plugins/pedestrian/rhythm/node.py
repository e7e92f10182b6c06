"""The step counter by autocorrelation as a node."""

from typing import Annotated

import numpy as np
from pydantic import Field, model_validator

import lodeflow as lf
from lodeflow_plugins.pedestrian.counting import Counter, CounterParams
from lodeflow_plugins.pedestrian.rhythm import rhythm


class AutocorrelationSteps(Counter):
    """Steps from the rhythm of the specific force: the time after which its norm repeats itself.

    Every `hop` the autocorrelation over the last `window` gives the period of a stride, and the
    count grows by hop / period. It says how many steps there were and not when, so their moment
    is the end of the hop. One of the two methods that the zero-velocity counter is compared with
    in its paper.
    """

    class Params(CounterParams):
        """Window and lags."""

        window: Annotated[float, lf.Second] = Field(4.0, gt=0)
        """Time that is compared with itself."""
        hop: Annotated[float, lf.Second] = Field(0.5, gt=0)
        """Time between two looks."""
        shortest: Annotated[float, lf.Second] = Field(0.6, gt=0)
        """Shortest period of a stride."""
        longest: Annotated[float, lf.Second] = Field(2.0, gt=0)
        """Longest period of a stride."""
        correlation: float = Field(0.4, gt=0, lt=1)
        """Least correlation coefficient of a rhythm."""
        quiet: Annotated[float, lf.MeterPerSecondSquared] = Field(1.0, ge=0)
        """Standard deviation below which the foot stands."""

        @model_validator(mode="after")
        def _fits(self) -> "AutocorrelationSteps.Params":
            if not self.shortest < self.longest < self.window:
                raise ValueError("shortest < longest < window does not hold")
            if self.shortest * self.sample_rate < 2.0 or self.hop * self.sample_rate < 1.0:
                raise ValueError("shortest and hop take at least 2 and 1 samples")
            return self

    def start(self) -> None:
        super().start()
        p = self.params
        self.hop = round(p.hop * p.sample_rate)
        self.lags = np.array([round(p.shortest * p.sample_rate), int(p.longest * p.sample_rate)])
        self.limits = np.array([p.correlation, p.quiet])
        self.state = rhythm.new_state(int(p.window * p.sample_rate))
        self.step_block(lf.Imu.empty())  # compiles

    def step_block(self, imu: lf.Imu) -> lf.Step | None:
        t = imu.t
        self.seen(t)
        row, times = np.empty(len(t), np.int64), np.empty(len(t), np.int64)
        force = imu.linear_acceleration
        found = rhythm.count(force, self.hop, self.lags, self.limits, self.state, row, times)
        at = t[row[:found]]
        return self.steps(at, at, times[:found])
