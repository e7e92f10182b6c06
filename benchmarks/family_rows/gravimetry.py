"""Eötvös, Coriolis and tilt corrections."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

import lodeflow as lf
from family_rows import Blocks, Row, stamps, stateless
from lodeflow_plugins.filtering import smoothing
from lodeflow_plugins.gravimetry.earth import rotation

RATE = 50.0  # Hz
G = lf.STANDARD_GRAVITY


def flight(n: int) -> dict[str, lf.Message]:
    """A vehicle that sways."""
    rng = np.random.default_rng(0)
    t, full = stamps(n, RATE), np.full(n, 0.5)
    acceleration = 0.1 * rng.standard_normal((n, 3))
    some = t[::500].copy()
    north, east = 1e-5 * rng.standard_normal((2, len(some)))
    return {
        "motion": lf.GeodeticMotion(t, full, full, 300 * full, 60 + rng.standard_normal((n, 3))),
        "deflection": lf.Deflection(some, north, east),
        "force": lf.SpecificForce(t, acceleration + np.array([0.0, 0.0, G])),
        "acceleration": lf.Acceleration(t, acceleration),
        "coriolis": lf.Acceleration(t, 1e-3 * acceleration),
        "raw": lf.GravityCorrection(t, acceleration[:, 0].copy()),
    }


def take(*ports: str) -> Callable[[int], Blocks]:
    """Make the streams of the flight that a node takes."""
    return lambda n: {port: block for port, block in flight(n).items() if port in ports}


def radii(latitude: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Radii of curvature N and M of the ellipsoid."""
    root = 1.0 - rotation.ECCENTRICITY_SQUARED * np.sin(latitude) ** 2
    n = rotation.SEMI_MAJOR_AXIS / np.sqrt(root)
    return n, n * (1.0 - rotation.ECCENTRICITY_SQUARED) / root


def eotvos(s: Blocks) -> np.ndarray:
    m = s["motion"]
    n, meridian = radii(m.latitude)
    east, north = m.velocity[:, 0], m.velocity[:, 1]
    turning = 2.0 * rotation.EARTH_RATE * np.cos(m.latitude) * east
    return turning + east**2 / (n + m.height) + north**2 / (meridian + m.height)


def coriolis(s: Blocks) -> np.ndarray:
    m, w = s["motion"], rotation.EARTH_RATE
    n, meridian = radii(m.latitude)
    east, north, up = m.velocity.T
    sine, cosine = np.sin(m.latitude), np.cos(m.latitude)
    turn = 2.0 * w * sine + east * np.tan(m.latitude) / (n + m.height)
    lift = 2.0 * w * cosine + east / (n + m.height)
    return np.stack([-turn * north + lift * up, turn * east + north * up / (meridian + m.height)])


def disturbing(s: Blocks) -> np.ndarray:
    at = np.searchsorted(s["deflection"].t, s["motion"].t, side="right") - 1
    return -G * np.stack([s["deflection"].east[at], s["deflection"].north[at]])


def kinematic(s: Blocks) -> np.ndarray:
    return np.gradient(s["motion"].velocity, 1.0 / RATE, axis=0)


def tilt(s: Blocks) -> np.ndarray:
    weights = smoothing.low_pass(1.0 / 5.0, RATE)
    f, a, c = (
        np.stack([np.convolve(column, weights, "valid") for column in columns.T])
        for columns in (s["force"].specific_force, s["acceleration"].acceleration[:, :2],
                        s["coriolis"].acceleration[:, :2])
    )  # fmt: skip
    excess = f[0] ** 2 + f[1] ** 2 - ((a + c) ** 2).sum(axis=0)
    return np.stack(
        [f[0] ** 2 + f[1] ** 2 - (a**2).sum(axis=0), excess, np.sqrt(f[2] ** 2 + excess)]
    )


def budget(s: Blocks) -> tuple[np.ndarray, np.ndarray]:
    return s["force"].specific_force.sum(axis=0), s["acceleration"].acceleration.sum(axis=0)


def low_pass(s: Blocks) -> np.ndarray:
    return np.convolve(s["raw"].correction, smoothing.low_pass(1.0 / 5.0, RATE), "valid")


FILTER = {"sample_rate": RATE, "period": 5.0}
ROWS = [
    Row("eotvos", stateless(eotvos), take("motion")),
    Row("horizontal_coriolis", stateless(coriolis), take("motion")),
    Row("disturbing_gravity", stateless(disturbing), take("motion", "deflection"), whole=True),
    Row("kinematic_acceleration", stateless(kinematic), take("motion"), whole=True),
    Row(
        "tilt_correction",
        stateless(tilt),
        take("force", "acceleration", "coriolis"),
        params=FILTER,
        whole=True,
    ),
    Row("tilt_error_budget", stateless(budget), take("force", "acceleration")),
    Row("gravity_low_pass", stateless(low_pass), take("raw"), params=FILTER, whole=True),
]
