"""Plugins whose only purpose is to be wired, rightly and wrongly."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Literal, NamedTuple

from pydantic import Field, field_validator, model_validator

import lodeflow as lf


class Streams(NamedTuple):
    imu: lf.Imu
    mag: lf.RawField
    mode: lf.Mode


class Vehicle(lf.Source):
    """Everything that a vehicle measures."""

    class Params(lf.Params):
        seed: int = 0
        """Seed of all noise."""
        trial: str | None = None
        rate: Annotated[float, lf.Hertz, Field(gt=0)] = 100.0
        """Samples per second."""

    def read(self, clock: lf.Clock) -> Iterator[Streams]:
        yield from ()


class Calibrator(lf.Node):
    """Remove the bias of a magnetometer."""

    class Params(lf.Params):
        bias: Annotated[lf.Vec3, lf.Lsb]
        """Output at zero field."""
        scales: list[Annotated[float, Field(gt=0)]] = Field([1.0], max_length=3)
        """Factor of each range."""
        range: Literal["low", "high"] = "low"
        file: Path = Path("none")

    def step(self, raw: lf.RawField) -> lf.MagneticField:
        raise NotImplementedError


class Fuser(lf.Node):
    """Attitude from inertial and magnetic measurements."""

    sync = lf.Nearest("imu", within=lf.seconds(0.005))

    class Params(lf.Params):
        gyro_noise: Annotated[float, lf.RadPerSecond, Field(gt=0)] = 0.01
        """Standard deviation of the angular rate."""
        gain: float | Literal["auto"] = "auto"
        iterations: Annotated[int, Field(ge=1, le=9)] = 1
        reject: bool = True

    def step(self, imu: lf.Imu, mag: lf.MagneticField) -> lf.Attitude:
        raise NotImplementedError


class OtherFuser(lf.Node):
    """The same ports as Fuser, other parameters."""

    sync = lf.Nearest("imu", within=lf.seconds(0.005))

    class Params(lf.Params):
        gyro_noise: Annotated[float, lf.RadPerSecond] = 0.02
        beta: float = 0.1

        @field_validator("beta")
        @classmethod
        def _small(cls, value: float) -> float:
            if value > 1:
                raise ValueError("should be a gain below 1")
            return value

    def step(self, imu: lf.Imu, mag: lf.MagneticField) -> lf.Attitude:
        raise NotImplementedError


class Limits(lf.Params):
    low: Annotated[float, lf.Radian]
    """Least heading."""
    high: Annotated[float, lf.Radian] = 1.0


class Display(lf.Node):
    """A sink."""

    class Params(lf.Params):
        limits: Limits | None = None
        depth: Annotated[float, lf.Meter] | None = None

        @model_validator(mode="after")
        def _ordered(self) -> Display.Params:
            if self.limits and self.limits.low > self.limits.high:
                raise ValueError("limits.low should not be above limits.high")
            return self

    def step(self, attitude: lf.Attitude) -> None:
        raise NotImplementedError


class Circle(lf.Params):
    radius: float


class Square(lf.Params):
    side: float


class Fence(lf.Node):
    """Parameters of several shapes, and a default that its author got wrong."""

    class Params(lf.Params):
        shape: Circle | Square
        margin: Annotated[float, lf.Meter, Field(gt=0)] = -1

    def step(self, rate: lf.AngularRate) -> None:
        raise NotImplementedError


class Smoother(lf.Node):
    """Rate to rate, so that cycles can be wired."""

    def step(self, rate: lf.AngularRate) -> lf.AngularRate:
        raise NotImplementedError


class Mixer(lf.Node):
    """Holds its feedback with delay, so that it may close a cycle."""

    sync = lf.Hold("rate", initial={"feedback": lf.AngularRate.of(0)}, delay=True)

    def step(self, rate: lf.AngularRate, feedback: lf.AngularRate) -> lf.AngularRate:
        raise NotImplementedError


class Late(lf.Node):
    """Its output may lie before the row that it comes from, so it cannot be in a cycle."""

    lookback = lf.seconds(1)

    def step(self, rate: lf.AngularRate) -> lf.AngularRate:
        raise NotImplementedError


class Rates(lf.Source):
    def read(self, clock: lf.Clock) -> Iterator[lf.AngularRate]:
        yield from ()


class Fragile(lf.Node):
    """Its author's check of the parameters fails in a way that pydantic does not catch."""

    class Params(lf.Params):
        size: int = 1

        @field_validator("size")
        @classmethod
        def _known(cls, value: int) -> int:
            return {1: 1}[value]

    def step(self, rate: lf.AngularRate) -> lf.AngularRate:
        raise NotImplementedError


class Calibrated(lf.Node):
    """Takes its parameters from a file."""

    class Params(lf.Params):
        file: lf.CalibrationFile = None
        """What a calibration wrote."""
        bias: Annotated[lf.Vec3, lf.Lsb]
        gain: Annotated[float, lf.Tesla] = 1.0
        scale: float = 1.0

    def step(self, raw: lf.RawField) -> lf.MagneticField:
        raise NotImplementedError
