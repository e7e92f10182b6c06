"""The tilt-compensated compass as a node."""

from typing import Annotated, NamedTuple

import numpy as np
from pydantic import Field

import lodeflow as lf
from lodeflow_plugins.fusion.tilt_compass import compass


class Measured(NamedTuple):
    """Ports of `TiltCompass`."""

    attitude: lf.Attitude | None
    euler: lf.EulerAngles | None


class TiltCompass(lf.Node):
    """Attitude from specific force and magnetic field alone, row by row, without memory.

    Inputs in the body frame (FLU); the attitude is magnetic ENU <- FLU, the Euler angles are
    those from magnetic NED to FRD. Right while the body does not accelerate: shaking with
    1.5 m/s^2 costs some degrees, which a filter such as `quaternion_kalman` averages out. With a
    gate, rows that accelerate visibly say nothing.

    There is one measurement for each field reading, with the nearest specific force: the field is
    the slower of the two where they differ, and a reading used for several rows would count
    several times in a filter behind.

    Source: Chu et al. 2017, Eqs. 1, 2, 9, 10 and 27.
    """

    sync = lf.Nearest("mag", within=lf.seconds(0.005))

    class Params(lf.Params):
        """The gate."""

        gate: Annotated[float | None, lf.MeterPerSecondSquared] = Field(None, gt=0)
        """Largest | |f| - gravity | of a row that is used; null for the paper's compass, which
        uses all."""
        gravity: Annotated[float, lf.MeterPerSecondSquared] = Field(lf.STANDARD_GRAVITY, gt=0)
        """Specific force at rest; only the gate needs it."""

    def start(self) -> None:
        compass.measure(np.empty((0, 3)), np.empty((0, 3)))  # compiles

    def _usable(self, f: np.ndarray) -> np.ndarray:
        norm = np.sqrt(f[..., 0] * f[..., 0] + f[..., 1] * f[..., 1] + f[..., 2] * f[..., 2])
        return np.abs(norm - self.params.gravity) < self.params.gate

    def step(self, imu: lf.Imu, mag: lf.MagneticField) -> Measured | None:
        force = imu.linear_acceleration
        if self.params.gate is not None and not self._usable(force):
            return None
        euler, quaternion = compass.measure(force[None], mag.magnetic_field[None])
        return Measured(
            lf.Attitude(mag.t, quaternion[0]), lf.EulerAngles(mag.t, *euler[0].tolist())
        )

    def step_block(self, imu: lf.Imu, mag: lf.MagneticField) -> Measured | None:
        t, force, field = mag.t, imu.linear_acceleration, mag.magnetic_field
        if self.params.gate is not None:
            usable = self._usable(force)
            t, force, field = t[usable], force[usable], field[usable]
        euler, quaternion = compass.measure(force, field)
        columns = np.ascontiguousarray(euler.T)
        return Measured(lf.Attitude(t, quaternion), lf.EulerAngles(t, *columns))
