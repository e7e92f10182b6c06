"""The acceleration in the geographic frame as nodes."""

from typing import Annotated

import numpy as np
from pydantic import Field

import lodeflow as lf
from lodeflow_plugins.pedestrian.geographic import rotation


class GravityParams(lf.Params):
    """What is taken off."""

    gravity: Annotated[float, lf.MeterPerSecondSquared] = Field(lf.STANDARD_GRAVITY, gt=0)
    """Specific force at rest, which is removed from the vertical component."""


class ToGeographic(lf.Node):
    """Acceleration in east, north, up from specific force and attitude, gravity removed.

    a = C f - (0, 0, g), with C the direction cosine matrix of the attitude, earth <- body with
    z up. At rest all three components are near zero, whatever the attitude is; a wrong heading
    turns the horizontal components, and no more.

    Source: step counter printed with Liu et al. 2018, Eqs. 1 and 2, and the text of Fig. 5.
    """

    sync = lf.Exact()

    Params = GravityParams

    def start(self) -> None:
        rotation.by_quaternion(np.empty((0, 3)), np.empty((0, 4)), 1.0)  # compiles

    def step(self, imu: lf.Imu, attitude: lf.Attitude) -> lf.Acceleration:
        force, quaternion = imu.linear_acceleration[None], attitude.quaternion[None]
        return lf.Acceleration(
            imu.t, rotation.by_quaternion(force, quaternion, self.params.gravity)[0]
        )

    def step_block(self, imu: lf.Imu, attitude: lf.Attitude) -> lf.Acceleration:
        force = imu.linear_acceleration
        return lf.Acceleration(
            imu.t, rotation.by_quaternion(force, attitude.quaternion, self.params.gravity)
        )


class EulerToGeographic(lf.Node):
    """The same from Euler angles, as an attitude and heading reference gives them.

    Heading clockwise from north, pitch nose up, roll right side down.

    Source: step counter printed with Liu et al. 2018, Eq. 1, corrected, and Eq. 2.
    """

    sync = lf.Exact()

    Params = GravityParams

    def start(self) -> None:
        rotation.by_angles(np.empty((0, 3)), np.empty((0, 3)), 1.0)  # compiles

    def step_block(self, imu: lf.Imu, euler: lf.EulerAngles) -> lf.Acceleration:
        angles = np.column_stack([euler.heading, euler.pitch, euler.roll])
        force = imu.linear_acceleration
        return lf.Acceleration(imu.t, rotation.by_angles(force, angles, self.params.gravity))
