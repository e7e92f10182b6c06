"""Magnetic dipoles that come near and leave again: what disturbs a compass in the worlds here.

Frame: north, east, down, with the undisturbed horizontal field as the unit of field. The earth's
field is (1, 0, tan dip). A dipole moment has the unit field x m^3, so that m is the field in the
equatorial plane at 1 m.

A source is four dipoles around a centre that approaches and leaves. A magnet uses one of them; an
iron body has four that the earth's field induces, a^3 B for a sphere of radius a and high
permeability.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit

DIPOLES = 4

# Columns of `Sources.path`.
START, RAMP, HOLD = 0, 1, 2  # s: begin, time of coming near and of leaving, time of staying
CLOSEST, FARTHEST, HEIGHT = 3, 4, 5  # m: horizontal distances, and down
AZIMUTH, SWEEP = 6, 7  # rad: direction of the centre at the begin, and its change until the end
CARRIED = 8  # 1: azimuth and moments turn with the body, 0: they stay with the earth
WAITS = 9  # 1: before and after it stands at its farthest, 0: it is not there
PATH_SIZE = 10


@dataclass(frozen=True, eq=False)
class Sources:
    """N sources, in the order of their beginnings.

    path: (N, 10), see the columns above; offsets: (N, 4, 3), m, of the dipoles from the centre;
    moments: (N, 4, 3), in units of the horizontal field times m^3.
    """

    path: np.ndarray
    offsets: np.ndarray
    moments: np.ndarray

    @staticmethod
    def of(made: list[tuple[np.ndarray, np.ndarray, np.ndarray]]) -> Sources:
        """Stack sources (path, offsets, moments), sorted by their beginnings."""
        made = sorted(made, key=lambda source: source[0][START])
        path = np.array([source[0] for source in made]).reshape(-1, PATH_SIZE)
        offsets = np.array([source[1] for source in made]).reshape(-1, DIPOLES, 3)
        moments = np.array([source[2] for source in made]).reshape(-1, DIPOLES, 3)
        return Sources(path, offsets, moments)


def magnet(rng: np.random.Generator, strength: float) -> tuple[np.ndarray, np.ndarray]:
    """Offsets and moments of a permanent magnet in a random direction; strength: field x m^3."""
    direction = rng.standard_normal(3)
    moments = np.zeros((DIPOLES, 3))
    moments[0] = strength * direction / np.sqrt(direction @ direction)
    return np.zeros((DIPOLES, 3)), moments


def iron(
    rng: np.random.Generator, radius: float, spread: float, dip: float
) -> tuple[np.ndarray, np.ndarray]:
    """Offsets and moments of an iron body that is worth a sphere of this radius, m, in all.

    spread: standard deviation of the four parts from the centre, m.
    """
    field = np.array([1.0, 0.0, np.tan(dip)])
    offsets = spread * rng.standard_normal((DIPOLES, 3))
    return offsets, np.tile(radius**3 / DIPOLES * field, (DIPOLES, 1))


@njit(cache=True)
def disturbance(
    seconds: np.ndarray,
    heading: np.ndarray,
    sensor: np.ndarray,
    path: np.ndarray,
    offsets: np.ndarray,
    moments: np.ndarray,
) -> np.ndarray:
    """Field of all sources at a sensor, in body axes (forward, right, down); (N, 3).

    seconds, heading: (N,), s and rad, with seconds increasing; sensor: (3,), m, its place in body
    axes; path, offsets, moments: of `Sources`.
    """
    field = np.zeros((len(seconds), 3))
    for j in range(len(path)):
        start, ramp, hold = path[j, START], path[j, RAMP], path[j, HOLD]
        end = start + 2.0 * ramp + hold
        waits = path[j, WAITS] == 1.0
        first = 0 if waits else np.searchsorted(seconds, start)
        for k in range(first, len(seconds)):
            t = seconds[k] - start
            if t >= end - start and not waits:
                break
            t = min(max(t, 0.0), end - start)
            near = 1.0
            if t < ramp:
                near = 0.5 - 0.5 * np.cos(np.pi * t / ramp)
            elif t > ramp + hold:
                near = 0.5 - 0.5 * np.cos(np.pi * (end - start - t) / ramp)
            distance = path[j, FARTHEST] + (path[j, CLOSEST] - path[j, FARTHEST]) * near
            azimuth = path[j, AZIMUTH] + path[j, SWEEP] * t / (end - start)
            turn = 0.0 if path[j, CARRIED] == 1.0 else heading[k]
            c, s = np.cos(turn), np.sin(turn)
            north, east = distance * np.cos(azimuth), distance * np.sin(azimuth)
            for i in range(DIPOLES):
                mn, me, md = moments[j, i, 0], moments[j, i, 1], moments[j, i, 2]
                if mn == 0.0 and me == 0.0 and md == 0.0:
                    continue
                pn, pe = north + offsets[j, i, 0], east + offsets[j, i, 1]
                # In body axes, from the dipole to the sensor.
                x = sensor[0] - (c * pn + s * pe)
                y = sensor[1] - (c * pe - s * pn)
                z = sensor[2] - (path[j, HEIGHT] + offsets[j, i, 2])
                mx, my = c * mn + s * me, c * me - s * mn
                square = max(x * x + y * y + z * z, CORE * CORE)
                cube = square * np.sqrt(square)
                along = 3.0 * (mx * x + my * y + md * z) / square
                field[k, 0] += (along * x - mx) / cube
                field[k, 1] += (along * y - my) / cube
                field[k, 2] += (along * z - md) / cube
    return field


CORE = 0.05
"""Nearest distance at which a dipole is one, m."""
