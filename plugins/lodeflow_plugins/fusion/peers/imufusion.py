"""The AHRS algorithm of x-io Technologies, by the package imufusion."""

import math
from typing import Annotated, Any

import numpy as np
from pydantic import Field

import lodeflow as lf
from lodeflow_plugins.fusion.peers.common import RatedPeer, RateParams, missing, scalar_last

try:
    import imufusion
except ImportError as error:
    raise missing("imufusion", error) from error


class ImuFusion(RatedPeer):
    """Complementary filter of x-io Fusion by the package `imufusion`, with rejection and bias.

    Inputs in the body frame (FLU), output magnetic ENU <- FLU, one estimate for each IMU sample
    from the first one on; the filter begins level and to the east, and settles within 3 s.

    Source: Madgwick 2014, AHRS algorithms and calibration solutions, chapter 7 (PhD thesis,
    University of Bristol), and the package's documentation.
    """

    class Params(RateParams):
        """Settings of the filter."""

        gain: float = Field(0.5, ge=0)
        """Weight of accelerometer and magnetometer against the gyroscope."""
        gyro_range: Annotated[float | None, lf.RadPerSecond] = Field(None, gt=0)
        """Range of the gyroscope, beyond which the filter begins anew; null for none."""
        acceleration_rejection: Annotated[float | None, lf.Radian] = Field(math.radians(10), gt=0)
        """Angle by which the specific force may differ from the estimate; null rejects none."""
        magnetic_rejection: Annotated[float | None, lf.Radian] = Field(math.radians(10), gt=0)
        """Angle by which the field may differ from the estimate; null rejects none."""
        rejection_timeout: Annotated[float, lf.Second] = Field(5.0, ge=0)
        """Time of rejection after which a source is believed again."""
        bias: bool = True
        """Whether the bias of the gyroscope is estimated at rest."""

    def make(self, rate: float) -> Any:
        p = self.params
        settings = imufusion.AhrsSettings()
        # One by one: the constructor of imufusion 1.3 takes a convention, and forgets it.
        settings.sample_rate = rate
        settings.convention = imufusion.CONVENTION_ENU
        settings.gain = p.gain
        settings.gyroscope_range = math.degrees(p.gyro_range or 0.0)
        settings.acceleration_rejection = math.degrees(p.acceleration_rejection or 0.0)
        settings.magnetic_rejection = math.degrees(p.magnetic_rejection or 0.0)
        settings.rejection_timeout = p.rejection_timeout
        ahrs = imufusion.Ahrs()
        ahrs.set_settings(settings)
        bias = imufusion.Bias()
        bias.set_settings(imufusion.BiasSettings(sample_rate=rate))
        return ahrs, bias

    def feed(self, wrapped: Any, imu: lf.Imu, field: np.ndarray | None) -> np.ndarray | None:
        ahrs, bias = wrapped
        rate = np.degrees(imu.angular_velocity)
        if self.params.bias:
            rate = bias.update(rate)
        force = imu.linear_acceleration / lf.STANDARD_GRAVITY
        if field is None:
            ahrs.update_no_magnetometer(rate, force)
        else:
            ahrs.update(rate, force, field * 1e6)
        return scalar_last(ahrs.get_quaternion())
