"""Inclination stage and heading stage as one node."""

import lodeflow as lf
from lodeflow_plugins.fusion.heading_kalman import filter as heading
from lodeflow_plugins.fusion.heading_kalman.node import NO_FIELD, UPRIGHT, HeadingKalman, headed
from lodeflow_plugins.fusion.inertial_attitude import filter as inertial
from lodeflow_plugins.fusion.inertial_attitude.node import InertialAttitude, levelled


class AttitudeFuser(lf.Node):
    """Attitude from IMU and magnetometer: `inertial_attitude` and `heading_kalman` in one.

    Inputs in the body frame, output magnetic ENU <- body for each IMU sample from the first on;
    the bytes are those of the two nodes. It takes the place of any fuser with the inputs imu and
    mag; use the two nodes where their bias, rest and state are wanted.

    Source: Laidig and Seel 2023, and see `heading_kalman`.
    """

    sync = lf.Each()

    class Params(InertialAttitude.Params, HeadingKalman.Params):
        """The parameters of both stages."""

    def start(self) -> None:
        given = self.params.model_dump()
        stages = [
            plugin.Params(**{name: given[name] for name in plugin.Params.model_fields})
            for plugin in (InertialAttitude, HeadingKalman)
        ]
        self.inclination, self.heading = [stage.constants() for stage in stages]
        self.inclination_state, self.heading_state = inertial.new_state(), heading.new_state()
        for plugin, params in zip((InertialAttitude, HeadingKalman), stages, strict=True):
            plugin(params).start()  # compiles

    def step(self, imu: lf.Imu | None, mag: lf.MagneticField | None) -> lf.Attitude | None:
        if imu is None:
            field = mag.magnetic_field
            heading.run_one(mag.t, False, UPRIGHT, True, field, self.heading, self.heading_state)
            return None
        t, rate, force = imu.t, imu.angular_velocity, imu.linear_acceleration
        q = inertial.run_one(t, rate, force, self.inclination, self.inclination_state)
        field, measured = (NO_FIELD, False) if mag is None else (mag.magnetic_field, True)
        q = heading.run_one(t, True, q, measured, field, self.heading, self.heading_state)
        return lf.Attitude(t, q)

    def step_block(
        self, imu: lf.Sparse[lf.Imu], mag: lf.Sparse[lf.MagneticField]
    ) -> lf.Attitude | None:
        level, *_ = levelled(imu.values, self.inclination, self.inclination_state)
        level = lf.Sparse(lf.Attitude(imu.values.t, level), imu.rows, imu.t)
        out, _, _ = headed(level, mag, self.heading, self.heading_state)
        return lf.Attitude(imu.values.t, out)
