"""Step counters that look for peaks, as nodes."""

from typing import Annotated

import numpy as np
from pydantic import Field

import lodeflow as lf
from lodeflow_plugins.filtering import smoothing
from lodeflow_plugins.pedestrian.counting import Counter, CounterParams
from lodeflow_plugins.pedestrian.peaks import peaks


class PeakCounter(Counter):
    """Base of the counters of peaks in the norm of a vector."""

    def start(self) -> None:
        super().start()
        p = self.params
        self.weights = smoothing.low_pass(p.cutoff, p.sample_rate)
        self.states = (*smoothing.new_state(self.weights), *peaks.new_state())
        self.count(np.empty(0, np.int64), np.empty((0, 3)))  # compiles

    def count(self, t: np.ndarray, vector: np.ndarray) -> lf.Step | None:
        """Steps of a block."""
        self.seen(t)
        row, moment = np.empty(len(t), np.int64), np.empty(len(t), np.int64)
        p = self.params
        distance = lf.seconds(p.distance)
        found = peaks.count(
            t, vector, self.weights, p.prominence, distance, *self.states, row, moment
        )
        return self.steps(t[row[:found]], moment[:found])


class GyroNormSteps(PeakCounter):
    """Steps from the peaks of the norm of the angular rate of the foot, low-passed.

    Needs no attitude and no zero velocity, and is the best of the simple counters, for walking
    and running. The low-pass has no phase but a delay of 1.13 / cutoff, 0.56 s with the defaults;
    a peak is told when the signal has fallen by the prominence after that. The moment of a step
    is the height of the swing. A slow walker turns the foot twice in a swing, which the cutoff
    no longer joins below some 0.7 strides a second; `swing_steps` stands that better.
    """

    class Params(CounterParams):
        """Low-pass and peaks."""

        cutoff: Annotated[float, lf.Hertz] = Field(2.0, gt=0)
        """Frequency at which the low-pass halves the signal."""
        prominence: Annotated[float, lf.RadPerSecond] = Field(1.0, gt=0)
        """Rise before and fall after a peak that counts."""
        distance: Annotated[float, lf.Second] = Field(0.4, ge=0)
        """Least time between two peaks."""

    def step_block(self, imu: lf.Imu) -> lf.Step | None:
        return self.count(imu.t, imu.angular_velocity)


class AccelerationPeakSteps(PeakCounter):
    """Steps from the peaks of the norm of the specific force, low-passed.

    The usual pedometer, one of the two methods that the zero-velocity counter is compared with
    in its paper.
    """

    class Params(CounterParams):
        """Low-pass and peaks."""

        cutoff: Annotated[float, lf.Hertz] = Field(3.0, gt=0)
        """Frequency at which the low-pass halves the signal."""
        prominence: Annotated[float, lf.MeterPerSecondSquared] = Field(1.0, gt=0)
        """Rise before and fall after a peak that counts."""
        distance: Annotated[float, lf.Second] = Field(0.8, ge=0)
        """Least time between two peaks."""

    def step_block(self, imu: lf.Imu) -> lf.Step | None:
        return self.count(imu.t, imu.linear_acceleration)
