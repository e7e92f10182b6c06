"""The offline variant of VQF, by the package vqf."""

import math
from typing import Annotated

import numpy as np
from pydantic import Field

import lodeflow as lf
from lodeflow_plugins.fusion.peers.common import RateParams, missing, scalar_last

try:
    import vqf
except ImportError as error:
    raise missing("vqf", error) from error


class OfflineVqf(lf.Node):
    """Offline VQF by the package `vqf`: attitude of a recording from what came before and after.

    Inputs in the body frame (FLU), at common stamps; at the end of the streams, and not before,
    come the attitudes, magnetic ENU <- FLU, of all of them; none if there is but one. For
    recordings of at most 30 days. Null for the rate is the mean of the stamps.

    Source: Laidig and Seel 2023, Information Fusion 91, 187-204.
    """

    sync = lf.Exact()
    lookback = lf.seconds(30 * 86400)

    class Params(RateParams):
        """Those of the parameters that one changes; defaults are those of the package."""

        tau_acc: Annotated[float, lf.Second] = Field(3.0, gt=0)
        """Time constant of the low pass of the specific force."""
        tau_mag: Annotated[float, lf.Second] = Field(9.0, gt=0)
        """Time constant of the correction of the heading."""
        bias_sigma_init: Annotated[float, lf.RadPerSecond] = Field(math.radians(0.5), gt=0)
        """Standard deviation of the bias at the beginning."""

    def start(self) -> None:
        self.imu: list[lf.Imu] = []
        self.mag: list[lf.MagneticField] = []

    def step_block(self, imu: lf.Imu, mag: lf.MagneticField) -> None:
        self.imu.append(imu)
        self.mag.append(mag)

    def finish(self) -> lf.Attitude | None:
        imu, mag = lf.Imu.concat(self.imu), lf.MagneticField.concat(self.mag)
        if len(imu) < 2:  # no interval
            return None
        p = self.params
        interval = 1.0 / p.rate if p.rate else 1e-9 * float(np.diff(imu.t).mean())
        given = {
            "tauAcc": p.tau_acc,
            "tauMag": p.tau_mag,
            "biasSigmaInit": math.degrees(p.bias_sigma_init),
        }
        columns = imu.angular_velocity, imu.linear_acceleration, mag.magnetic_field
        found = vqf.offlineVQF(*map(np.ascontiguousarray, columns), interval, given)
        return lf.Attitude(imu.t, scalar_last(found["quat9D"]))
