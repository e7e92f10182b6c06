"""The turntable of Hao, Yang and Huang: ten degrees a step, and something magnetic beside it.

Twenty rotations make a sample of data. In a rotation there is, with some probability, one source
at an arm's length: it comes nearer, and withdraws again. The compasses are level, and calibrated
up to a residual error.

Source: the experiment is of Hao et al., sections 1 and 3; the sizes, which the paper does not
give, are chosen so that tables 1 and 2 of the paper come out about right, see
docs/interference.md. Fields in units of the undisturbed horizontal field, body axes forward,
right, down, headings clockwise from magnetic north.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lodeflow_plugins.sources import dipoles

STEPS = 36
"""Positions of a rotation."""
BASELINE = 0.10
"""Distance of the two compasses along the body's x axis, m."""


@dataclass(frozen=True)
class Bench:
    """Settings of the bench; all ranges are uniform.

    disturbed: probability of a source in a rotation; farthest, closest: horizontal distance of it,
    m; width, centre: of its visit, as parts of the rotation; height: m, one standard deviation;
    magnets: share of permanent magnets, the others are iron; strength: field of a magnet at 1 m;
    radius: m, of the sphere that the iron is worth, in four parts with the standard deviation
    spread about their centre. offset, scale: residual calibration error of each axis, one standard
    deviation; noise: white, of each reading; resolution: 1 LSB.
    """

    disturbed: float = 0.70
    farthest: float = 0.38
    closest: tuple[float, float] = (0.24, 0.31)
    width: tuple[float, float] = (0.53, 0.87)
    centre: tuple[float, float] = (0.25, 0.75)
    height: float = 0.20
    magnets: float = 0.78
    strength: tuple[float, float] = (0.005, 0.0166)
    radius: tuple[float, float] = (0.186, 0.257)
    spread: float = 0.2
    dip: float = float(np.radians(48.0))
    offset: float = 0.004
    scale: float = 0.004
    noise: float = 0.008
    resolution: float = 1.0 / 1168.0


class Turntable:
    """One sample of data: rotations one after the other, each a function of seed and number."""

    def __init__(self, bench: Bench, seed: int) -> None:
        self.bench, self.seed = bench, seed
        errors = np.random.default_rng([seed, 0])
        self.offset = bench.offset * errors.standard_normal((2, 2))
        self.gain = 1.0 + bench.scale * errors.standard_normal((2, 2))
        self.heading = np.radians(360.0 / STEPS * np.arange(STEPS))

    def rotation(self, number: int) -> np.ndarray:
        """Fields (36, 2, 3) of the front and the rear compass in a rotation."""
        bench = self.bench
        rng = np.random.default_rng([self.seed, 1, number])
        fields = np.empty((STEPS, 2, 3))
        fields[:, :, 0] = np.cos(self.heading)[:, None]
        fields[:, :, 1] = -np.sin(self.heading)[:, None]
        fields[:, :, 2] = np.tan(bench.dip)
        if rng.random() < bench.disturbed:
            source = self._source(rng)
            for i, forward in enumerate((BASELINE / 2, -BASELINE / 2)):
                fields[:, i] += dipoles.disturbance(
                    np.arange(STEPS) / STEPS, self.heading, np.array([forward, 0.0, 0.0]),
                    source.path, source.offsets, source.moments,
                )  # fmt: skip
        fields[:, :, :2] = fields[:, :, :2] * self.gain + self.offset
        fields += bench.noise * rng.standard_normal(fields.shape)
        if bench.resolution:
            fields = np.rint(fields / bench.resolution) * bench.resolution
        return fields

    def _source(self, rng: np.random.Generator) -> dipoles.Sources:
        bench = self.bench
        width, centre = rng.uniform(*bench.width), rng.uniform(*bench.centre)
        path = np.array([
            centre - width / 2, width / 2, 0.0, rng.uniform(*bench.closest), bench.farthest,
            bench.height * rng.standard_normal(), rng.uniform(0.0, 2.0 * np.pi), 0.0, 0.0, 1.0,
        ])  # fmt: skip
        if rng.random() < bench.magnets:
            parts = dipoles.magnet(rng, rng.uniform(*bench.strength))
        else:
            parts = dipoles.iron(rng, rng.uniform(*bench.radius), bench.spread, bench.dip)
        return dipoles.Sources.of([(path, *parts)])
