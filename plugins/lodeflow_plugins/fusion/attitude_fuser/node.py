"""Inclination stage and heading stage as one node."""

import numpy as np

import lodeflow as lf
from lodeflow_plugins.fusion.attitude_fuser.fuse import INCLINATION, fuse, fuse_one, new_state
from lodeflow_plugins.fusion.heading_kalman import filter as heading
from lodeflow_plugins.fusion.heading_kalman.node import NO_FIELD, UPRIGHT, HeadingKalman
from lodeflow_plugins.fusion.inertial_attitude.node import InertialAttitude


class AttitudeFuser(lf.Node):
    """Attitude from IMU and magnetometer: `inertial_attitude` and `heading_kalman` in one.

    Inputs in the body frame, output magnetic ENU <- body for each IMU sample from the first on;
    the bytes are those of the two nodes. It takes the place of any fuser with the inputs imu and
    mag; use the two nodes where their bias, rest and state are wanted.

    Source: Laidig and Seel 2023, and see `heading_kalman`.
    """

    sync = lf.Each()

    class Params(InertialAttitude.Params, HeadingKalman.Params):
        """The parameters of both stages; nothing is reported, so report_interval has no meaning."""

    def start(self) -> None:
        given = self.params.model_dump()
        stages = [
            plugin.Params(**{name: given[name] for name in plugin.Params.model_fields}).constants()
            for plugin in (InertialAttitude, HeadingKalman)
        ]
        self.state, spare = new_state(*stages), new_state(*stages)
        self.heading = self.state[INCLINATION:]
        nothing = np.empty(0, np.int64)
        self.step_block(  # compiles
            lf.Sparse(lf.Imu.empty(), nothing, nothing),
            lf.Sparse(lf.MagneticField.empty(), nothing, nothing),
        )
        out = np.empty(4)
        fuse_one(0, NO_FIELD, NO_FIELD, False, NO_FIELD, spare, out)
        heading.run_one(0, False, UPRIGHT, False, NO_FIELD, spare[INCLINATION:], out)

    def step(self, imu: lf.Imu | None, mag: lf.MagneticField | None) -> lf.Attitude | None:
        out = np.empty(4)
        if imu is None:
            field = mag.magnetic_field
            heading.run_one(mag.t, False, UPRIGHT, True, field, self.heading, out)
            return None
        t, rate, force = imu.t, imu.angular_velocity, imu.linear_acceleration
        field, measured = (NO_FIELD, False) if mag is None else (mag.magnetic_field, True)
        fuse_one(t, rate, force, measured, field, self.state, out)
        return lf.Attitude(t, out)

    def step_block(
        self, imu: lf.Sparse[lf.Imu], mag: lf.Sparse[lf.MagneticField]
    ) -> lf.Attitude | None:
        rate, force = imu.values.angular_velocity, imu.values.linear_acceleration
        out = np.empty((len(rate), 4))
        fuse(imu.t, rate, force, imu.rows, mag.values.magnetic_field, mag.rows, self.state, out)
        return lf.Attitude(imu.values.t, out)
