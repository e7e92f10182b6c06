"""The heading estimator as a node."""

from typing import Annotated

import numpy as np
from pydantic import Field

import lodeflow as lf
from lodeflow_plugins.interference.heading_estimator import filter as estimator
from lodeflow_plugins.interference.heading_estimator.model import Assumptions, new_state
from lodeflow_plugins.interference.heading_ports import (
    HeadingPorts,
    at_gyro,
    no_rows,
    rate_to_the_right,
)

FRD = np.array([1.0, -1.0, -1.0])
"""Signs from forward, left, up to forward, right, down."""
USUAL = Assumptions()
AT_20_HZ = 0.05**0.5
"""Square root of the period, s, to which noises per sample belong."""


class HeadingEstimator(lf.Node):
    """Heading from two compasses and a rate gyro that may be disturbed at any time.

    A Kalman filter of heading, gyro bias and scale, and the residual hard and soft iron of both
    compasses. A disturbance is taken for noise that is correlated over some time, as strong as
    field strength, gradient between the compasses, vertical field and gyro say, so the compass is
    weighted down and never shut out. Takes the place of `integrated_heading`; the mode is not
    used. `status` has the heading's standard deviation, and whether it can be relied on.

    Level body. The defaults are for the sensors of `vehicle_in_city`: set those of the sensors
    from data sheets or from a recording at rest, and leave the others alone.
    """

    sync = lf.Each()

    class Params(lf.Params):
        """The sensors, then how disturbances behave, then what is called valid."""

        dip: Annotated[float, lf.Radian] = Field(USUAL.dip, gt=-1.4, lt=1.4)
        """Of the earth's field, downwards."""
        use_vertical: bool = True
        """Use the vertical field; false for compasses that measure only the horizontal one."""
        gyro_noise: Annotated[float, lf.RadPerSecond] = Field(float(np.radians(0.15)), gt=0)
        """White noise of the rate per sample at 20 Hz; at another rate, of the same density."""
        gyro_walk: Annotated[float, lf.RadPerSecond] = Field(USUAL.gyro_walk, gt=0)
        """Random walk of the gyro's bias in a second. Rather too large than too small."""
        gyro_bias: Annotated[float, lf.RadPerSecond] = Field(USUAL.gyro_bias, gt=0)
        """Bias at the start, one standard deviation."""
        gyro_scale: float = Field(USUAL.gyro_scale, ge=0)
        """Scale error of the gyro, one standard deviation."""
        compass_noise: float = Field(USUAL.compass_noise, gt=0)
        """White noise of a compass per sample and axis, in units of the horizontal field."""
        compass_colour: float = Field(USUAL.compass_colour / AT_20_HZ, gt=0)
        """Slow errors of an undisturbed compass (tilt, coloured noise), as white noise per sample
        at 20 Hz that weighs as much."""
        place: float = Field(USUAL.place, gt=0)
        """How much the field of clean places differs, in units of the horizontal field."""
        gradient: float = Field(USUAL.gradient, gt=0)
        """How much it differs from one compass to the other."""
        calibration: float = Field(USUAL.calibration, gt=0)
        """Residual hard and soft iron, one standard deviation, in units of the horizontal field."""
        calibration_walk: float = Field(USUAL.calibration_walk, ge=0)
        """Its random walk in a second."""
        correlation: Annotated[float, lf.Second] = Field(USUAL.correlation, gt=0)
        """Time over which a disturbance is one and the same error."""
        smoothing: Annotated[float, lf.Second] = Field(USUAL.smoothing, gt=0)
        """Time constant of the residuals by which a disturbance is seen."""
        hold: Annotated[float, lf.Second] = Field(USUAL.hold, gt=0)
        """Time constant with which a disturbance that is over is forgotten."""
        gradient_gate: float = Field(USUAL.gradient_gate, gt=0)
        """Standard deviations above which a difference of the compasses is a gradient."""
        return_time: Annotated[float, lf.Second] = Field(USUAL.return_time, gt=0)
        """Time after which a clean field wins against the gyro."""
        opening_after: Annotated[float, lf.Second] = Field(USUAL.opening_after, gt=0)
        """Disturbance after which the hard iron may have changed."""
        opening_walk: float = Field(USUAL.opening_walk, ge=0)
        """Random walk of the hard iron then, in a second of a turn with 5 deg/s."""
        settled: Annotated[float, lf.Second] = Field(USUAL.settled, ge=0)
        """Clean field after which the first heading can be valid."""
        anchored: Annotated[float, lf.Second] = Field(USUAL.anchored, gt=0)
        """Clean field after which a heading becomes an anchor."""
        lasting: float = Field(USUAL.lasting, ge=0)
        """The same after a disturbance, as a share of its time."""
        accepted: Annotated[float, lf.Second] = Field(USUAL.accepted, gt=0)
        """Clean field after which it replaces an anchor that contradicts it."""
        valid_sigma: Annotated[float, lf.Radian] = Field(float(np.radians(3.0)), gt=0)
        """Largest sigma of a heading that is called valid."""
        agreement: Annotated[float, lf.Radian] = Field(float(np.radians(4.3)), gt=0)
        """Largest difference of a compass heading that agrees with the estimate."""
        undisturbed: float = Field(float(np.radians(1.5)), gt=0)
        """Largest disturbance of a compass that is called undisturbed."""

    def start(self) -> None:
        given = self.params.model_dump()
        own = {name: given.pop(name) for name in ("valid_sigma", "agreement", "undisturbed")}
        self.limits = tuple(own.values())
        given["vertical"] = float(given.pop("use_vertical"))
        given["gyro_noise"] *= AT_20_HZ
        given["compass_colour"] *= AT_20_HZ
        self.constants = Assumptions(**given).constants()
        self.state = new_state()
        self.step_block(no_rows(lf.CompassFeatures), no_rows(lf.AngularRate))  # compiles

    def step_block(
        self,
        compass: lf.Sparse[lf.CompassFeatures],
        gyro: lf.Sparse[lf.AngularRate],
        mode: lf.Sparse[lf.Mode] | None = None,
    ) -> HeadingPorts | None:
        valid_sigma, agreement, undisturbed = self.limits
        out = np.empty((len(gyro.t), 5))
        first = estimator.run(
            gyro.t,
            rate_to_the_right(gyro),
            gyro.rows,
            compass.values.first_field * FRD,
            compass.values.second_field * FRD,
            compass.rows,
            self.constants,
            self.state,
            out,
        )
        sigma, disturbance, apart = out[:, 1], out[:, 2], np.abs(out[:, 3])
        columns = (
            sigma,
            disturbance,
            (sigma < valid_sigma).astype(np.int64),
            (apart < agreement).astype(np.int64),
            (disturbance < undisturbed).astype(np.int64),
        )
        return at_gyro(gyro, first, out[:, 0], columns)
