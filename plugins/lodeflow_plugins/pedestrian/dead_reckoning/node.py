"""Tracks of a walker as nodes."""

from typing import Annotated

import numpy as np
from pydantic import Field

import lodeflow as lf
from lodeflow_plugins.pedestrian.dead_reckoning import track


class StepTrack(lf.Node):
    """A track from steps and heading: each step goes on by one step length.

    The heading is that of the foot when the step is told, which is in its stance: the horizontal
    direction of the body's x axis, turned by `mounting`. Position east and north of the start,
    with the first attitude and at each step. A walker who goes sideways or backwards, or changes
    the length of the steps, is not where the track says.

    attitude: earth <- body with z up, of the foot. steps: `count` is of one foot.
    """

    sync = lf.Hold("steps")

    class Params(lf.Params):
        """What a step is worth."""

        step_length: Annotated[float, lf.Meter] = Field(1.2, gt=0)
        """Way of one step; with a sensor on one foot that is a stride, from stance to stance."""
        mounting: Annotated[float, lf.Radian] = 0.0
        """Heading of the walk against that of the body's x axis, clockwise."""

    def start(self) -> None:
        self.position = 0j  # east, north
        self.count = 0

    def step_block(self, steps: lf.Step, attitude: lf.Attitude) -> lf.Position:
        turn = complex(np.cos(self.params.mounting), -np.sin(self.params.mounting))
        where = np.empty((len(steps), 3))
        rows = zip(attitude.quaternion.tolist(), steps.count.tolist(), strict=True)
        for k, ((x, y, z, w), count) in enumerate(rows):
            forward = complex(1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y + w * z))  # east, north
            length = abs(forward)
            if length > 0.0:  # the foot does not stand on its tip
                way = self.params.step_length * (count - self.count)
                self.position += forward / length * turn * way
            self.count = count
            where[k] = self.position.real, self.position.imag, 0.0
        return lf.Position(steps.t, where)


class StanceTrack(lf.Node):
    """A track from stance to stance, by integration of the acceleration of the foot.

    In each stance the velocity is known to be zero, which bounds the drift to one swing. There
    is a position, east, north, up in m from the first stance, each time the foot leaves a
    stance, and one for the stance in which the recording ends. Needs no step length, and does
    not mind in which direction the foot is set.

    imu: of the foot. acceleration: the same sensor's, in the geographic frame (`to_geographic`).

    Source: the zero-velocity principle of Foxlin 2005, Pedestrian Tracking with Shoe-Mounted
    Inertial Sensors, IEEE Computer Graphics and Applications 25(6), without its Kalman filter.
    """

    sync = lf.Exact()

    class Params(lf.Params):
        """What a stance is, as in `swing_steps`."""

        rate_weight: float = Field(2.5, ge=0)
        """Acceleration that weighs as much as an angular rate of 1 rad/s, m/s^2 per rad/s."""
        rest: Annotated[float, lf.MeterPerSecondSquared] = Field(0.5, gt=0)
        """Motion below which all is rest; above the noise and the error of the attitude."""
        ratio: float = Field(3.0, gt=1)
        """How many times more the foot moves in a swing than in the stances around it."""
        smooth: Annotated[float, lf.Second] = Field(0.03, ge=0)
        """Time constant of the average of the motion."""

    def start(self) -> None:
        p = self.params
        self.constants = np.array([p.rate_weight, p.rest, p.ratio, p.smooth])
        self.state = track.new_state()
        self.last: int | None = None
        self.told: int | None = None
        self.step_block(lf.Imu.empty(), lf.Acceleration.empty())  # compiles

    def step_block(self, imu: lf.Imu, acceleration: lf.Acceleration) -> lf.Position:
        row, out = np.empty(len(imu), np.int64), np.empty((len(imu), 3))
        found = track.integrate(
            imu.t,
            acceleration.acceleration,
            imu.angular_velocity,
            self.constants,
            *self.state,
            row,
            out,
        )
        t = imu.t[row[:found]]
        self.last = int(imu.t[-1]) if len(imu) else self.last
        self.told = int(t[-1]) if found else self.told
        return lf.Position(t, out[:found].copy())

    def finish(self) -> lf.Position | None:
        where = track.last_stance(self.state[0])
        if where is None or self.last is None or self.last == self.told:
            return None
        return lf.Position(self.last, where)
