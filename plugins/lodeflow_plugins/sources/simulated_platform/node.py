"""The simulated platform as a source."""

from collections.abc import Iterator
from typing import Annotated, ClassVar, Literal, NamedTuple

import numpy as np
from pydantic import Field

import lodeflow as lf
from lodeflow_plugins.sources.simulated_platform import programme
from lodeflow_plugins.sources.simulated_vehicle import model
from lodeflow_plugins.sources.simulated_vehicle.node import CHU_2017

READING, WALK = 3, 4  # streams of noise, beside those of the sensors


class Ports(NamedTuple):
    """Ports of `SimulatedPlatform`."""

    raw_rate: lf.RawRate
    raw_force: lf.RawForce
    raw_mag: lf.RawField
    attitude: lf.Attitude
    rate: lf.AngularRate


class SimulatedPlatform(lf.Source):
    """A rotation platform with the raw sensors of Chu et al. 2017 on it, to calibrate them.

    `attitude` and `rate` are what the platform reads of itself (magnetic ENU <- FLU; FLU): exact
    in its rate, off by `reading_error` in the attitude of each position. `raw_rate`, `raw_force`
    and `raw_mag` are the sensors' counts, with noise, whole LSB. The seed decides all noise.

    Source: Chu et al. 2017, section 3, for the sensors and the programmes.
    """

    rows: ClassVar[int] = 1000
    """Rows of a block."""

    class Params(lf.Params):
        """What the platform does, and the errors of all that reads."""

        programme: Literal["attitudes", "six_positions", "rates", "rest", "tumble"] = "attitudes"
        """attitudes: 96 positions, for a magnetometer; six_positions: for an accelerometer; rates:
        six about each axis, for a gyroscope; rest: lie still; tumble: turn about all axes."""
        seed: int = Field(0, ge=0, lt=2**64)
        """Of all noise."""
        rate: Annotated[float, lf.Hertz] = Field(100.0, gt=0, le=1e5)
        """Samples per second."""
        rest: Annotated[float, lf.Second] = Field(2.0, gt=0)
        """How long a position or a rate is held."""
        move: Annotated[float, lf.Second] = Field(1.0, gt=0)
        """How long it takes from one to the next."""
        duration: Annotated[float, lf.Second] = Field(120.0, gt=0)
        """Length of rest and tumble."""
        field: Annotated[float, lf.Tesla] = Field(model.Vehicle().field, gt=0)
        """Strength of the earth's magnetic field."""
        dip: Annotated[float, lf.Radian] = Field(model.Vehicle().dip, gt=-np.pi / 2, lt=np.pi / 2)
        """Of the field, downwards."""
        reading_error: Annotated[float, lf.Radian] = Field(0.0, ge=0)
        """Standard deviation, about each axis, of the platform's attitude in a position."""
        gyro_noise: Annotated[float, lf.RadPerSecond] = Field(float(np.radians(0.15)), ge=0)
        """Standard deviation of each axis, per sample."""
        gyro_walk: float = Field(0.0, ge=0)
        """Random walk of the gyroscope's bias, rad/s per square root of a second."""
        accel_noise: Annotated[float, lf.MeterPerSecondSquared] = Field(0.018, ge=0)
        """Standard deviation of each axis, per sample; 10 LSB."""
        mag_noise: Annotated[float, lf.Tesla] = Field(58e-9, ge=0)
        """Standard deviation of each axis, per sample; 2 LSB."""

    def start(self) -> None:
        p = self.params
        tumble = np.array(programme.TUMBLE) * (p.programme == "tumble")
        known: dict[str, programme.Programme] = {
            "attitudes": programme.Stops(programme.ATTITUDES, p.rest, p.move),
            "six_positions": programme.Stops(programme.SIX_POSITIONS, p.rest, p.move),
            "rates": programme.Turns(programme.RATES, p.rest, p.move),
        }
        self.programme = known.get(p.programme, programme.Tumble(tumble, p.duration))
        self.vehicle = model.Vehicle(dip=p.dip, field=p.field)
        self.errors = model.Errors(
            gyroscope=model.SensorError(p.gyro_noise),
            accelerometer=model.SensorError(p.accel_noise),
            magnetometer=model.SensorError(p.mag_noise),
        )
        self.earth_force = np.array([0.0, 0.0, self.vehicle.gravity])
        self.earth_field = p.field * np.array([0.0, np.cos(p.dip), -np.sin(p.dip)])
        self.drift = np.zeros(3)
        self._rows(0, np.arange(1))  # compiles, and walks
        self.drift = np.zeros(3)

    def read(self, clock: lf.Clock) -> Iterator[Ports]:
        count = round(self.programme.duration * self.params.rate)
        for first in range(0, count, self.rows):
            yield self._rows(clock.start, np.arange(first, min(first + self.rows, count)))

    def _rows(self, start: int, row: np.ndarray) -> Ports:
        """The messages of consecutive rows; the walk goes on from those before."""
        p = self.params
        t = start + np.rint(row * 1e9 / p.rate).astype(np.int64)
        euler, euler_rate, stop = self.programme(row / p.rate)
        force = np.repeat(self.earth_force[None], len(row), axis=0)
        truth = model.Truth(euler, *model.kinematics(euler, euler_rate, force, self.earth_field))
        sensed = model.readings(truth, self.errors, p.seed, int(row[0]))
        if p.gyro_walk:
            steps = model.noise(p.seed, WALK, int(row[0]), len(row)) * p.gyro_walk / p.rate**0.5
            walk = self.drift + np.cumsum(steps, axis=0)
            self.drift = walk[-1]
            sensed = model.Readings(
                sensed.angular_velocity + walk, sensed.specific_force, sensed.magnetic_field
            )
        counts = model.counts(sensed, self.vehicle, CHU_2017)
        return Ports(
            lf.RawRate(t, counts.gyroscope),
            lf.RawForce(t, counts.accelerometer),
            lf.RawField(t, counts.magnetometer),
            lf.Attitude(t, self._read_attitude(truth.quaternion, stop)),
            lf.AngularRate(t, truth.angular_velocity),
        )

    def _read_attitude(self, quaternion: np.ndarray, stop: np.ndarray) -> np.ndarray:
        """Attitudes (N, 4) as the platform reads them, off by a small turn at each stop."""
        turns = model.noise(self.params.seed, READING, 0, int(stop[-1]) + 1)[stop]
        x, y, z = (0.5 * self.params.reading_error * turns).T
        a, b, c, w = quaternion.T
        read = np.column_stack(
            [
                w * x + a + b * z - c * y,
                w * y + b + c * x - a * z,
                w * z + c + a * y - b * x,
                w - a * x - b * y - c * z,
            ]
        )
        return read / np.linalg.norm(read, axis=1, keepdims=True)
