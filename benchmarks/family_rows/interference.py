"""The stages of two compasses, and the headings."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import numpy as np

import lodeflow as lf
from family_rows import Blocks, KalmanByNumpy, Reference, Row, stateless
from lodeflow.clock import SimClock
from lodeflow.registry import registry
from lodeflow.testing import run_node

RATE = 20.0  # Hz
CENTRES = registry().load("fcm_stage").example


@cache
def drive(n: int) -> dict[str, lf.Message]:
    """A drive among all kinds of sources, and what each stage says of it."""
    source = registry().load("vehicle_in_city")
    vehicle = source(source.Params(scenario="mixed", rate=RATE, duration=n / RATE))
    vehicle.start()
    parts = list(vehicle.read(SimClock()))
    first, second, gyro = (
        type(getattr(parts[0], name)).concat([getattr(part, name) for part in parts])
        for name in ("first", "second", "gyro")
    )
    node = registry().load
    params = {"rate_interval": 1.0}
    features = run_node(node("dmc_features"), params, first=first, second=second)["out"]
    passed = run_node(node("threshold_stage"), {}, features=features)["out"]
    mode = run_node(node("mode_switch"), {}, credibility=passed)["out"]
    return {
        "first": first, "second": second, "features": features, "passed": passed,
        "credibility": passed, "mode": mode, "compass": features, "gyro": gyro,
    }  # fmt: skip


def take(*ports: str) -> Callable[[int], Blocks]:
    """Make the streams of the drive that a node takes."""
    return lambda n: {port: drive(n)[port] for port in ports}


def features(s: Blocks) -> tuple[np.ndarray, ...]:
    """Values, and rates over a second."""
    a, b = s["first"].magnetic_field, s["second"].magnetic_field
    one, other = np.arctan2(a[:, 1], a[:, 0]), np.arctan2(b[:, 1], b[:, 0])
    apart = (one - other + np.pi) % (2.0 * np.pi) - np.pi
    strength = np.hypot(a[:, 0], a[:, 1]) / 33.5e-6 - 1.0, np.hypot(b[:, 0], b[:, 1]) / 33.5e-6 - 1
    values = np.stack([apart, *strength])
    return one % (2.0 * np.pi), other % (2.0 * np.pi), values, values[:, 20:] - values[:, :-20]


def thresholds(s: Blocks) -> np.ndarray:
    f = s["features"]
    return (
        (np.abs(f.field_error) < 0.171).all(axis=1)
        & (np.abs(f.field_error_rate) < 0.086).all(axis=1)
        & (np.abs(f.heading_difference) < 0.14)
        & (np.abs(f.heading_difference_rate) < 0.14)
    )


def memberships(s: Blocks) -> np.ndarray:
    """Memberships in the two clusters nearest zero, of both compasses."""
    f = s["features"]
    difference = np.abs(f.heading_difference) / 0.14
    found = []
    for at, name in enumerate(("first_centres", "second_centres")):
        points = np.column_stack([np.abs(f.field_error[:, at]) / 0.171, difference])
        weight = 1.0 / ((points[:, None] - np.array(CENTRES[name])) ** 2).sum(axis=2)
        found.append(weight[:, -2:].sum(axis=1) / weight.sum(axis=1))
    return np.where(s["passed"].valid > 0, np.minimum(*found), 0.0)


def switch() -> Reference:
    """Modes by dwelling, row by row."""
    state = {"mode": False, "since": -(2**62)}

    def run(s: Blocks) -> list[bool]:
        modes = []
        for t, valid in zip(s["credibility"].t.tolist(), s["credibility"].valid, strict=True):
            if (valid > 0) == state["mode"]:
                state["since"] = t
            elif t - state["since"] >= 1_000_000_000:
                state["mode"] = not state["mode"]
            modes.append(state["mode"])
        return modes

    return run


def integrated(s: Blocks) -> np.ndarray:
    """The compass while trusted, else the gyro from there on; modes of each row known."""
    turned = np.cumsum(s["gyro"].angular_rate[:, 2]) / RATE
    at = np.searchsorted(s["mode"].t, s["compass"].t, side="right") - 1
    trusted = s["mode"].mode[at] == 0
    last = np.maximum.accumulate(np.where(trusted, np.arange(len(trusted)), 0))
    return s["compass"].heading[last] + turned - turned[last]


HEADING = take("compass", "mode", "gyro")
ROWS = [
    Row(
        "dmc_features",
        stateless(features),
        take("first", "second"),
        params={"rate_interval": 1.0},
        whole=True,
    ),
    Row("threshold_stage", stateless(thresholds), take("features")),
    Row("fcm_stage", stateless(memberships), take("features", "passed")),
    Row("mode_switch", switch, take("credibility")),
    Row("integrated_heading", stateless(integrated), HEADING, whole=True),
    Row("gated_kalman", lambda: KalmanByNumpy("compass", 2, 1), HEADING),
    Row("heading_estimator", lambda: KalmanByNumpy("compass", 8, 5), HEADING),
]
