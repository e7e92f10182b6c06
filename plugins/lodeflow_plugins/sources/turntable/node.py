"""The turntable as a source."""

from collections.abc import Iterator
from dataclasses import replace
from typing import Annotated, NamedTuple

import numpy as np
from pydantic import Field

import lodeflow as lf
from lodeflow_plugins.sources.compass_pair import FLU, Iron, as_field
from lodeflow_plugins.sources.turntable import model

BENCH = model.Bench()
GYRO_RATE = 10
"""Readings of the gyro in a second, in which there is one of the compasses."""
TURN_RATE = 2.0 * np.pi / model.STEPS
"""Of the table, rad/s."""


class Ports(NamedTuple):
    """Ports of `Turntable`."""

    first: lf.MagneticField
    second: lf.MagneticField
    gyro: lf.AngularRate
    truth: lf.Heading


class Turntable(lf.Source):
    """Two compasses 10 cm apart on a table that turns by ten degrees a second, and sources.

    Magnets and iron cabinets approach and leave as the table turns. After each rotation the table
    rests, so that the gap in the stamps of the readings tells one rotation from the next. The gyro
    reads ten times a second, also then.

    Source: Hao, Yang and Huang, sections 1 and 3.
    """

    class Params(lf.Params):
        """The bench."""

        seed: int = Field(0, ge=0, lt=2**63)
        """Of everything random."""
        rotations: int = Field(20, ge=1)
        """Of 36 readings each."""
        rest: Annotated[float, lf.Second] = Field(10.0, ge=1)
        """Between two rotations."""
        field: Annotated[float, lf.Tesla] = Field(33.5e-6, gt=0)
        """Strength of the undisturbed horizontal field."""
        disturbed: float = Field(BENCH.disturbed, ge=0, le=1)
        """Ratio of rotations with a source."""
        noise: float = Field(BENCH.noise, ge=0)
        """White noise of each reading, in units of the horizontal field."""
        residual: float = Field(BENCH.offset, ge=0)
        """Residual calibration error, offset and scale of each axis, one standard deviation, in
        units of the horizontal field."""
        first_iron: Iron = Iron()
        """Hard and soft iron of the first compass."""
        second_iron: Iron = Iron()
        """Hard and soft iron of the second compass."""
        gyro_noise: Annotated[float, lf.RadPerSecond] = Field(float(np.radians(0.15)), ge=0)
        """Standard deviation of each rate."""
        gyro_bias: Annotated[float, lf.RadPerSecond] = Field(float(np.radians(0.05)), ge=0)
        """Bias of the rate, one standard deviation."""

    def start(self) -> None:
        p = self.params
        bench = model.Bench(
            disturbed=p.disturbed, noise=p.noise, offset=p.residual, scale=p.residual
        )
        self.table = model.Turntable(bench, p.seed)
        model.Turntable(replace(bench, disturbed=1.0), p.seed).rotation(0)  # compiles
        self.bias = p.gyro_bias * np.random.default_rng([p.seed, 2]).standard_normal()

    def read(self, clock: lf.Clock) -> Iterator[Ports]:
        p = self.params
        step, gyro_step = lf.seconds(1.0), lf.seconds(1.0 / GYRO_RATE)
        turning = model.STEPS * GYRO_RATE
        resting = round(p.rest * GYRO_RATE)
        for number in range(p.rotations):
            begin = clock.start + number * (turning + resting) * gyro_step
            t = begin + step * np.arange(model.STEPS)
            fields = self.table.rotation(number)
            rate = np.zeros((turning + resting, 3))
            rate[:turning, 2] = FLU[2] * TURN_RATE
            rate[0, 2] = rate[turning, 2] = FLU[2] * TURN_RATE / 2  # as it starts, and as it stops
            noise = np.random.default_rng([p.seed, 3, number]).standard_normal(len(rate))
            rate[:, 2] += self.bias + p.gyro_noise * noise
            yield Ports(
                lf.MagneticField(t, as_field(fields[:, 0], p.first_iron, p.field)),
                lf.MagneticField(t, as_field(fields[:, 1], p.second_iron, p.field)),
                lf.AngularRate(begin + gyro_step * np.arange(len(rate)), rate),
                lf.Heading(t, self.table.heading.copy()),
            )
