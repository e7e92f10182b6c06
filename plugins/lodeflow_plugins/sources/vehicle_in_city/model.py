"""A vehicle in a city: how it turns, what disturbs its two compasses, and what its gyro reads.

Level throughout. Everything is decided by (settings, seed) and made in frames of fixed length, so
the numbers do not depend on how a run is cut. Field in units of the undisturbed horizontal field,
body axes forward, right, down; heading clockwise from magnetic north.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, fields

import numpy as np
from numba import njit

from lodeflow_plugins.sources import dipoles

FRAME = 1000
"""Rows that are made at once."""

BASELINE = 0.10
"""Distance of the two compasses along the body's x axis, m."""


@dataclass(frozen=True)
class Kind:
    """Sources of one kind.

    period: mean time from one source to the next, s; ramp, hold: ranges in s; closest: range in
    m; farthest, height: m, the height is one standard deviation; magnets: share of permanent
    magnets, the others are iron; strength: range, of a magnet's field at 1 m; radius: range in m,
    of the sphere that the iron is worth; spread: m, of its four parts; sweep: rad, change of the
    azimuth in passing, one standard deviation.
    """

    period: float
    ramp: tuple[float, float]
    hold: tuple[float, float]
    closest: tuple[float, float]
    farthest: float
    height: float
    magnets: float
    strength: tuple[float, float]
    radius: tuple[float, float]
    spread: float
    sweep: float


BENCH = Kind(
    period=24.0, ramp=(4.0, 10.0), hold=(0.0, 8.0), closest=(0.24, 0.31), farthest=1.0,
    height=0.2, magnets=0.78, strength=(0.005, 0.0166), radius=(0.186, 0.257), spread=0.1,
    sweep=0.5,
)  # fmt: skip
"""The magnets and iron cabinets of the bench, at an arm's length."""

STRUCTURES = Kind(
    period=42.0, ramp=(4.0, 16.0), hold=(0.0, 10.0), closest=(2.0, 5.0), farthest=25.0,
    height=1.5, magnets=0.3, strength=(0.8, 8.0), radius=(1.0, 2.2), spread=0.5, sweep=2.0,
)  # fmt: skip
"""Bridges, viaducts, parked lorries: large iron some metres away, also magnetised."""


@dataclass(frozen=True)
class City:
    """Settings of a world. Defaults are the plain scenarios; the others are stress.

    near, far: mean times between sources are divided by these; 0 for none. start: the first
    source is there from the beginning. long: s, one disturbance of this length in the middle and
    no other. carried: it turns with the vehicle, as a load does. step: standard deviation of a
    hard-iron step of each axis and compass, common part included, in the middle.

    gyro_bias, gyro_walk, gyro_noise: rad/s (one standard deviation), rad/s/sqrt(s), rad/sqrt(s).
    gyro_scale: one standard deviation. offset, scale: residual calibration error of each axis,
    one standard deviation; misalignment: of every element of the 3x3 matrix; coloured: noise of
    20 s; tilt: common tilt of both compasses about each level axis, rad, of 1 s.
    """

    near: float = 1.0
    far: float = 0.0
    start: bool = False
    long: float = 0.0
    carried: bool = False
    step: float = 0.0
    dip: float = float(np.radians(48.0))
    noise: float = 0.005
    resolution: float = 1.0 / 1168.0
    offset: float = 0.004
    scale: float = 0.004
    misalignment: float = 0.0
    coloured: float = 0.0
    tilt: float = 0.0
    gyro_bias: float = float(np.radians(0.05))
    fixed_bias: float = 0.0
    gyro_walk: float = float(np.radians(0.0015))
    gyro_noise: float = float(np.radians(0.15)) * 0.05**0.5
    gyro_scale: float = 0.0


MISMATCH = {
    "gyro_scale": 0.005,
    "misalignment": 0.004,
    "coloured": 0.0025,
    "tilt": float(np.radians(0.34)),
}
"""Errors of the sensors that a filter may not know of, as fields of `City`."""
MISMATCH_WALK = float(np.radians(0.0025))
"""Random walk of the gyro's bias on top, rad/s/sqrt(s)."""


@dataclass(frozen=True, eq=False)
class Rows:
    """N rows of the world.

    seconds: (N,); heading: (N,), rad, true; rate: (N,), rad/s, measured, positive to the right;
    fields: (N, 2, 3), measured by the front and the rear compass; disturbance: (N, 2), the true
    disturbance's size at each compass, in the horizontal.
    """

    seconds: np.ndarray
    heading: np.ndarray
    rate: np.ndarray
    fields: np.ndarray
    disturbance: np.ndarray


COLOUR, TILT = 20.0, 1.0  # s, correlation times


def turns(rng: np.random.Generator, duration: float) -> np.ndarray:
    """Turns of a drive, (N, 3): begin and length in s, angle in rad."""
    made = []
    at = rng.uniform(0.0, 10.0)
    while at < duration:
        angle = rng.choice([-1.0, 1.0]) * np.radians(rng.choice([30.0, 60.0, 90.0, 90.0, 180.0]))
        angle *= rng.uniform(0.9, 1.1)
        length = abs(angle) / np.radians(rng.uniform(5.0, 15.0))
        made.append((at, length, angle))
        at += length + rng.uniform(3.0, 30.0)
    return np.array(made).reshape(-1, 3)


@njit(cache=True)
def drive(
    seconds: np.ndarray, start: float, made: np.ndarray, wiggle: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Heading (not wrapped) and its rate at seconds (N,), increasing; (N,) each.

    start: rad, at t = 0; made: of `turns`; wiggle: (M, 3), amplitude rad, frequency Hz and phase
    of sines on top, as nobody drives straight.
    """
    heading, rate = np.empty(len(seconds)), np.empty(len(seconds))
    for k in range(len(seconds)):
        t = seconds[k]
        angle, speed = start, 0.0
        for j in range(len(made)):
            begin, length, turn = made[j, 0], made[j, 1], made[j, 2]
            if t <= begin:
                break
            u = min((t - begin) / length, 1.0)
            angle += turn * (u - np.sin(2.0 * np.pi * u) / (2.0 * np.pi))
            if u < 1.0:
                speed += turn / length * (1.0 - np.cos(2.0 * np.pi * u))
        for j in range(len(wiggle)):
            omega = 2.0 * np.pi * wiggle[j, 1]
            angle += wiggle[j, 0] * np.sin(omega * t + wiggle[j, 2])
            speed += wiggle[j, 0] * omega * np.cos(omega * t + wiggle[j, 2])
        heading[k], rate[k] = angle, speed
    return heading, rate


def _source(
    rng: np.random.Generator, kind: Kind, city: City, start: float, hold: float = 0.0
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    ramp = rng.uniform(*kind.ramp)
    stay = hold or rng.uniform(*kind.hold)
    path = np.array([
        start, ramp, stay, rng.uniform(*kind.closest), kind.farthest,
        kind.height * rng.standard_normal(), rng.uniform(0.0, 2.0 * np.pi),
        kind.sweep * rng.standard_normal(), float(city.carried), 0.0,
    ])  # fmt: skip
    if rng.random() < kind.magnets:
        parts = dipoles.magnet(rng, rng.uniform(*kind.strength))
    else:
        parts = dipoles.iron(rng, rng.uniform(*kind.radius), kind.spread, city.dip)
    return (path, *parts)


def sources(rng: np.random.Generator, city: City, duration: float) -> dipoles.Sources:
    """What the vehicle meets on a drive of this duration, s."""
    made = []
    both = [(BENCH, city.near), (STRUCTURES, city.far)]
    if city.long:
        kind = BENCH if rng.random() * (city.near + city.far) < city.near else STRUCTURES
        made.append(_source(rng, kind, city, 0.5 * (duration - city.long), city.long))
        both = []
    for kind, frequency in both:
        if frequency == 0.0:
            continue
        at = rng.exponential(kind.period / frequency)
        if city.start:
            source = _source(rng, kind, city, 0.0)
            source[0][dipoles.START] -= source[0][dipoles.RAMP]  # it is closest from the begin on
            made.append(source)
            at += source[0][dipoles.RAMP] + source[0][dipoles.HOLD]
        while at < duration:
            source = _source(rng, kind, city, at)
            made.append(source)
            at += source[0][dipoles.RAMP] * 2.0 + source[0][dipoles.HOLD]
            at += rng.exponential(0.5 * kind.period / frequency)
    return dipoles.Sources.of(made)


@njit(cache=True)
def coloured(noise: np.ndarray, decay: float, state: np.ndarray) -> np.ndarray:
    """First-order Gauss-Markov noise of unit variance from white noise (N, M), in place.

    decay: of one row; state: (M,), the last value, carried on.
    """
    gain = np.sqrt(1.0 - decay * decay)
    for k in range(len(noise)):
        for j in range(noise.shape[1]):
            state[j] = decay * state[j] + gain * noise[k, j]
            noise[k, j] = state[j]
    return noise


@njit(cache=True)
def summed(noise: np.ndarray, state: np.ndarray) -> np.ndarray:
    """The running sum of noise (N,) on top of state (1,), one after the other, in place."""
    for k in range(len(noise)):
        state[0] += noise[k]
        noise[k] = state[0]
    return noise


class World:
    """One drive, as iterable frames of rows.

    Args:
        city: settings.
        seed: of everything random.
        duration: s.
        rate: rows per second, Hz.
    """

    def __init__(self, city: City, seed: int, duration: float, rate: float) -> None:
        layout, errors = (np.random.default_rng([seed, i]) for i in range(2))
        self.city, self.seed, self.duration, self.rate = city, seed, duration, rate
        self.start = layout.uniform(0.0, 2.0 * np.pi)
        self.turns = turns(layout, duration)
        self.wiggle = np.column_stack([
            np.radians(layout.uniform(0.3, 1.0, 3)),
            layout.uniform(0.02, 0.3, 3),
            layout.uniform(0.0, 2.0 * np.pi, 3),
        ])  # fmt: skip
        self.sources = sources(layout, city, duration)
        diagonal = np.eye(3) * (1.0 + city.scale * errors.standard_normal((2, 1, 3)))
        self.matrix = diagonal + city.misalignment * errors.standard_normal((2, 3, 3))
        self.offset = city.offset * errors.standard_normal((2, 3))
        self.step = city.step * errors.standard_normal((2, 3))
        self.bias = city.gyro_bias * errors.standard_normal()
        self.bias += city.fixed_bias * errors.choice([-1.0, 1.0])
        self.gyro_scale = 1.0 + city.gyro_scale * errors.standard_normal()

    def frames(self) -> Iterator[Rows]:
        """Yield the drive from its begin to its end."""
        city, draw = self.city, np.random.default_rng([self.seed, 2])
        dt = 1.0 / self.rate
        walk, slow, tilt = np.zeros(1), draw.standard_normal(6), draw.standard_normal(2)
        count = round(self.duration * self.rate)
        sensors = np.array([[BASELINE / 2, 0.0, 0.0], [-BASELINE / 2, 0.0, 0.0]])
        for first in range(0, count, FRAME):
            n = min(FRAME, count - first)
            white = draw.standard_normal((n, 16))
            seconds = np.arange(first, first + n) * dt
            heading, rate = drive(seconds, self.start, self.turns, self.wiggle)
            drift = summed(white[:, 0] * city.gyro_walk * np.sqrt(dt), walk)
            measured = rate * self.gyro_scale + self.bias + drift
            measured += city.gyro_noise / np.sqrt(dt) * white[:, 1]
            slower = coloured(white[:, 2:8].copy(), np.exp(-dt / COLOUR), slow)
            tilts = coloured(white[:, 8:10].copy(), np.exp(-dt / TILT), tilt) * city.tilt
            added = white[:, 10:16].reshape(n, 2, 3) * city.noise
            added += city.coloured * slower.reshape(n, 2, 3)
            down = np.tan(city.dip)
            fields = np.empty((n, 2, 3))
            disturbed = np.empty((n, 2))
            for i in range(2):
                extra = dipoles.disturbance(
                    seconds, heading, sensors[i], self.sources.path, self.sources.offsets,
                    self.sources.moments,
                )  # fmt: skip
                disturbed[:, i] = np.hypot(extra[:, 0], extra[:, 1])
                earth = np.column_stack([np.cos(heading), -np.sin(heading), np.full(n, down)])
                body = earth + extra
                # A compass that is tilted by less than it knows mixes the vertical into the level.
                leaning = body.copy()
                leaning[:, 0] += tilts[:, 0] * body[:, 2]
                leaning[:, 1] += tilts[:, 1] * body[:, 2]
                leaning[:, 2] -= tilts[:, 0] * body[:, 0] + tilts[:, 1] * body[:, 1]
                fields[:, i] = np.einsum("ij,nj->ni", self.matrix[i], leaning) + self.offset[i]
                fields[seconds >= self.duration / 2, i] += self.step[i]
            fields += added
            if city.resolution:
                fields = np.rint(fields / city.resolution) * city.resolution
            yield Rows(seconds, heading, measured, fields, disturbed)

    def rows(self) -> Rows:
        """The whole drive at once."""
        made = list(self.frames())
        return Rows(*[np.concatenate([getattr(m, f.name) for m in made]) for f in fields(Rows)])
