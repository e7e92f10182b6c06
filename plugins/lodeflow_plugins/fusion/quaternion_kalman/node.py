"""The Kalman filter of Chu et al. as nodes: behind a compass, and with the compass built in."""

import math
from typing import Annotated

import numpy as np
from pydantic import Field

import lodeflow as lf
from lodeflow_plugins.fusion.quaternion_kalman import filter as kalman
from lodeflow_plugins.fusion.quaternion_kalman.fuse import fuse

PRESENT, ABSENT = np.zeros(1, np.int64), np.full(1, -1)


class KalmanParams(lf.Params):
    """Variances of the filter. Only their ratios move the estimate."""

    gyro_noise: Annotated[float, lf.RadPerSecond] = Field(0.01, ge=0)
    """Standard deviation of each axis of the angular rate, per sample. The filter has no state
    for a bias; where there is one, a larger value makes it forget faster."""
    measurement_variance: float = Field(9e-4, gt=0)
    """Variance of each component of the measured quaternion, R = r I. The estimate follows the
    measurement with the time constant 2 sqrt(r) / gyro_noise, in s: 6 s with the defaults."""
    initial_variance: float = Field(9e-4, ge=0)
    """Variance of each component of the first estimate, which is the first measurement."""

    def constants(self) -> np.ndarray:
        """Constants of the compiled filter."""
        return kalman.constants(self.gyro_noise, self.measurement_variance, self.initial_variance)


def held(column: np.ndarray, rows: np.ndarray, before: np.ndarray) -> np.ndarray:
    """For each row the last value at or before it; `before` serves until there is one.

    column: (M, 3), the values present; rows: (N,), their index at each row, -1 for none.
    """
    if len(column) == len(rows):
        return column
    return np.concatenate([before, column])[np.maximum.accumulate(rows) + 1]


def at_samples(imu: lf.Sparse[lf.Imu], first: int, quaternion: np.ndarray) -> lf.Attitude:
    """The estimates from the row `first` on at which there is an IMU sample."""
    if len(imu.values) == len(imu.t):
        return lf.Attitude(imu.t[first:], quaternion[first:])
    rows = first + np.flatnonzero(imu.rows[first:] >= 0)
    return lf.Attitude(imu.t[rows], quaternion[rows])


class QuaternionKalman(lf.Node):
    """Attitude from angular rate and a measured attitude, by a linear Kalman filter.

    The quaternion is predicted with the angular rate (FLU) and corrected with what a compass
    measured (magnetic ENU <- FLU). There is one estimate for each IMU sample from the first
    measurement on. Measurements may be slower, have gaps, or come between two samples; the last
    angular rate then brings the estimate to their stamp. No state for a bias of the gyroscope.

    Source: Chu et al. 2017, Eqs. 18-29.
    """

    sync = lf.Each()

    Params = KalmanParams

    def start(self) -> None:
        self.constants = self.params.constants()
        self.state = kalman.new_state()
        self.rate = np.zeros((1, 3))
        self.t = np.empty(1, np.int64)
        none = np.empty(0, np.int64)
        nothing = np.empty((0, 4))
        kalman.run(none, np.empty((0, 3)), nothing, none, self.constants, self.state, nothing)
        self.nothing = nothing

    def step(self, imu: lf.Imu | None, measured: lf.Attitude | None) -> lf.Attitude | None:
        if imu is not None:
            self.t[0] = imu.t
            self.rate = imu.angular_velocity[None]
        else:
            self.t[0] = measured.t
        z, row = (measured.quaternion[None], PRESENT) if measured else (self.nothing, ABSENT)
        out = np.empty((1, 4))
        first = kalman.run(self.t, self.rate, z, row, self.constants, self.state, out)
        return lf.Attitude(imu.t, out[0]) if imu and first == 0 else None

    def step_block(
        self, imu: lf.Sparse[lf.Imu], measured: lf.Sparse[lf.Attitude]
    ) -> lf.Attitude | None:
        rate = held(imu.values.angular_velocity, imu.rows, self.rate)
        out = np.empty((len(imu.t), 4))
        z = measured.values.quaternion
        first = kalman.run(imu.t, rate, z, measured.rows, self.constants, self.state, out)
        self.rate = rate[-1:].copy()
        return at_samples(imu, first, out)


class ChuFuser(lf.Node):
    """Attitude from IMU and magnetometer: `tilt_compass` and `quaternion_kalman` in one.

    Inputs in the body frame (FLU), output magnetic ENU <- FLU, one estimate for each IMU sample
    from the first measurement on. The magnetometer may be slower or stamped apart: a reading
    between two IMU samples meets the last specific force and the last angular rate. With equal
    stamps and equal parameters the bytes are those of the two nodes.

    The gate, which the paper does not have, keeps the accelerometer from correcting the estimate
    while it visibly measures more than gravity.

    Source: Chu et al. 2017, Eqs. 1, 2, 9, 10 and 18-29.
    """

    sync = lf.Each()

    class Params(KalmanParams):
        """Variances of the filter, and the gate."""

        gate: Annotated[float | None, lf.MeterPerSecondSquared] = Field(None, gt=0)
        """Largest | |f| - gravity | of a row that corrects the estimate; null for the paper's
        filter, which uses all."""
        gravity: Annotated[float, lf.MeterPerSecondSquared] = Field(lf.STANDARD_GRAVITY, gt=0)
        """Specific force at rest; only the gate needs it."""

    def start(self) -> None:
        self.constants = self.params.constants()
        self.tolerance = math.inf if self.params.gate is None else self.params.gate
        self.state = kalman.new_state()
        self.rate = np.zeros((1, 3))
        self.force = np.full((1, 3), np.nan)  # passes no gate: no attitude before the first sample
        self.t = np.empty(1, np.int64)
        self.nothing = np.empty((0, 3))
        none = np.empty(0, np.int64)
        self._fuse(none, self.nothing, self.nothing, self.nothing, none)

    def _fuse(
        self,
        t: np.ndarray,
        rate: np.ndarray,
        force: np.ndarray,
        field: np.ndarray,
        row: np.ndarray,
    ) -> tuple[int, np.ndarray]:
        gravity = self.params.gravity
        return fuse(t, rate, force, field, row, gravity, self.tolerance, self.constants, self.state)

    def step(self, imu: lf.Imu | None, mag: lf.MagneticField | None) -> lf.Attitude | None:
        if imu is not None:
            self.t[0] = imu.t
            self.rate = imu.angular_velocity[None]
            self.force = imu.linear_acceleration[None]
        else:
            self.t[0] = mag.t
        field, row = (mag.magnetic_field[None], PRESENT) if mag else (self.nothing, ABSENT)
        first, quaternion = self._fuse(self.t, self.rate, self.force, field, row)
        return lf.Attitude(imu.t, quaternion[0]) if imu and first == 0 else None

    def step_block(
        self, imu: lf.Sparse[lf.Imu], mag: lf.Sparse[lf.MagneticField]
    ) -> lf.Attitude | None:
        rate = held(imu.values.angular_velocity, imu.rows, self.rate)
        force = held(imu.values.linear_acceleration, imu.rows, self.force)
        first, quaternion = self._fuse(imu.t, rate, force, mag.values.magnetic_field, mag.rows)
        self.rate, self.force = rate[-1:].copy(), force[-1:].copy()
        return at_samples(imu, first, quaternion)
