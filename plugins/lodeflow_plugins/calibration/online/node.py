"""The online hard-iron estimator as a node."""

from typing import Annotated, ClassVar, NamedTuple

import numpy as np
from pydantic import Field

import lodeflow as lf
from lodeflow_plugins.calibration.messages import HardIron
from lodeflow_plugins.calibration.online import estimator


class Ports(NamedTuple):
    """Ports of `OnlineMagCalibrator`."""

    mag: lf.MagneticField | None
    hard_iron: HardIron | None


class OnlineMagCalibrator(lf.Node):
    """Estimate the hard iron of a magnetometer while running, and remove what is known of it.

    The gyroscope tells how the earth's field turns in the body; what does not turn along is hard
    iron. Nothing is removed before the body has turned enough to tell it (`trusted`) and the
    estimate has proved to predict better than none (`evidence`). `mag` is the field less what is
    known, for each reading; `hard_iron` the estimate with its covariance at the end of each
    segment. The axes of magnetometer and gyroscope are the body's (FLU).

    Source: the model is stated in online/estimator.py.
    """

    sync = lf.Each()
    example: ClassVar = {"segment": 0.5}

    class Params(lf.Params):
        """What to expect of field and iron, and when to trust."""

        segment: Annotated[float, lf.Second] = Field(5.0, gt=0.1)
        """Over which the gyroscope is taken at its word: it may be off by some degrees."""
        memory: Annotated[float, lf.Second] = Field(60.0, gt=0)
        """In which the past fades to 37 %."""
        sigma: Annotated[float, lf.Tesla] = Field(1e-6, gt=0)
        """How much the earth's field differs from place to place at least: 1 uT is usual between
        walls, less outdoors. More is noticed. It scales how long the gates stay shut."""
        prior: Annotated[float, lf.Tesla] = Field(10e-6, gt=0)
        """Standard deviation of each axis of the hard iron, before anything is known."""
        trusted: Annotated[float, lf.Tesla] = Field(2e-6, gt=0)
        """Standard deviation below which a part of the estimate is removed."""
        evidence: float = Field(25.0, ge=0)
        """How much better than nothing the estimate has to have predicted, in sigma squared."""

    def start(self) -> None:
        p = self.params
        settings = estimator.Settings(
            lf.seconds(p.segment),
            float(np.exp(-p.segment / p.memory)),
            p.sigma,
            p.prior,
            p.trusted,
            p.evidence,
        )
        self.estimator = estimator.Estimator(settings)
        nothing, none = np.empty(0, np.int64), np.empty((0, 3))
        self.estimator.run(nothing, none, nothing, none, nothing)  # compiles

    def step_block(self, mag: lf.Sparse[lf.MagneticField], imu: lf.Sparse[lf.Imu]) -> Ports:
        rate, field = imu.values.angular_velocity, mag.values.magnetic_field
        corrected, segments = self.estimator.run(mag.t, rate, imu.rows, field, mag.rows)
        stamps = mag.values.t
        if not segments:
            return Ports(lf.MagneticField(stamps, corrected), None)
        rows, *columns = (np.array(column) for column in zip(*segments, strict=True))
        return Ports(lf.MagneticField(stamps, corrected), HardIron(stamps[rows], *columns))
