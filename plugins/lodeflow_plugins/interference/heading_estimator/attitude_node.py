"""The heading estimator for a body that tilts, as a node in the place of `heading_kalman`."""

from typing import Annotated, NamedTuple

import numpy as np
from pydantic import Field

import lodeflow as lf
from lodeflow_plugins.interference.heading_estimator import levelled
from lodeflow_plugins.interference.heading_estimator.model import Assumptions, new_state
from lodeflow_plugins.interference.heading_estimator.node import AT_20_HZ, USUAL
from lodeflow_plugins.interference.heading_ports import no_rows


class AttitudePorts(NamedTuple):
    """Attitude with a heading, and how good that heading is."""

    attitude: lf.Attitude | None
    status: lf.HeadingStatus | None


class AttitudeHeadingEstimator(lf.Node):
    """Heading for an attitude without one, by the filter of `heading_estimator`.

    Attitude: level frame <- body, with z up and any heading that drifts slowly, such as that of
    `inertial_attitude`. Output: magnetic ENU <- body, with the same inclination, from the end of
    `start_duration` on, over which the undisturbed field is measured. A reading of the
    magnetometer counts where an attitude has its stamp. Hard iron is not estimated.

    The defaults are for a small IMU and magnetometer indoors, from data sheets and the limits
    that other filters set by default: bias and drift as `inertial_attitude` leaves them, and a
    field that differs by a tenth from place to place.

    Source: our own; docs/interference.md.
    """

    sync = lf.Each()

    class Params(lf.Params):
        """What is assumed of attitude, magnetometer and place, and of disturbances."""

        start_duration: Annotated[float, lf.Second] = Field(1.0, ge=0)
        """For how long the undisturbed field is averaged at the start."""
        heading_noise: Annotated[float, lf.RadPerSecond] = Field(float(np.radians(0.05)), gt=0)
        """Noise of the attitude's heading rate per sample at 20 Hz; at another rate, of the same
        density."""
        drift: Annotated[float, lf.RadPerSecond] = Field(float(np.radians(0.1)), gt=0)
        """Rate at which its heading drifts at the start, one standard deviation."""
        drift_walk: Annotated[float, lf.RadPerSecond] = Field(float(np.radians(0.01)), gt=0)
        """Random walk of that rate in a second."""
        compass_noise: float = Field(0.02, gt=0)
        """White noise of the field per sample and axis, in units of the horizontal field."""
        compass_colour: float = Field(USUAL.compass_colour / AT_20_HZ, gt=0)
        """Slow errors of an undisturbed field, as white noise per sample at 20 Hz that weighs as
        much."""
        place: float = Field(0.1, gt=0)
        """How much the field of clean places differs, in units of the horizontal field."""
        correlation: Annotated[float, lf.Second] = Field(USUAL.correlation, gt=0)
        """Time over which a disturbance is one and the same error."""
        smoothing: Annotated[float, lf.Second] = Field(USUAL.smoothing, gt=0)
        """Time constant of the residuals by which a disturbance is seen."""
        hold: Annotated[float, lf.Second] = Field(USUAL.hold, gt=0)
        """Time constant with which a disturbance that is over is forgotten."""
        return_time: Annotated[float, lf.Second] = Field(USUAL.return_time, gt=0)
        """Time after which a clean field wins against the gyro."""
        valid_sigma: Annotated[float, lf.Radian] = Field(float(np.radians(3.0)), gt=0)
        """Largest sigma of a heading that is called valid."""
        agreement: Annotated[float, lf.Radian] = Field(float(np.radians(4.3)), gt=0)
        """Largest difference of a compass heading that agrees with the estimate."""
        undisturbed: float = Field(float(np.radians(1.5)), gt=0)
        """Largest disturbance of a compass that is called undisturbed."""

    def start(self) -> None:
        p = self.params
        self.constants = Assumptions(
            dip=0.0,
            gyro_noise=p.heading_noise * AT_20_HZ,
            gyro_walk=p.drift_walk,
            gyro_bias=p.drift,
            gyro_scale=0.0,
            compass_noise=p.compass_noise,
            compass_colour=p.compass_colour * AT_20_HZ,
            place=p.place,
            calibration=1e-9,
            calibration_walk=0.0,
            correlation=p.correlation,
            smoothing=p.smoothing,
            hold=p.hold,
            return_time=p.return_time,
            opening_walk=0.0,
        ).constants()
        self.state, self.place = new_state(), levelled.new_place()
        self.step_block(no_rows(lf.Attitude), no_rows(lf.MagneticField))  # compiles

    def step_block(
        self, attitude: lf.Sparse[lf.Attitude], mag: lf.Sparse[lf.MagneticField]
    ) -> AttitudePorts | None:
        p, n = self.params, len(attitude.values)
        out, status = np.empty((n, 4)), np.empty((n, 5))
        first = levelled.run(
            attitude.t,
            attitude.values.quaternion,
            attitude.rows,
            mag.values.magnetic_field,
            mag.rows,
            p.start_duration,
            self.constants,
            self.state,
            self.place,
            out,
            status,
        )
        if first == n:
            return None
        t = attitude.values.t[first:]
        sigma, disturbance, apart = (np.ascontiguousarray(status[first:, i]) for i in (1, 2, 3))
        return AttitudePorts(
            lf.Attitude(t, np.ascontiguousarray(out[first:])),
            lf.HeadingStatus(
                t,
                sigma,
                disturbance,
                (sigma < p.valid_sigma).astype(np.int64),
                (np.abs(apart) < p.agreement).astype(np.int64),
                (disturbance < p.undisturbed).astype(np.int64),
            ),
        )
