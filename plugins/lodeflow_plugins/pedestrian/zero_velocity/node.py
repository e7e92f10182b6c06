"""Step counters that look for zero velocity, as nodes."""

from typing import Annotated, ClassVar

import numpy as np
from pydantic import Field

import lodeflow as lf
from lodeflow_plugins.pedestrian.counting import Counter, CounterParams
from lodeflow_plugins.pedestrian.zero_velocity import run_length, statistics


class RunParams(CounterParams):
    """How still samples become steps."""

    min_run: Annotated[float, lf.Second] = Field(0.1, ge=0)
    """Runs of still samples that are shorter are pseudo zeros of the swing, and dropped."""
    close_gaps: Annotated[float, lf.Second] = Field(0.0, ge=0)
    """Gaps shorter than this between two still samples are part of the run; 0 for the paper's
    detector, which knows none."""
    settle: Annotated[float, lf.Second] = Field(0.5, ge=0)
    """A run that begins within this time from the first sample is standing, not a step."""


class RunCounter(Counter):
    """Base of the counters of still runs: what is still is said by `values`."""

    lower: float = -np.inf
    upper: float

    def start(self) -> None:
        super().start()
        p = self.params
        self.runs = run_length.new_state()
        self.shortest = max(1, run_length.samples_of(p.min_run, p.sample_rate))
        self.closes = run_length.samples_of(p.close_gaps, p.sample_rate)
        statistics.norms(np.empty((0, 3)))  # compiles, as does
        self.count(np.empty(0, np.int64), np.empty(0))

    def count(self, t: np.ndarray, values: np.ndarray) -> lf.Step | None:
        """Steps of a block, from the values (N,) that are still between the two thresholds."""
        self.seen(t)
        row, moment = np.empty(len(t), np.int64), np.empty(len(t), np.int64)
        found = run_length.count(
            t,
            values,
            self.lower,
            self.upper,
            self.shortest,
            self.closes,
            lf.seconds(self.params.settle),
            self.runs,
            row,
            moment,
        )
        return self.steps(t[row[:found]], moment[:found])


class ZeroVelocitySteps(RunCounter):
    """Steps from the time in which the acceleration of the foot, without gravity, is near zero.

    A stance is a run of at least `min_run` of samples with t_min < |a| < t_max, and is told as
    soon as it is that long; its moment is that of its first sample. Takes the acceleration in
    the geographic frame (`to_geographic`), from a sensor on the foot. Right on walking; running,
    where a stance lasts less than 0.1 s, needs `swing_steps`.

    Source: step counter printed with Liu et al. 2018, Eq. 3 and steps (1) to (4). The paper does
    not give its thresholds. `close_gaps` and `settle` are not in it.
    """

    class Params(RunParams):
        """The interval of Eq. 3."""

        t_min: Annotated[float | None, lf.MeterPerSecondSquared] = None
        """Lower threshold; null for none. (0 would only drop exact zeros.)"""
        t_max: Annotated[float, lf.MeterPerSecondSquared] = Field(2.5, gt=0)
        """Upper threshold."""

    def start(self) -> None:
        self.lower = -np.inf if self.params.t_min is None else self.params.t_min
        self.upper = self.params.t_max
        super().start()

    def step_block(self, acceleration: lf.Acceleration) -> lf.Step | None:
        return self.count(acceleration.t, statistics.norms(acceleration.acceleration))


class RawNormSteps(RunCounter):
    """Steps from the time in which the norm of the specific force is near gravity.

    The reading of the paper that needs no attitude: still where | |f| - g | < t_max. Worse than
    `zero_velocity_steps`, above all on running and with gaps closed.

    Source: step counter printed with Liu et al. 2018, read without the removal of gravity.
    """

    class Params(RunParams):
        """The interval."""

        t_max: Annotated[float, lf.MeterPerSecondSquared] = Field(0.4, gt=0)
        """Largest | |f| - gravity | of a still sample."""
        gravity: Annotated[float, lf.MeterPerSecondSquared] = Field(lf.STANDARD_GRAVITY, gt=0)
        """Specific force at rest."""

    def start(self) -> None:
        self.upper = self.params.t_max
        super().start()

    def step_block(self, imu: lf.Imu) -> lf.Step | None:
        norm = statistics.norms(imu.linear_acceleration)
        return self.count(imu.t, np.abs(norm - self.params.gravity))


class DetectorParams(RunParams):
    """What all four detectors have; the threshold is of each."""

    window: Annotated[float, lf.Second] = Field(0.025, gt=0)
    """Length of the sliding window; at least three samples are taken."""
    gravity: Annotated[float, lf.MeterPerSecondSquared] = Field(lf.STANDARD_GRAVITY, gt=0)
    """Specific force at rest."""


class DetectorSteps(RunCounter):
    """Base of the counters behind a detector of inertial navigation."""

    kind: ClassVar[int]
    sigmas: tuple[float, float] = (1.0, 1.0)

    def start(self) -> None:
        p = self.params
        self.upper = p.threshold
        self.constants = np.array([p.gravity, *self.sigmas])
        window = max(3, run_length.samples_of(p.window, p.sample_rate))
        self.window = statistics.new_state(window)
        self.values(np.empty((0, 3)), np.empty((0, 3)))  # compiles
        super().start()

    def values(self, force: np.ndarray, rate: np.ndarray) -> np.ndarray:
        """The statistic of each row, (N,)."""
        out = np.empty(len(force))
        statistics.statistic(self.kind, force, rate, self.constants, self.window, out)
        return out

    def step_block(self, imu: lf.Imu) -> lf.Step | None:
        return self.count(imu.t, self.values(imu.linear_acceleration, imu.angular_velocity))


class ShoeSteps(DetectorSteps):
    """Steps from the stance hypothesis optimal detector (SHOE), force and rate together.

    Source: Skog et al. 2010, IEEE Transactions on Biomedical Engineering 57(11).
    """

    kind = statistics.SHOE

    class Params(DetectorParams):
        """Noise, and the threshold."""

        threshold: float = Field(2e5, gt=0)
        """Largest statistic of a still sample."""
        force_noise: Annotated[float, lf.MeterPerSecondSquared] = Field(0.01, gt=0)
        """Standard deviation of the specific force."""
        rate_noise: Annotated[float, lf.RadPerSecond] = Field(np.pi / 1800, gt=0)
        """Standard deviation of the angular rate."""

    def start(self) -> None:
        self.sigmas = (self.params.force_noise, self.params.rate_noise)
        super().start()


class AredSteps(DetectorSteps):
    """Steps from the energy of the angular rate (ARED).

    Source: Skog et al. 2010, IEEE Transactions on Biomedical Engineering 57(11).
    """

    kind = statistics.ARED

    class Params(DetectorParams):
        """The threshold."""

        threshold: float = Field(1.0, gt=0)
        """Largest mean square of the angular rate of a still sample, rad^2/s^2."""


class AmvdSteps(DetectorSteps):
    """Steps from the moving variance of the specific force (AMVD).

    Source: Skog et al. 2010, IEEE Transactions on Biomedical Engineering 57(11).
    """

    kind = statistics.AMVD

    class Params(DetectorParams):
        """The threshold."""

        threshold: float = Field(0.2, gt=0)
        """Largest variance of the specific force of a still sample, m^2/s^4."""


class MagSteps(DetectorSteps):
    """Steps from the magnitude of the specific force against gravity (MAG).

    Source: Skog et al. 2010, IEEE Transactions on Biomedical Engineering 57(11).
    """

    kind = statistics.MAG

    class Params(DetectorParams):
        """The threshold."""

        threshold: float = Field(0.2, gt=0)
        """Largest mean square of |f| - gravity of a still sample, m^2/s^4."""
