"""The heading stage as a node."""

import math
from typing import Annotated, NamedTuple

import numpy as np
from pydantic import Field, model_validator

import lodeflow as lf
from lodeflow_plugins.fusion.heading_kalman import filter as heading

DEGREE = math.pi / 180.0
UPRIGHT, NO_FIELD = np.array([0.0, 0.0, 0.0, 1.0]), np.zeros(3)


class Estimates(NamedTuple):
    """Ports of `HeadingKalman`."""

    attitude: lf.Attitude | None
    state: lf.HeadingState | None


class HeadingKalman(lf.Node):
    """Heading for an attitude without one, from the magnetic field, by a Kalman filter.

    Attitude: earth <- body with z up and any heading that drifts slowly, such as that of
    `inertial_attitude`. Output, for each of them from the first on: magnetic ENU <- body, with
    the same inclination. Before the first field the heading is what came in.

    The magnetometer may be slower than the attitude, have gaps, be stamped apart, lag behind
    (the lag is estimated), and repeat its last reading (which counts once); zeros are no reading.
    Where the field is disturbed the heading coasts on the gyroscope. A magnet that is put on the
    body is recognised once the body has turned with it for some seconds, and subtracted.

    `state` says how far the heading is to be trusted, how disturbed the field is, and what else
    is estimated. A field that is wrong from the start and stays so looks like that of the earth:
    where the earth's field is known, say so with `expected_norm` and `expected_dip`, and the
    variance tells.

    Source: see `kalman.py`; heading after inclination as in Laidig and Seel 2023.
    """

    sync = lf.Each()

    class Params(lf.Params):
        """Noise of what is estimated; one set of values for all motions and disturbances."""

        heading_walk: Annotated[float, lf.AngleRandomWalk] = Field(0.05 * DEGREE, ge=0)
        """Random walk of the heading that comes in, beside its drift."""
        drift: Annotated[float, lf.RadPerSecond] = Field(0.1 * DEGREE, ge=0)
        """Standard deviation of its drift; larger follows the compass sooner, and coasts worse.
        With 0 and a heading_walk of 0.6 deg/√s the filter has a state less and is nearly as good,
        but coasts worse."""
        drift_time: Annotated[float, lf.Second] = Field(60.0, gt=0)
        """Time constant with which a drift dies out."""
        field_walk: Annotated[float, lf.TeslaRandomWalk] = Field(0.05e-6, ge=0)
        """Random walk of the undisturbed field, horizontal and vertical."""
        disturbance: Annotated[float, lf.Tesla] = Field(2e-6, gt=0)
        """Standard deviation of the field's disturbance, on each axis, in usual surroundings."""
        disturbance_time: Annotated[float, lf.Second] = Field(0.2, gt=0)
        """Time constant of the disturbance; longer trusts the compass less."""
        level_time: Annotated[float, lf.Second] = Field(1.0, gt=0)
        """Time constant with which the level of the disturbance falls."""
        field_noise: Annotated[float, lf.TeslaNoiseDensity] = Field(0.132e-6, gt=0)
        """Noise of the magnetometer."""
        surprise: float = Field(3.0, gt=0)
        """Squared innovation over its variance, mean of three axes, that opens the disturbance."""
        lag: Annotated[float, lf.Second] = Field(0.02, ge=0)
        """Standard deviation of the magnetometer's lag before it is estimated."""
        magnet_time: Annotated[float, lf.Second] = Field(3.0, gt=0)
        """How long a disturbance must turn with the body to be a magnet on it."""
        start_duration: Annotated[float, lf.Second] = Field(3.0, ge=0)
        """For how long the field is averaged before the filter starts."""
        update_interval: Annotated[float, lf.Second] = Field(0.0175, ge=0)
        """Least time between two steps of the filter, in which the fields are averaged."""
        expected_norm: Annotated[float | None, lf.Tesla] = Field(None, gt=0)
        """Strength of the earth's field at the place, if known; with expected_dip. A field that is
        another makes the variance larger, and the heading no other."""
        expected_dip: Annotated[float | None, lf.Radian] = Field(
            None, ge=-math.pi / 2, le=math.pi / 2
        )
        """Its angle below the horizontal."""
        field_tolerance: Annotated[float, lf.Tesla] = Field(0.5e-6, gt=0)
        """How well the expected field is known; only used with it."""
        output_advance: Annotated[float, lf.Second] = Field(0.0, ge=0, le=0.1)
        """Turn the output forward by its rate for so long, where a device is known to be late
        by it; a constant of the device that a reference shows."""
        report_interval: Annotated[float, lf.Second] = Field(0.1, ge=0)
        """Between two messages of `state`; 0 for one with each attitude."""

        @model_validator(mode="after")
        def _both_or_neither(self) -> "HeadingKalman.Params":
            if (self.expected_norm is None) != (self.expected_dip is None):
                raise ValueError("expected_norm and expected_dip belong together")
            return self

        def constants(self) -> np.ndarray:
            """Constants of the compiled filter."""
            given = self.model_dump(exclude={"expected_norm", "expected_dip"})
            norm = math.nan if self.expected_norm is None else self.expected_norm
            dip = self.expected_dip or 0.0
            return heading.constants(
                **given, horizontal=norm * math.cos(dip), vertical=-norm * math.sin(dip)
            )

    def start(self) -> None:
        self.state = heading.new_state(self.params.constants())
        nothing = np.empty(0, np.int64)
        self.step_block(  # compiles
            lf.Sparse(lf.Attitude.empty(), nothing, nothing),
            lf.Sparse(lf.MagneticField.empty(), nothing, nothing),
        )
        spare = heading.new_state(self.params.constants())
        heading.run_one(0, False, UPRIGHT, False, NO_FIELD, spare, np.empty(4))
        heading.report_of(spare)

    def step(self, attitude: lf.Attitude | None, mag: lf.MagneticField | None) -> Estimates | None:
        out, state = np.empty(4), self.state
        if attitude is None:
            heading.run_one(mag.t, False, UPRIGHT, True, mag.magnetic_field, state, out)
            return None
        t, field, measured = attitude.t, NO_FIELD, False
        if mag is not None:
            field, measured = mag.magnetic_field, True
        told = heading.run_one(t, True, attitude.quaternion, measured, field, state, out)
        report = message(t, heading.report_of(state)) if told else None
        return Estimates(lf.Attitude(t, out), report)

    def step_block(
        self, attitude: lf.Sparse[lf.Attitude], mag: lf.Sparse[lf.MagneticField]
    ) -> Estimates:
        out, believed, reports = headed(attitude, mag, self.state)
        t = attitude.values.t
        return Estimates(lf.Attitude(t, out), messages(t[reports], believed))


def headed(
    attitude: lf.Sparse[lf.Attitude],
    mag: lf.Sparse[lf.MagneticField],
    state: np.ndarray,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Run the filter on a block.

    Returns attitude (A, 4), the reports (R, 11), and the attitudes (R,) that they belong to.
    """
    n = len(attitude.values)
    out, believed = np.empty((n, 4)), np.empty((n, heading.REPORTED))
    reports = np.empty(n, np.int64)
    reported = heading.run(
        attitude.t,
        attitude.values.quaternion,
        attitude.rows,
        mag.values.magnetic_field,
        mag.rows,
        state,
        out,
        believed,
        reports,
    )
    return out, believed[:reported], reports[:reported]


def messages(t: np.ndarray, believed: np.ndarray) -> lf.HeadingState:
    """Reports (R, 11) as a block."""
    variance, level, lag, north, up = [believed[:, i].copy() for i in (0, 4, 5, 9, 10)]
    disturbance, hard_iron = [believed[:, i : i + 3].copy() for i in (1, 6)]
    return lf.HeadingState(t, variance, disturbance, level, lag, hard_iron, north, up)


def message(t: int, believed: np.ndarray) -> lf.HeadingState:
    """A report (11,) as a sample."""
    variance, _, _, _, level, lag, _, _, _, north, up = believed.tolist()
    return lf.HeadingState(t, variance, believed[1:4], level, lag, believed[6:9], north, up)
