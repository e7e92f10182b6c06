"""The filters of Madgwick and Mahony, by the package ahrs."""

import math
from typing import Any

import numpy as np
from pydantic import Field

import lodeflow as lf
from lodeflow_plugins.fusion.peers.common import Peer, missing, scalar_last
from lodeflow_plugins.fusion.tilt_compass.compass import measure

try:
    from ahrs import filters
except ImportError as error:
    raise missing("ahrs", error) from error

SQRT_HALF = math.sqrt(0.5)


class _Ahrs(Peer):
    """Base: begins with the attitude that accelerometer and magnetometer measure."""

    def start(self) -> None:
        super().start()
        measure(np.zeros((0, 3)), np.zeros((0, 3)))  # compiles
        self.filter = self.make()
        self.last = 0
        self.quaternion: np.ndarray | None = None  # w, x, y, z in the filter's own earth frame

    def advance(self, imu: lf.Imu, field: np.ndarray | None) -> np.ndarray | None:
        if self.quaternion is None:
            if field is None:
                return None
            _, measured = measure(imu.linear_acceleration[None], field[None])
            if np.isnan(measured).any():
                return None
            self.quaternion = self.begin(np.roll(measured[0], 1))
        else:
            dt = (imu.t - self.last) * 1e-9
            rate, force = imu.angular_velocity, imu.linear_acceleration
            with np.errstate(invalid="ignore"):
                if field is None:
                    updated = self.filter.updateIMU(self.quaternion, rate, force, dt=dt)
                else:
                    updated = self.filter.updateMARG(
                        self.quaternion, rate, force, field * 1e9, dt=dt
                    )
            updated = np.array(updated, np.float64)
            # Without noise the gradient can be exactly zero, and the package divides by its norm.
            if np.isfinite(updated).all():
                self.quaternion = updated
        self.last = imu.t
        return scalar_last(self.enu(self.quaternion))

    def make(self) -> Any:
        """Return a new filter."""
        raise NotImplementedError

    def begin(self, enu: np.ndarray) -> np.ndarray:
        """Turn a quaternion w, x, y, z from ENU <- body into the filter's earth frame."""
        return enu

    def enu(self, quaternion: np.ndarray) -> np.ndarray:
        """Turn a quaternion w, x, y, z of the filter into ENU <- body."""
        return quaternion


class AhrsMadgwick(_Ahrs):
    """Madgwick's gradient descent filter by the package `ahrs`.

    Inputs in the body frame (FLU), output magnetic ENU <- FLU, one estimate for each IMU sample
    from the first magnetometer reading on.

    Source: Madgwick, Harrison, Vaidyanathan 2011, Estimation of IMU and MARG orientation using a
    gradient descent algorithm, IEEE ICORR.
    """

    class Params(lf.Params):
        """Settings of the filter."""

        gain: float = Field(0.041, gt=0)
        """Rate, in rad/s, at which the estimate is moved towards the measured directions (the
        paper's beta)."""

    def make(self) -> Any:
        return filters.Madgwick(gain=self.params.gain)

    def begin(self, enu: np.ndarray) -> np.ndarray:
        # Its earth frame is NWU, and turning by -90 degrees about z leads from ENU to it.
        w, x, y, z = enu
        return SQRT_HALF * np.array([w + z, x + y, y - x, z - w])

    def enu(self, quaternion: np.ndarray) -> np.ndarray:
        w, x, y, z = quaternion
        return SQRT_HALF * np.array([w - z, x - y, x + y, w + z])


class AhrsMahony(_Ahrs):
    """Mahony's complementary filter with bias by the package `ahrs`.

    Inputs in the body frame (FLU), output magnetic ENU <- FLU, one estimate for each IMU sample
    from the first magnetometer reading on.

    Source: Mahony, Hamel, Pflimlin 2008, Nonlinear Complementary Filters on the Special
    Orthogonal Group, IEEE Transactions on Automatic Control 53(5), 1203-1218.
    """

    class Params(lf.Params):
        """Gains of the filter."""

        proportional: float = Field(1.0, gt=0)
        """Rate, in rad/s for each rad of error, of the correction (the paper's k_P)."""
        integral: float = Field(0.3, gt=0)
        """Rate of the correction of the bias, in rad/s² for each rad of error (k_I)."""

    def make(self) -> Any:
        return filters.Mahony(k_P=self.params.proportional, k_I=self.params.integral)
