"""The tilt correction as nodes."""

import math
from typing import Annotated, NamedTuple

import numpy as np
from pydantic import Field

import lodeflow as lf
from lodeflow_plugins.filtering import smoothing
from lodeflow_plugins.gravimetry.tilt import correction


class Corrections(NamedTuple):
    """Ports of `TiltCorrection`."""

    classical: lf.GravityCorrection | None
    modified: lf.GravityCorrection | None
    exact: lf.GravityCorrection | None


class LowPass(lf.Params):
    """A low-pass without phase."""

    sample_rate: Annotated[float, lf.Hertz] = Field(2.0, gt=0)
    """Rate of the input; only the filter needs it."""
    period: Annotated[float | None, lf.Second] = Field(60.0, gt=0)
    """Period at which the filter halves the signal; null for no filter."""

    def weights(self) -> np.ndarray:
        """Weights of the filter, (n,)."""
        if self.period is None:
            return np.ones(1)
        return smoothing.low_pass(1.0 / self.period, self.sample_rate)


class Filtered(lf.Node):
    """Base of the nodes that look at the middle of a window."""

    @property
    def lookback(self) -> int:
        """The whole window: the half that it takes, and as much again for uneven stamps."""
        p = self.params
        window = 0.0 if p.period is None else 2.0 * smoothing.reach(1.0 / p.period)
        return lf.seconds(window + 2.0 / p.sample_rate)


class TiltCorrection(Filtered):
    """Correction for the tilt of a gravimeter's platform, to be added to its vertical reading.

    Three streams: `classical` leaves the Coriolis acceleration and the deflection of the vertical
    out, `modified` has them, `exact` has no approximation at all. All inputs go through one and
    the same low-pass before anything is squared: a bandwidth that differs between the specific
    force and the acceleration would stay in the squares. So the corrections begin and end
    1.1 periods after and before the data.

    force: specific force along the platform's axes (x east, y north, z up). acceleration: of the
    vehicle, from GNSS (`kinematic_acceleration`). coriolis: `horizontal_coriolis`. disturbance:
    horizontal disturbing gravity (`disturbing_gravity`), if it is known along the line; a constant
    deflection is a parameter.

    Source: Liu et al. 2018, Geomatics and Information Science of Wuhan University 43(4), 586-591.
    """

    sync = lf.Exact()

    class Params(LowPass):
        """Filter, gravity and deflection."""

        gravity: Annotated[float | None, lf.MeterPerSecondSquared] = Field(
            lf.STANDARD_GRAVITY, gt=0
        )
        """g of the two approximations; null takes the vertical specific force of each sample,
        which is better where the vehicle accelerates vertically."""
        deflection_north: Annotated[float, lf.Radian] = 0.0
        """xi, component of the deflection of the vertical to the north."""
        deflection_east: Annotated[float, lf.Radian] = 0.0
        """eta, component to the east."""

    def start(self) -> None:
        p = self.params
        g = lf.STANDARD_GRAVITY if p.gravity is None else p.gravity
        self.gravity = 0.0 if p.gravity is None else p.gravity
        self.constant = -g * np.array([p.deflection_east, p.deflection_north])
        self.weights = p.weights()
        self.state = smoothing.new_columns(self.weights, 9)
        self.correct(np.empty(0, np.int64), np.empty((0, 9)))  # compiles

    def correct(self, t: np.ndarray, columns: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Stamps (M,) and corrections (M, 3) of filtered columns (N, 9)."""
        at, out = np.empty(len(t), np.int64), np.empty(columns.shape)
        found = smoothing.smooth(t, columns, self.weights, *self.state, at, out)
        # In one layout: the kernel would be compiled again for another.
        f, a, c, d = (
            np.ascontiguousarray(out[:found, i:j]) for i, j in ((0, 3), (3, 5), (5, 7), (7, 9))
        )
        return at[:found], correction.corrections(f, a, c, d, self.gravity)

    def step_block(
        self,
        force: lf.SpecificForce,
        acceleration: lf.Acceleration,
        coriolis: lf.Acceleration,
        disturbance: lf.Acceleration | None = None,
    ) -> Corrections:
        columns = np.empty((len(force.t), 9))
        columns[:, :3] = force.specific_force
        columns[:, 3:5] = acceleration.acceleration[:, :2]
        columns[:, 5:7] = coriolis.acceleration[:, :2]
        columns[:, 7:9] = self.constant
        if disturbance is not None:
            columns[:, 7:9] += disturbance.acceleration[:, :2]
        t, found = self.correct(force.t, columns)
        streams = []
        for which in range(3):
            known = ~np.isnan(found[:, which])
            streams.append(lf.GravityCorrection(t[known], found[known, which]))
        return Corrections(*streams)


class GravityLowPass(Filtered):
    """Low-pass of a stream of corrections, without phase: each at the stamp that it belongs to."""

    class Params(LowPass):
        """The filter."""

        period: Annotated[float | None, lf.Second] = Field(100.0, gt=0)
        """Period at which the filter halves the signal; null for no filter."""

    def start(self) -> None:
        self.weights = self.params.weights()
        self.state = smoothing.new_columns(self.weights, 1)
        self.step_block(lf.GravityCorrection.empty())  # compiles

    def step_block(self, raw: lf.GravityCorrection) -> lf.GravityCorrection:
        at, out = np.empty(len(raw), np.int64), np.empty((len(raw), 1))
        column = raw.correction[:, None]
        found = smoothing.smooth(raw.t, column, self.weights, *self.state, at, out)
        return lf.GravityCorrection(at[:found].copy(), out[:found, 0].copy())


class TiltErrorBudget(lf.Node):
    """How errors of the observations pass into the tilt correction, to first order.

    Takes the means of the horizontal specific force and acceleration over the run. One message,
    at the end.

    Source: Liu et al. 2018, Tables 1 and 2; the meaning of their columns is inferred.
    """

    sync = lf.Exact()

    class Params(lf.Params):
        """The errors."""

        error: Annotated[float, lf.Gravity] = Field(1e-4, ge=0)
        """Standard deviation M of each component of force and acceleration, and of gravity."""
        gravity: Annotated[float, lf.MeterPerSecondSquared] = Field(9.8, gt=0)
        """g."""
        angle_step: Annotated[float, lf.Radian] = Field(0.0, ge=0)
        """The angle is rounded to this before it is used; the paper's Table 2 is made with angles
        rounded to 0.01 arcsec. 0 for exact angles."""

    def start(self) -> None:
        self.force, self.acceleration = np.zeros(2), np.zeros(2)
        self.samples = 0
        self.last: int | None = None
        correction.add_rows(np.empty((0, 3)), self.force)  # compiles

    def step_block(self, force: lf.SpecificForce, acceleration: lf.Acceleration) -> None:
        correction.add_rows(force.specific_force, self.force)
        correction.add_rows(acceleration.acceleration, self.acceleration)
        self.samples += len(force)
        self.last = int(force.t[-1]) if len(force) else self.last

    def finish(self) -> lf.TiltErrorScore | None:
        if self.last is None:
            return None
        p = self.params
        f, a = self.force / self.samples, self.acceleration / self.samples
        observations = correction.by_observations(f, a, p.error, p.gravity)
        size = float(f @ f - a @ a) / (2.0 * p.gravity)
        gravity = correction.by_gravity(size, p.error, p.gravity)
        angle = correction.tilt_error(p.error, p.gravity)
        if p.angle_step:
            angle = round(angle / p.angle_step) * p.angle_step
        return lf.TiltErrorScore(
            self.last,
            observations,
            gravity,
            math.hypot(observations, gravity),
            angle,
            correction.by_tilt(f, angle),
        )
