"""VQF, by the package vqf."""

import math
from typing import Annotated, Any

import numpy as np
from pydantic import Field

import lodeflow as lf
from lodeflow_plugins.fusion.peers.common import RatedPeer, RateParams, missing, scalar_last

try:
    import vqf
except ImportError as error:
    raise missing("vqf", error) from error


class Vqf(RatedPeer):
    """VQF by the package `vqf`: low pass in an almost inertial frame, bias, magnetic rejection.

    Inputs in the body frame (FLU), output magnetic ENU <- FLU, one estimate for each IMU sample
    from the first magnetometer reading on. Rows in which both meet are updated as a batch, with
    the same bytes as one by one.

    Source: Laidig and Seel 2023, VQF: Highly Accurate IMU Orientation Estimation with Bias
    Estimation and Magnetic Disturbance Rejection, Information Fusion 91, 187-204.
    """

    class Params(RateParams):
        """Those of the parameters of VQF that one changes; defaults are those of the package."""

        mag_rate: Annotated[float | None, lf.Hertz] = Field(None, gt=0)
        """Rate of the magnetometer; null for that of the IMU."""
        tau_acc: Annotated[float, lf.Second] = Field(3.0, gt=0)
        """Time constant of the low pass of the specific force."""
        tau_mag: Annotated[float, lf.Second] = Field(9.0, gt=0)
        """Time constant of the correction of the heading."""
        motion_bias: bool = True
        """Whether the bias of the gyroscope is estimated in motion."""
        rest_bias: bool = True
        """Whether rest is detected, and the bias of the gyroscope estimated then."""
        magnetic_rejection: bool = True
        """Whether disturbances of the field are detected and rejected, by its norm and dip."""
        bias_sigma_init: Annotated[float, lf.RadPerSecond] = Field(math.radians(0.5), gt=0)
        """Standard deviation of the bias at the beginning."""
        rest_gyro: Annotated[float, lf.RadPerSecond] = Field(math.radians(2.0), gt=0)
        """Largest deviation of the angular rate from its low pass at rest."""
        rest_acc: Annotated[float, lf.MeterPerSecondSquared] = Field(0.5, gt=0)
        """Largest deviation of the specific force from its low pass at rest."""
        norm_tolerance: float = Field(0.1, gt=0)
        """Largest relative deviation of the norm of the field from its reference."""
        dip_tolerance: Annotated[float, lf.Radian] = Field(math.radians(10.0), gt=0)
        """Largest deviation of the dip angle of the field from its reference."""

    def start(self) -> None:
        super().start()
        self.has_heading = False

    def make(self, rate: float) -> Any:
        p = self.params
        return vqf.VQF(
            1.0 / rate,
            magTs=1.0 / (p.mag_rate or rate),
            tauAcc=p.tau_acc,
            tauMag=p.tau_mag,
            motionBiasEstEnabled=p.motion_bias,
            restBiasEstEnabled=p.rest_bias,
            magDistRejectionEnabled=p.magnetic_rejection,
            biasSigmaInit=math.degrees(p.bias_sigma_init),
            restThGyr=math.degrees(p.rest_gyro),
            restThAcc=p.rest_acc,
            magNormTh=p.norm_tolerance,
            magDipTh=math.degrees(p.dip_tolerance),
        )

    def feed(self, wrapped: Any, imu: lf.Imu, field: np.ndarray | None) -> np.ndarray | None:
        wrapped.update(imu.angular_velocity, imu.linear_acceleration, field)
        self.has_heading = self.has_heading or field is not None
        return scalar_last(wrapped.getQuat9D()) if self.has_heading else None

    def step_block(
        self, imu: lf.Sparse[lf.Imu], mag: lf.Sparse[lf.MagneticField]
    ) -> lf.Attitude | None:
        rows = len(imu.t)
        meet = len(imu.values) == rows == len(mag.values)
        found = []
        for row in range(rows):
            if meet and self.filter is not None and self.field is None:
                quaternion = self._batch(imu.values[row:], mag.values[row:])
                found.append(lf.Attitude(imu.t[row:], quaternion))
                break
            at = imu.rows[row], mag.rows[row]
            one = self.step(
                imu.values[int(at[0])] if at[0] >= 0 else None,
                mag.values[int(at[1])] if at[1] >= 0 else None,
            )
            found += [] if one is None else [one.as_block()]
        return lf.Attitude.concat(found) if found else None

    def _batch(self, imu: lf.Imu, mag: lf.MagneticField) -> np.ndarray:
        """Update with rows (N,) that all have a reading; return the estimates (N, 4)."""
        self.has_heading = True
        columns = imu.angular_velocity, imu.linear_acceleration, mag.magnetic_field
        updated = self.filter.updateBatch(*map(np.ascontiguousarray, columns))
        return scalar_last(updated["quat9D"])
