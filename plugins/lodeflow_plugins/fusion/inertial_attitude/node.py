"""Attitude from gyroscope and accelerometer as a node."""

from typing import Annotated, NamedTuple

import numpy as np
from pydantic import Field

import lodeflow as lf
from lodeflow_plugins.fusion.inertial_attitude import filter as inertial

DEGREE = np.pi / 180.0


class Estimates(NamedTuple):
    """Ports of `InertialAttitude`."""

    attitude: lf.Attitude | None
    bias: lf.GyroBias | None
    rest: lf.Rest | None


class InertialAttitude(lf.Node):
    """Attitude from angular rate and specific force: inclination, and a heading that drifts.

    There is one attitude, earth <- body with z up, for each sample from the first on. Nothing
    measures the heading: it starts at an arbitrary value and drifts as the gyroscope does, some
    degrees in a minute at worst. `heading_kalman` behind it finds north with a magnetometer.

    The bias of the gyroscope is estimated at rest, and in motion from how the inclination has to
    be corrected, so motion must turn each axis out of the vertical now and then. `bias` is a
    report, with its covariance; `rest` tells each change between rest and motion, for example
    for the `when:` of another node. A body in a steady slow turn looks like one at rest: on a
    ship or a turntable set `rest_rate: 0`.

    Samples may come at any rate and with uneven stamps; a specific force of exactly zero counts
    as none. After a gap longer than `rest_time_constant` the vertical is measured anew, and what
    the body turned about it in the gap is not known.

    Source: Laidig and Seel 2023, VQF, Information Fusion 91, 187-204. From the second sample on
    the attitudes are those of the authors' package `vqf` without magnetometer to 1e-11 rad; the
    first differs from theirs about the vertical by one sample's turn.
    """

    class Params(lf.Params):
        """Time constants and standard deviations; the defaults are the paper's, for any body."""

        force_time_constant: Annotated[float, lf.Second] = Field(3.0, gt=0)
        """Of the low-pass of the specific force. Longer trusts the gyroscope more."""
        bias_initial: Annotated[float, lf.RadPerSecond] = Field(0.5 * DEGREE, gt=0)
        """Standard deviation of the bias at the start."""
        bias_forgetting: Annotated[float, lf.Second] = Field(100.0, gt=0)
        """Time in which the standard deviation of the bias grows from 0 to 0.1 deg/s."""
        bias_limit: Annotated[float, lf.RadPerSecond] = Field(2.0 * DEGREE, gt=0)
        """Largest bias that is believed, on each axis. A mean rate above it is no rest."""
        bias_motion: Annotated[float, lf.RadPerSecond] = Field(0.1 * DEGREE, ge=0)
        """Standard deviation to which the bias converges in motion; 0 to estimate none there."""
        bias_rest: Annotated[float, lf.RadPerSecond] = Field(0.03 * DEGREE, gt=0)
        """Standard deviation to which the bias converges at rest."""
        bias_vertical: float = Field(1e-4, gt=0, le=1)
        """In motion the bias about the vertical, which nothing measures, is pulled to zero with
        this weight relative to what is measured about a horizontal axis."""
        rest_duration: Annotated[float, lf.Second] = Field(1.5, ge=0)
        """A body is at rest when it has not deviated from the mean for so long."""
        rest_time_constant: Annotated[float, lf.Second] = Field(0.5, gt=0)
        """Of the low-passes that make that mean."""
        rest_rate: Annotated[float, lf.RadPerSecond] = Field(2.0 * DEGREE, ge=0)
        """Deviation of the angular rate that is motion; 0 for never at rest."""
        rest_force: Annotated[float, lf.MeterPerSecondSquared] = Field(0.5, ge=0)
        """Deviation of the specific force that is motion; 0 for never at rest."""
        report_interval: Annotated[float, lf.Second] = Field(0.1, ge=0)
        """Between two messages of `bias`; 0 for one with each sample."""

        def constants(self) -> np.ndarray:
            """Constants of the compiled filter."""
            return inertial.constants(**self.model_dump())

    def start(self) -> None:
        self.state = inertial.new_state(self.params.constants())
        self.step_block(lf.Imu.empty())  # compiles
        spare = inertial.new_state(self.params.constants())
        inertial.run_one(0, np.zeros(3), np.zeros(3), spare, np.empty(4))

    def step(self, imu: lf.Imu) -> Estimates:
        t, state, quaternion = imu.t, self.state, np.empty(4)
        told = inertial.run_one(t, imu.angular_velocity, imu.linear_acceleration, state, quaternion)
        attitude = lf.Attitude(t, quaternion)
        if not told:
            return Estimates(attitude, None, None)
        bias = lf.GyroBias(t, *inertial.bias_of(state)) if state[inertial.REPORT] else None
        rest = lf.Rest(t, int(state[inertial.RESTING])) if state[inertial.CHANGE] else None
        return Estimates(attitude, bias, rest)

    def step_block(self, imu: lf.Imu) -> Estimates:
        attitude, bias, covariance, resting, reports, changes = levelled(imu, self.state)
        return Estimates(
            lf.Attitude(imu.t, attitude),
            lf.GyroBias(imu.t[reports], bias, covariance),
            lf.Rest(imu.t[changes], resting),
        )


def levelled(imu: lf.Imu, state: np.ndarray) -> tuple[np.ndarray, ...]:
    """Run the filter on a block.

    Returns attitude (N, 4); bias (R, 3) and covariance (R, 3, 3) of the reports; resting (C,) of
    the changes; the rows of the reports (R,) and of the changes (C,).
    """
    n = len(imu)
    attitude, bias, covariance = np.empty((n, 4)), np.empty((n, 3)), np.empty((n, 3, 3))
    resting, reports, changes = [np.empty(n, np.int64) for _ in range(3)]
    reported, changed = inertial.run(
        imu.t,
        imu.angular_velocity,
        imu.linear_acceleration,
        state,
        attitude,
        bias,
        covariance,
        resting,
        reports,
        changes,
    )
    of_reports = [column[:reported].copy() for column in (bias, covariance)]
    return attitude, *of_reports, resting[:changed].copy(), reports[:reported], changes[:changed]
