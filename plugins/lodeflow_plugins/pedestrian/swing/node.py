"""The step counter for walking and running as a node."""

import math
from typing import Annotated

import numpy as np
from pydantic import Field

import lodeflow as lf
from lodeflow_plugins.filtering import smoothing
from lodeflow_plugins.pedestrian.counting import Counter, CounterParams
from lodeflow_plugins.pedestrian.swing import swing


class SwingSteps(Counter):
    """Steps of walkers and runners, from acceleration and angular rate together.

    Combines what `zero_velocity_steps` and `gyro_norm_steps` look at: the norm of the
    acceleration without gravity, and that of the angular rate. A swing is where both together
    rise by a ratio above the stance before it and fall by the ratio below their height, so there
    is no threshold to be set for a gait. A step is told when the foot has landed, half a
    smoothing window later (0.1 s); its moment is the height of the swing. Standing still, before
    the first step or between two, counts nothing.

    imu: of the foot. acceleration: the same sensor's, in the geographic frame (`to_geographic`).
    """

    sync = lf.Exact()

    class Params(CounterParams):
        """How motion is measured, and what a swing is. The same for walking and running."""

        rate_weight: float = Field(2.5, ge=0)
        """Acceleration that weighs as much as an angular rate of 1 rad/s, m/s^2 per rad/s."""
        rest: Annotated[float, lf.MeterPerSecondSquared] = Field(0.5, gt=0)
        """Motion below which all is rest; above the noise and the error of the attitude."""
        smooth: Annotated[float, lf.Second] = Field(0.2, ge=0)
        """Length of the window that smooths the logarithm of the motion."""
        ratio: float = Field(2.2, gt=1)
        """How many times more the foot moves in a swing than in the stances around it."""
        min_swing: Annotated[float, lf.Second] = Field(0.2, ge=0)
        """Between rise and fall of the shortest swing; what is shorter is a knock."""

    def start(self) -> None:
        super().start()
        p = self.params
        self.weights = smoothing.hann(p.smooth, p.sample_rate)
        self.constants = np.array([p.rate_weight, p.rest, math.log(p.ratio)])
        self.states = (*smoothing.new_state(self.weights), *swing.new_state())
        self.step_block(lf.Imu.empty(), lf.Acceleration.empty())  # compiles

    def step_block(self, imu: lf.Imu, acceleration: lf.Acceleration) -> lf.Step | None:
        t = imu.t
        self.seen(t)
        row, moment = np.empty(len(t), np.int64), np.empty(len(t), np.int64)
        found = swing.count(
            t,
            acceleration.acceleration,
            imu.angular_velocity,
            self.constants,
            self.weights,
            lf.seconds(self.params.min_swing),
            *self.states,
            row,
            moment,
        )
        return self.steps(t[row[:found]], moment[:found])
