"""The vehicle in a city as a source."""

from collections.abc import Iterator
from typing import Annotated, Literal, NamedTuple

import numpy as np
from pydantic import Field

import lodeflow as lf
from lodeflow_plugins.interference.heading_ports import full_turns
from lodeflow_plugins.sources.compass_pair import FLU, Iron, as_field
from lodeflow_plugins.sources.vehicle_in_city import model

CITY = model.City()
SCENARIOS = {"near": (1.0, 0.0), "far": (0.0, 1.0), "mixed": (0.4, 0.6), "none": (0.0, 0.0)}
"""How often bench sources and structures come, against the plain near and far."""


class Ports(NamedTuple):
    """Ports of `VehicleInCity`."""

    first: lf.MagneticField
    second: lf.MagneticField
    gyro: lf.AngularRate
    truth: lf.Heading


class VehicleInCity(lf.Source):
    """A level vehicle with two compasses 10 cm apart and a rate gyro, among magnetic sources.

    Near sources are those of the bench, at an arm's length; far ones are structures, metres away.
    The other parameters make it hard in other ways. Defaults are the world of the reported
    figures, see docs/interference.md.
    """

    class Params(lf.Params):
        """The drive, what disturbs, and the sensors."""

        seed: int = Field(0, ge=0, lt=2**63)
        """Of everything random."""
        duration: Annotated[float, lf.Second] = Field(600.0, gt=0)
        """Length of the drive."""
        rate: Annotated[float, lf.Hertz] = Field(20.0, ge=1, le=1000)
        """Readings per second of all sensors."""
        scenario: Literal["near", "far", "mixed", "none"] = "near"
        """What the vehicle meets."""
        disturbed_start: bool = False
        """A source is closest as the drive begins."""
        long_disturbance: Annotated[float, lf.Second] = Field(0.0, ge=0)
        """One disturbance of this length in the middle, in the place of all others."""
        carried: bool = False
        """Sources turn with the vehicle, like a load."""
        iron_step: float = Field(0.0, ge=0)
        """Hard iron that comes in the middle, of each axis and compass, one standard deviation, in
        units of the horizontal field."""
        mismatch: bool = False
        """The sensors have errors that no filter here models: misalignment and tilt of the
        compasses, slow noise, a gyro scale error and more drift of its bias."""
        field: Annotated[float, lf.Tesla] = Field(33.5e-6, gt=0)
        """Strength of the undisturbed horizontal field."""
        dip: Annotated[float, lf.Radian] = Field(CITY.dip, gt=-1.4, lt=1.4)
        """Of the field, downwards."""
        noise: float = Field(CITY.noise, ge=0)
        """White noise of each reading, in units of the horizontal field."""
        residual: float = Field(CITY.offset, ge=0)
        """Residual calibration error, offset and scale of each axis, one standard deviation, in
        units of the horizontal field."""
        first_iron: Iron = Iron()
        """Hard and soft iron of the first compass."""
        second_iron: Iron = Iron()
        """Hard and soft iron of the second compass."""
        gyro_noise: Annotated[float, lf.RadPerSecond] = Field(float(np.radians(0.15)), ge=0)
        """White noise of the rate at 20 Hz; at other rates of the same density."""
        gyro_bias: Annotated[float, lf.RadPerSecond] = Field(CITY.gyro_bias, ge=0)
        """Bias at the start, one standard deviation."""
        fixed_bias: Annotated[float, lf.RadPerSecond] = Field(0.0, ge=0)
        """Bias on top, of this size and random sign."""
        gyro_walk: Annotated[float, lf.RadPerSecond] = Field(CITY.gyro_walk, ge=0)
        """Random walk of the bias in a second."""

    def start(self) -> None:
        p = self.params
        near, far = SCENARIOS[p.scenario]
        unmodelled = model.MISMATCH if p.mismatch else {}
        city = model.City(
            near=near,
            far=far,
            start=p.disturbed_start,
            long=p.long_disturbance,
            carried=p.carried,
            step=p.iron_step,
            dip=p.dip,
            noise=p.noise,
            offset=p.residual,
            scale=p.residual,
            gyro_bias=p.gyro_bias,
            fixed_bias=p.fixed_bias,
            gyro_walk=float(np.hypot(p.gyro_walk, model.MISMATCH_WALK if p.mismatch else 0.0)),
            gyro_noise=p.gyro_noise * 0.05**0.5,
            **unmodelled,
        )
        self.world = model.World(city, p.seed, p.duration, p.rate)
        next(model.World(city, p.seed, 1.0 / p.rate, p.rate).frames())  # compiles

    def read(self, clock: lf.Clock) -> Iterator[Ports]:
        p = self.params
        for rows in self.world.frames():
            t = clock.start + np.rint(rows.seconds * 1e9).astype(np.int64)
            rate = np.zeros((len(t), 3))
            rate[:, 2] = FLU[2] * rows.rate
            yield Ports(
                lf.MagneticField(t, as_field(rows.fields[:, 0], p.first_iron, p.field)),
                lf.MagneticField(t, as_field(rows.fields[:, 1], p.second_iron, p.field)),
                lf.AngularRate(t, rate),
                lf.Heading(t, full_turns(rows.heading)),
            )
