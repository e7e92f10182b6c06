"""The smoother as a node."""

from typing import Any

import numpy as np

import lodeflow as lf
from lodeflow_plugins.fusion.attitude_fuser.node import AttitudeFuser
from lodeflow_plugins.fusion.heading_kalman.node import HeadingKalman
from lodeflow_plugins.fusion.inertial_attitude.node import InertialAttitude
from lodeflow_plugins.fusion.offline_attitude import smoother


class OfflineAttitude(lf.Node):
    """Attitude of a recording from what came before and after: `attitude_fuser`, both ways.

    Inputs in the body frame; at the end of the streams, and not before, come the attitudes,
    magnetic ENU <- body, of all IMU samples. For recordings of at most 30 days, as far as the
    memory goes: it holds all samples, and takes about 0.6 kB for each while it works.

    Source: see `smoother.py`.
    """

    sync = lf.Each()
    lookback = lf.seconds(30 * 86400)

    class Params(AttitudeFuser.Params):
        """The parameters of both stages; report_interval has no meaning here."""

    def start(self) -> None:
        given = self.params.model_dump() | {"report_interval": 0.0, "output_advance": 0.0}
        self.constants = []
        for plugin in (InertialAttitude, HeadingKalman):
            params = plugin.Params(**{name: given[name] for name in plugin.Params.model_fields})
            plugin(params).start()  # compiles
            self.constants.append(params.constants())
        self.imu: list[lf.Imu] = []
        self.mag: list[lf.MagneticField] = []

    def step_block(self, imu: lf.Sparse[lf.Imu], mag: lf.Sparse[lf.MagneticField]) -> None:
        self.imu.append(imu.values)
        self.mag.append(mag.values)

    def finish(self) -> lf.Attitude | None:
        imu, mag = lf.Imu.concat(self.imu), lf.MagneticField.concat(self.mag)
        if not len(imu):
            return None
        columns: Any = imu.t, imu.angular_velocity, imu.linear_acceleration
        quaternion = smoother.smooth(*columns, mag.t, mag.magnetic_field, *self.constants)
        if self.params.output_advance:
            ahead = 0.5 * self.params.output_advance * imu.angular_velocity
            turn = np.concatenate([ahead, np.ones((len(imu), 1))], axis=1)
            quaternion = smoother.product(quaternion, turn)
        return lf.Attitude(imu.t, np.ascontiguousarray(quaternion))
