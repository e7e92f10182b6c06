"""What a platform does: Euler angles as functions of time, with their exact derivatives.

Heading, pitch and roll are the Z-Y-X angles from NED to FRD, in rad. A programme is a function of
time alone, so that it may be evaluated in any pieces.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

ATTITUDES = np.radians(
    [
        [heading, pitch, roll]
        for pitch in (-60, -20, 20, 60)
        for roll in (-40, 40)
        for heading in range(0, 360, 30)
    ]
)
"""96 positions, as for the figures of the error separation."""

SIX_POSITIONS = np.radians(
    [[0, 0, 0], [0, 0, 180], [0, 0, 90], [0, 0, -90], [0, -90, 0], [0, 90, 0]]
)
"""Table 2 of Chu et al. 2017: z, -z, y, -y, x and -x (FRD) down."""

RATES = np.radians([30.0, -30.0, 60.0, -60.0, 90.0, -90.0])
"""Section 3.3: six rates about each axis, rad/s; each turn is undone by the next."""

TUMBLE = (0.311, 0.097, 0.171)
"""Rates of heading, pitch and roll, rad/s, in no simple ratio: the axes point everywhere."""


class Programme(Protocol):
    """Angles and their rates over time."""

    duration: float

    def __call__(self, seconds: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return angles (N, 3), rad, their rates (N, 3), rad/s, and the stop (N,) of each time."""
        ...


@dataclass(frozen=True, eq=False)
class Stops:
    """Stand in one position after the other, with smooth moves between.

    angles: (S, 3), rad; rest, move: s, at each stop and to the next.
    """

    angles: np.ndarray
    rest: float
    move: float

    @property
    def duration(self) -> float:
        return len(self.angles) * (self.rest + self.move)

    def __call__(self, seconds: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        stop = np.minimum(seconds // (self.rest + self.move), len(self.angles) - 1).astype(int)
        way = self.angles[(stop + 1) % len(self.angles)] - self.angles[stop]
        way[:, 0] = (way[:, 0] + np.pi) % (2.0 * np.pi) - np.pi
        begun = seconds - stop * (self.rest + self.move) - self.rest
        u = np.clip(begun / self.move, 0.0, 1.0)[:, None]
        angles = self.angles[stop] + way * (u * u * (3.0 - 2.0 * u))
        return angles, way * (6.0 * u * (1.0 - u) / self.move), stop


@dataclass(frozen=True, eq=False)
class Turns:
    """Turn about the body's x, y and z axis in turn, at each of some rates.

    rates: (R,), rad/s, held for `rest` s, with ramps of half `move` s before and after. The
    sensor is put on the table anew for each axis.
    """

    rates: np.ndarray
    rest: float
    move: float

    @property
    def duration(self) -> float:
        return 3 * len(self.rates) * (self.rest + self.move)

    def __call__(self, seconds: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        each, ramp = self.rest + self.move, self.move / 2.0
        stop = np.minimum(seconds // each, 3 * len(self.rates) - 1).astype(int)
        rate = self.rates[stop % len(self.rates)]
        s = seconds - stop * each
        up, down = np.clip(s, 0.0, ramp), np.clip(s - ramp - self.rest, 0.0, ramp)
        held = np.clip(s - ramp, 0.0, self.rest)
        turned = up**2 / (2.0 * ramp) + held + down - down**2 / (2.0 * ramp)
        before = np.cumsum(np.tile(self.rates, 3)) - np.tile(self.rates, 3)
        angle = before[stop] * (self.rest + ramp) + rate * turned
        axis = 2 - stop // len(self.rates)  # roll turns about x, pitch about y, heading about z
        angles, rates = np.zeros((len(seconds), 3)), np.zeros((len(seconds), 3))
        rows = np.arange(len(seconds))
        angles[rows, axis] = angle
        rates[rows, axis] = rate * (up - down) / ramp
        return angles, rates, stop


@dataclass(frozen=True, eq=False)
class Tumble:
    """Turn slowly about all axes at once.

    rates: (3,), rad/s, of heading, pitch and roll; duration: s.
    """

    rates: np.ndarray
    duration: float

    def __call__(self, seconds: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        angles = seconds[:, None] * self.rates
        rates = np.repeat(self.rates[None], len(seconds), axis=0)
        return angles, rates, np.zeros(len(seconds), int)
