"""The simulated vehicle as a source."""

from collections.abc import Iterator
from typing import Annotated, ClassVar, NamedTuple

import numpy as np
from pydantic import Field

import lodeflow as lf
from lodeflow_plugins.calibration import chu2017
from lodeflow_plugins.sources.simulated_vehicle import model

CHU_2017 = model.RawModels(
    chu2017.GYROSCOPE.inverse(), chu2017.ACCELEROMETER.inverse(), chu2017.MAGNETOMETER
)


class Ports(NamedTuple):
    """Ports of `SimulatedVehicle`."""

    imu: lf.Imu
    mag: lf.MagneticField
    raw_rate: lf.RawRate
    raw_force: lf.RawForce
    raw_mag: lf.RawField
    truth: lf.AttitudeTruth
    euler: lf.EulerAngles


class Sine(lf.Params):
    """amplitude sin(2 pi frequency t + phase)."""

    amplitude: Annotated[float, lf.Radian]
    """Largest deflection."""
    frequency: Annotated[float, lf.Hertz] = Field(ge=0)
    """Turns of the sine per second."""
    phase: Annotated[float, lf.Radian] = 0.0
    """Of the sine, at t = 0."""


class Turning(lf.Params):
    """Motion of one angle: start + slope t + sines."""

    start: Annotated[float, lf.Radian] = 0.0
    """Angle at t = 0, without the sines."""
    slope: Annotated[float, lf.RadPerSecond] = 0.0
    """Steady rate of the angle."""
    sines: tuple[Sine, ...] = ()
    """What comes on top."""

    def motion(self) -> model.Motion:
        """The same for the model."""
        sines = tuple((sine.amplitude, sine.frequency, sine.phase) for sine in self.sines)
        return model.Motion(self.start, self.slope, sines)


def _turning(motion: model.Motion) -> Turning:
    sines = tuple(Sine(amplitude=a, frequency=f, phase=p) for a, f, p in motion.sines)
    return Turning(start=motion.start, slope=motion.slope, sines=sines)


ROUGH = model.Vehicle()


class SimulatedVehicle(lf.Source):
    """A vehicle that turns, tilts and shakes, its sensors, and the truth.

    The default is a rough ride of two minutes: pitch to 25 degrees, roll to 30, nearly a full
    turn, up to 1.5 m/s^2 of shaking on each axis. `imu` and `mag` are what calibrated sensors
    read (body frame, FLU), with bias and noise; `raw_rate`, `raw_force` and `raw_mag` are the
    same readings as the sensors of Chu et al. 2017 count them, whole LSB along their own axes.
    `truth` (magnetic ENU <- FLU) and `euler` have no error. The seed decides all noise; the
    bytes do not depend on the size of the blocks.

    Source: Chu et al. 2017, Eqs. 6, 8 and 12 for the raw counts.
    """

    rows: ClassVar[int] = 1000
    """Rows of a block."""

    class Params(lf.Params):
        """Motion, surroundings and errors of the sensors."""

        seed: int = Field(0, ge=0, lt=2**64)
        """Of all noise."""
        duration: Annotated[float, lf.Second] = Field(120.0, gt=0)
        """Length of the run."""
        rate: Annotated[float, lf.Hertz] = Field(100.0, gt=0, le=1e5)
        """Samples per second of all sensors; up to 100 kHz, far from two at one stamp."""
        heading: Turning = _turning(ROUGH.heading)
        """Clockwise from magnetic north."""
        pitch: Turning = _turning(ROUGH.pitch)
        """Nose up."""
        roll: Turning = _turning(ROUGH.roll)
        """Right side down."""
        shaking: float = Field(1.0, ge=0)
        """Factor on the acceleration of the rough ride; 0 for none."""
        field: Annotated[float, lf.Tesla] = Field(ROUGH.field, gt=0)
        """Strength of the earth's magnetic field."""
        dip: Annotated[float, lf.Radian] = Field(ROUGH.dip, gt=-np.pi / 2, lt=np.pi / 2)
        """Of the field, downwards."""
        gyro_noise: Annotated[float, lf.RadPerSecond] = Field(float(np.radians(0.15)), ge=0)
        """Standard deviation of each axis, per sample."""
        accel_noise: Annotated[float, lf.MeterPerSecondSquared] = Field(0.0, ge=0)
        """Standard deviation of each axis, per sample."""
        mag_noise: Annotated[float, lf.Tesla] = Field(0.0, ge=0)
        """Standard deviation of each axis, per sample."""
        gyro_bias: Annotated[lf.Vec3, lf.RadPerSecond] = (0.0, 0.0, 0.0)
        """Constant, of each body axis."""
        accel_bias: Annotated[lf.Vec3, lf.MeterPerSecondSquared] = (0.0, 0.0, 0.0)
        """Constant, of each body axis."""
        mag_bias: Annotated[lf.Vec3, lf.Tesla] = (0.0, 0.0, 0.0)
        """Constant, of each body axis: a hard iron that no calibration knows of."""

    def start(self) -> None:
        p = self.params
        shaking = tuple(
            model.Motion(sines=tuple((p.shaking * a, f, phase) for a, f, phase in motion.sines))
            for motion in ROUGH.shaking
        )
        self.vehicle = model.Vehicle(
            heading=p.heading.motion(),
            pitch=p.pitch.motion(),
            roll=p.roll.motion(),
            shaking=shaking,
            dip=p.dip,
            field=p.field,
        )
        self.errors = model.Errors(
            gyroscope=model.SensorError(p.gyro_noise, tuple(p.gyro_bias)),
            accelerometer=model.SensorError(p.accel_noise, tuple(p.accel_bias)),
            magnetometer=model.SensorError(p.mag_noise, tuple(p.mag_bias)),
        )
        self._rows(0, np.arange(1))  # compiles, so that a paced run is not late

    def read(self, clock: lf.Clock) -> Iterator[Ports]:
        count = round(self.params.duration * self.params.rate)
        for first in range(0, count, self.rows):
            yield self._rows(clock.start, np.arange(first, min(first + self.rows, count)))

    def _rows(self, start: int, row: np.ndarray) -> Ports:
        """The messages of consecutive rows; a function of the rows alone."""
        p = self.params
        t = start + np.rint(row * 1e9 / p.rate).astype(np.int64)
        state = model.truth(self.vehicle, row / p.rate)
        sensed = model.readings(state, self.errors, p.seed, int(row[0]))
        counts = model.counts(sensed, self.vehicle, CHU_2017)
        return Ports(
            imu=lf.Imu(t, sensed.angular_velocity, sensed.specific_force),
            mag=lf.MagneticField(t, sensed.magnetic_field),
            raw_rate=lf.RawRate(t, counts.gyroscope),
            raw_force=lf.RawForce(t, counts.accelerometer),
            raw_mag=lf.RawField(t, counts.magnetometer),
            truth=lf.AttitudeTruth(t, state.quaternion, np.ones(len(t), np.int64)),
            euler=lf.EulerAngles(t, *np.ascontiguousarray(state.euler.T)),
        )
