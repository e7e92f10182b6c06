"""A vehicle that turns, tilts and shakes, and what its sensors read.

The motion is analytic: heading, pitch and roll are sums of sines and a steady turn, the angular
rate is their exact derivative, and the specific force and the field follow from the attitude. All
of it is a function of time alone, and all noise is a function of (seed, stream, row), so a run
may be evaluated in any pieces and gives the same bits.

Frames: body FLU (x forward, y left, z up), earth magnetic ENU (y is magnetic north). Heading,
pitch and roll are the Z-Y-X Euler angles from NED to FRD, as a compass shows them.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numba import njit
from numpy.typing import ArrayLike

from lodeflow_plugins.calibration.error_models import Affine
from lodeflow_plugins.fusion.tilt_compass.compass import (
    SQRT_HALF,
    TURN,
    quaternion_from_euler,
    swap_body,
    wrap,
)

FRAME = 256  # rows of noise that are drawn at once

GYROSCOPE, ACCELEROMETER, MAGNETOMETER = 0, 1, 2  # streams of noise


@dataclass(frozen=True)
class Motion:
    """start + slope t + sum of amplitude sin(2 pi frequency t + phase), t in s.

    sines: (amplitude, frequency in Hz, phase in rad) each. start and amplitude have the unit of
    the motion, slope has that unit per second.
    """

    start: float = 0.0
    slope: float = 0.0
    sines: tuple[tuple[float, float, float], ...] = ()

    def value(self, seconds: np.ndarray) -> np.ndarray:
        """The motion at seconds (N,); (N,)."""
        total = self.start + self.slope * seconds
        for amplitude, frequency, phase in self.sines:
            total = total + amplitude * np.sin(TURN * frequency * seconds + phase)
        return total

    def derivative(self, seconds: np.ndarray) -> np.ndarray:
        """The motion's rate of change at seconds (N,), per second; (N,)."""
        total = np.full(seconds.shape, self.slope)
        for amplitude, frequency, phase in self.sines:
            omega = TURN * frequency
            total = total + amplitude * omega * np.cos(omega * seconds + phase)
        return total


def _degrees(slope: float, *sines: tuple[float, float]) -> Motion:
    return Motion(
        slope=float(np.radians(slope)),
        sines=tuple((float(np.radians(amplitude)), hertz, 0.0) for amplitude, hertz in sines),
    )


def _shaking(*hertz: float) -> Motion:
    return Motion(sines=tuple((1.5 / len(hertz), f, 0.0) for f in hertz))


_HEADING = _degrees(3.0, (40.0, 0.031))
_PITCH = _degrees(0.0, (17.0, 0.043), (8.0, 0.097))
_ROLL = _degrees(0.0, (21.0, 0.037), (9.0, 0.083))
_SHAKING = (_shaking(1.3, 2.9, 5.3), _shaking(1.1, 3.1, 4.7), _shaking(1.7, 3.7, 6.9))


@dataclass(frozen=True)
class Vehicle:
    """Motion of a vehicle and the earth around it.

    heading, pitch, roll: rad; shaking: acceleration to the east, north and up, m/s^2; gravity:
    m/s^2; dip: rad, downwards; field: strength of the earth's magnetic field, tesla.

    The default is a rough ride: pitch to 25 degrees, roll to 30 degrees, up to 1.5 m/s^2 of
    shaking on each axis, nearly a full turn to the right in two minutes, and a dip of 48 degrees.
    It starts level, facing north.
    """

    heading: Motion = _HEADING
    pitch: Motion = _PITCH
    roll: Motion = _ROLL
    shaking: tuple[Motion, Motion, Motion] = _SHAKING
    gravity: float = 9.80665
    dip: float = float(np.radians(48.0))
    field: float = 50e-6


@dataclass(frozen=True, eq=False)
class Truth:
    """The state of the vehicle at N times, without any error.

    euler: (N, 3), heading, pitch and roll in rad, heading in [0, 2 pi);
    quaternion: (N, 4), scalar last, w >= 0, ENU <- FLU; angular_velocity: (N, 3), rad/s, FLU;
    specific_force: (N, 3), m/s^2, FLU; magnetic_field: (N, 3), tesla, FLU.
    """

    euler: np.ndarray
    quaternion: np.ndarray
    angular_velocity: np.ndarray
    specific_force: np.ndarray
    magnetic_field: np.ndarray


def truth(vehicle: Vehicle, seconds: ArrayLike) -> Truth:
    """The true state of the vehicle at the times seconds (N,), since its start."""
    seconds = np.ascontiguousarray(seconds, dtype=float)
    motions = (vehicle.heading, vehicle.pitch, vehicle.roll)
    euler = np.column_stack([motion.value(seconds) for motion in motions])
    euler_rate = np.column_stack([motion.derivative(seconds) for motion in motions])
    # Specific force is acceleration less gravitation, so at rest it points up.
    force = np.column_stack([motion.value(seconds) for motion in vehicle.shaking])
    force[:, 2] += vehicle.gravity
    field = vehicle.field * np.array([0.0, np.cos(vehicle.dip), -np.sin(vehicle.dip)])
    quaternion, rate, body_force, body_field = kinematics(euler, euler_rate, force, field)
    return Truth(euler, quaternion, rate, body_force, body_field)


@njit(cache=True)
def _to_body(q: np.ndarray, x: float, y: float, z: float, out: np.ndarray) -> None:
    """Write q* v q into out: the body components of an earth vector v = (x, y, z)."""
    tx = 2.0 * (q[2] * y - q[1] * z)
    ty = 2.0 * (q[0] * z - q[2] * x)
    tz = 2.0 * (q[1] * x - q[0] * y)
    out[0] = x + q[3] * tx + (q[2] * ty - q[1] * tz)
    out[1] = y + q[3] * ty + (q[0] * tz - q[2] * tx)
    out[2] = z + q[3] * tz + (q[1] * tx - q[0] * ty)


@njit(cache=True)
def kinematics(
    euler: np.ndarray, euler_rate: np.ndarray, force: np.ndarray, field: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Attitude, angular rate, specific force and field in FLU; force (N, 3), field (3,) in ENU.

    The heading in euler is wrapped in place.
    """
    n = len(euler)
    quaternion = np.empty((n, 4))
    rate = np.empty((n, 3))
    body_force = np.empty((n, 3))
    body_field = np.empty((n, 3))
    for k in range(n):
        heading, pitch, roll = euler[k, 0], euler[k, 1], euler[k, 2]
        q1, q2, q3, q4 = quaternion_from_euler(heading, pitch, roll)
        scale = SQRT_HALF if q4 + q3 >= 0.0 else -SQRT_HALF
        q = quaternion[k]
        q[0], q[1], q[2], q[3] = (
            scale * (q1 + q2),  # compass.SWAP_QUATERNION, row by row
            scale * (q1 - q2),
            scale * (q4 - q3),
            scale * (q4 + q3),
        )
        sin_pitch, cos_pitch = np.sin(pitch), np.cos(pitch)
        sin_roll, cos_roll = np.sin(roll), np.cos(roll)
        turn, nod, bank = euler_rate[k, 0], euler_rate[k, 1], euler_rate[k, 2]
        rate[k, 0] = bank - turn * sin_pitch
        rate[k, 1] = -(nod * cos_roll + turn * sin_roll * cos_pitch)  # FRD has y right, z down
        rate[k, 2] = -(turn * cos_roll * cos_pitch - nod * sin_roll)
        _to_body(q, force[k, 0], force[k, 1], force[k, 2], body_force[k])
        _to_body(q, field[0], field[1], field[2], body_field[k])
        euler[k, 0] = wrap(heading)
    return quaternion, rate, body_force, body_field


def noise(seed: int, stream: int, first: int, count: int) -> np.ndarray:
    """Standard normal numbers (count, 3) of the rows first, first + 1, ... of a stream.

    Philox counts instead of stepping, so a frame of rows is drawn by its number alone, and a row
    is the same whichever rows are asked for beside it.

    Raises ValueError when the seed is not in [0, 2^64).
    """
    if not 0 <= seed < 2**64:
        raise ValueError(f"seed has to be in [0, 2^64), got {seed}")
    rows = np.empty((count, 3))
    done = 0
    while done < count:
        number, offset = divmod(first + done, FRAME)
        take = min(FRAME - offset, count - done)
        rows[done : done + take] = _frame(seed, stream, number)[offset : offset + take]
        done += take
    return rows


@lru_cache(maxsize=8)  # sample by sample, a frame serves many calls
def _frame(seed: int, stream: int, number: int) -> np.ndarray:
    # The lowest words of the counter are for the draws within a frame.
    key = np.array([seed, stream], np.uint64)
    philox = np.random.Philox(key=key, counter=[0, 0, number, 0])
    return np.random.Generator(philox).standard_normal((FRAME, 3))


@dataclass(frozen=True)
class SensorError:
    """White noise (standard deviation per sample and axis) and constant bias (each axis, FLU)."""

    noise: float = 0.0
    bias: tuple[float, float, float] = (0.0, 0.0, 0.0)

    def added(self, values: np.ndarray, seed: int, stream: int, first: int) -> np.ndarray:
        """The values (N, 3) of the rows first, first + 1, ... with bias and noise."""
        disturbed = values + np.array(self.bias)
        if self.noise:
            disturbed += self.noise * noise(seed, stream, first, len(values))
        return disturbed


_NOISY_GYROSCOPE = SensorError(noise=float(np.radians(0.15)))


@dataclass(frozen=True)
class Errors:
    """Errors of the three sensors, in rad/s, m/s^2 and tesla."""

    gyroscope: SensorError = _NOISY_GYROSCOPE
    accelerometer: SensorError = SensorError()
    magnetometer: SensorError = SensorError()


@dataclass(frozen=True, eq=False)
class Readings:
    """What the sensors say in N rows: rad/s, m/s^2 and tesla, (N, 3) each, FLU."""

    angular_velocity: np.ndarray
    specific_force: np.ndarray
    magnetic_field: np.ndarray


def readings(state: Truth, errors: Errors, seed: int, first: int) -> Readings:
    """Add the errors to the true state, whose rows are the rows first, first + 1, ... of a run."""
    return Readings(
        errors.gyroscope.added(state.angular_velocity, seed, GYROSCOPE, first),
        errors.accelerometer.added(state.specific_force, seed, ACCELEROMETER, first),
        errors.magnetometer.added(state.magnetic_field, seed, MAGNETOMETER, first),
    )


@dataclass(frozen=True)
class RawModels:
    """Maps from body vectors to raw counts in the frames and units of Chu et al. 2017.

    gyroscope: w^b, FRD, deg/s; accelerometer: A^b, FLU, g; magnetometer: h^b, FRD, in units of
    the earth's field.
    """

    gyroscope: Affine
    accelerometer: Affine
    magnetometer: Affine


@dataclass(frozen=True, eq=False)
class Counts:
    """Raw counts of the sensors, whole LSB as float64, (N, 3) each."""

    gyroscope: np.ndarray
    accelerometer: np.ndarray
    magnetometer: np.ndarray


def counts(readings: Readings, vehicle: Vehicle, models: RawModels) -> Counts:
    """What sensors with these error models count while the readings hold."""
    return Counts(
        np.rint(models.gyroscope(np.degrees(swap_body(readings.angular_velocity)))),
        np.rint(models.accelerometer(readings.specific_force / vehicle.gravity)),
        np.rint(models.magnetometer(swap_body(readings.magnetic_field) / vehicle.field)),
    )
