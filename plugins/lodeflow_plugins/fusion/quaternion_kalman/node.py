"""The Kalman filter of Chu et al. as nodes: behind a compass, and with the compass built in."""

import math
from typing import Annotated

import numpy as np
from pydantic import Field

import lodeflow as lf
from lodeflow_plugins.fusion.quaternion_kalman import filter as kalman
from lodeflow_plugins.fusion.quaternion_kalman.fuse import fuse
from lodeflow_plugins.fusion.quaternion_kalman.single import fuse_one, run_one

PRESENT, ABSENT = 0, -1
NO_QUATERNION, NO_FIELD = np.zeros(4), np.zeros(3)


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


def none_of(kind: type[lf.Message]) -> lf.Sparse:
    """An input without rows."""
    return lf.Sparse(kind.empty(), np.empty(0, np.int64), np.empty(0, np.int64))


def held(column: np.ndarray, rows: np.ndarray, before: np.ndarray) -> np.ndarray:
    """For each row the last value at or before it; `before` serves until there is one.

    column: (M, 3), the values present; rows: (N,), their index at each row, -1 for none.
    """
    if len(column) == len(rows):
        return column
    return np.concatenate([before[None], column])[np.maximum.accumulate(rows) + 1]


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
        self.rate = np.zeros(3)
        self.step_block(none_of(lf.Imu), none_of(lf.Attitude))  # compiles
        run_one(0, self.rate, NO_QUATERNION, ABSENT, self.constants, self.state)

    def step(self, imu: lf.Imu | None, measured: lf.Attitude | None) -> lf.Attitude | None:
        if imu is not None:
            self.rate = imu.angular_velocity
        t = measured.t if imu is None else imu.t
        z, row = (NO_QUATERNION, ABSENT) if measured is None else (measured.quaternion, PRESENT)
        first, quaternion = run_one(t, self.rate, z, row, self.constants, self.state)
        return lf.Attitude(t, quaternion) if first == 0 and imu is not None else None

    def step_block(
        self, imu: lf.Sparse[lf.Imu], measured: lf.Sparse[lf.Attitude]
    ) -> lf.Attitude | None:
        rate = held(imu.values.angular_velocity, imu.rows, self.rate)
        out = np.empty((len(imu.t), 4))
        z = measured.values.quaternion
        first = kalman.run(imu.t, rate, z, measured.rows, self.constants, self.state, out)
        self.rate = rate[-1].copy() if len(rate) else self.rate
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
        p = self.params
        # As the kernels take them, after what they have for each row.
        self.settings = (
            p.gravity,
            math.inf if p.gate is None else p.gate,
            p.constants(),
            kalman.new_state(),
        )
        self.rate = np.zeros(3)
        self.force = np.full(3, np.nan)  # passes no gate: no attitude before the first sample
        self.step_block(none_of(lf.Imu), none_of(lf.MagneticField))  # compiles
        fuse_one(0, self.rate, self.force, NO_FIELD, ABSENT, *self.settings)

    def step(self, imu: lf.Imu | None, mag: lf.MagneticField | None) -> lf.Attitude | None:
        if imu is not None:
            self.rate, self.force = imu.angular_velocity, imu.linear_acceleration
        t = mag.t if imu is None else imu.t
        field, row = (NO_FIELD, ABSENT) if mag is None else (mag.magnetic_field, PRESENT)
        first, quaternion = fuse_one(t, self.rate, self.force, field, row, *self.settings)
        return lf.Attitude(t, quaternion) if first == 0 and imu is not None else None

    def step_block(
        self, imu: lf.Sparse[lf.Imu], mag: lf.Sparse[lf.MagneticField]
    ) -> lf.Attitude | None:
        rate = held(imu.values.angular_velocity, imu.rows, self.rate)
        force = held(imu.values.linear_acceleration, imu.rows, self.force)
        field = mag.values.magnetic_field
        first, quaternion = fuse(imu.t, rate, force, field, mag.rows, *self.settings)
        if len(rate):
            self.rate, self.force = rate[-1].copy(), force[-1].copy()
        return at_samples(imu, first, quaternion)
