"""A level platform that accelerates evenly, with noise on all that is measured."""

from collections.abc import Iterator
from typing import Annotated, ClassVar, NamedTuple

import numpy as np
from pydantic import Field

import lodeflow as lf


class Ports(NamedTuple):
    """Ports of `TiltingPlatform`."""

    force: lf.SpecificForce
    acceleration: lf.Acceleration
    coriolis: lf.Acceleration


class TiltingPlatform(lf.Source):
    """Constant specific force and acceleration of a gravimeter's platform, with white noise.

    For what errors of observation do to a correction that squares them. The Coriolis acceleration
    is zero.
    """

    rows: ClassVar[int] = 10_000
    """Rows of a block."""

    class Params(lf.Params):
        """What is sensed, and how well."""

        force: Annotated[lf.Vec3, lf.MeterPerSecondSquared] = Field(default=[0.0, 0.0, 9.8])
        """Specific force along the platform's axes, x east, y north, z up."""
        acceleration: Annotated[lf.Vec3, lf.MeterPerSecondSquared] = Field(default=[0.0, 0.0, 0.0])
        """Acceleration of the vehicle, east, north, up."""
        noise: Annotated[float, lf.Gravity] = Field(0.0, ge=0)
        """Standard deviation of each component of both."""
        samples: int = Field(1000, ge=1)
        """How many of each."""
        sample_rate: Annotated[float, lf.Hertz] = Field(2.0, gt=0)
        """Samples per second."""
        seed: int = 0
        """Of the noise."""

    def read(self, clock: lf.Clock) -> Iterator[Ports]:
        p = self.params
        rng = np.random.default_rng(p.seed)
        for first in range(0, p.samples, self.rows):
            index = np.arange(first, min(first + self.rows, p.samples))
            t = clock.start + np.rint(index * (1e9 / p.sample_rate)).astype(np.int64)
            noise = p.noise * rng.standard_normal((2, len(t), 3))
            yield Ports(
                lf.SpecificForce(t, p.force + noise[0]),
                lf.Acceleration(t, p.acceleration + noise[1]),
                lf.Acceleration(t, np.zeros((len(t), 3))),
            )
