"""Headings where the field is disturbed between 60 and 100 s, simulated: ours beside VQF.

    python benchmarks/attitude_worlds.py [--json]

A body is turned about by hand for 200 s at 100 Hz; its gyroscope has noise of 0.1 deg/s and a bias
of up to 0.25 deg/s, its magnetometer noise of 0.4 uT in a field of 48 uT with a dip of 65 deg.
Figures are the RMSE of the heading in degrees before, while, in the 30 s after, and later. The
filters have their defaults; "without drift" is heading_kalman with drift 0 and heading_walk
0.6 deg/sqrt(s), which has a state less.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np

import lodeflow as lf
from lodeflow.testing import run_node
from lodeflow_plugins.fusion.attitude_fuser.node import AttitudeFuser
from lodeflow_plugins.fusion.inertial_attitude.node import InertialAttitude
from lodeflow_plugins.fusion.peers.vqf import Vqf
from lodeflow_plugins.sources.simulated_vehicle import model

HERTZ, SECONDS = 100, 200
BEGIN, END = 60, 100
SPANS = {
    "before": (10, BEGIN),
    "while": (BEGIN, END),
    "30 s after": (END, END + 30),
    "later": (END + 30, SECONDS),
}
SIMPLER = {"drift": 0.0, "heading_walk": "0.6 deg/sqrt(s)"}
FILTERS: dict[str, Callable[..., Any]] = {
    "inertial_attitude": lambda imu, mag: run_node(InertialAttitude, imu=imu)["attitude"],
    "vqf": lambda imu, mag: run_node(Vqf, {"rate": HERTZ}, imu=imu, mag=mag)["out"],
    "attitude_fuser": lambda imu, mag: run_node(AttitudeFuser, imu=imu, mag=mag)["out"],
    "without drift": lambda imu, mag: run_node(AttitudeFuser, SIMPLER, imu=imu, mag=mag)["out"],
}


def swaying(*sines: tuple[float, float, float]) -> model.Motion:
    return model.Motion(sines=tuple((np.radians(a), hertz, phase) for a, hertz, phase in sines))


def in_body(earth: np.ndarray, quaternion: np.ndarray) -> np.ndarray:
    """Turn earth vectors (3,) or (N, 3) into the body frame of quaternions (N, 4)."""
    u, w = -quaternion[:, :3], quaternion[:, 3:]
    v = np.broadcast_to(earth, u.shape)
    twice = 2.0 * np.cross(u, v)
    return v + w * twice + np.cross(u, twice)


def about_vertical(estimate: np.ndarray, truth: np.ndarray) -> np.ndarray:
    """Signed heading errors (N,), degrees."""
    z = estimate[:, 2] * truth[:, 3] - estimate[:, 3] * truth[:, 2]
    z += estimate[:, 1] * truth[:, 0] - estimate[:, 0] * truth[:, 1]
    angle = 2.0 * np.arctan2(z, np.sum(estimate * truth, axis=1))
    return np.degrees((angle + np.pi) % (2.0 * np.pi) - np.pi)


def worlds(
    t: np.ndarray, quaternion: np.ndarray, field: np.ndarray
) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Fields (N, 3), tesla, and the samples that have one (M,), of each world."""
    s = t * 1e-9
    while_ = ((s >= BEGIN) & (s < END))[:, None]
    body = partial(in_body, quaternion=quaternion)
    steady = body(np.array([10e-6, -6e-6, 6e-6]))
    changing = np.stack(
        [15e-6 * np.sin(0.5 * s), 10e-6 * np.cos(0.33 * s), 8e-6 * np.sin(0.21 * s)], axis=1
    )
    rng = np.random.default_rng(3)
    spikes = (rng.random(len(t)) < 0.05)[:, None] * rng.normal(0.0, 15e-6, field.shape)
    everywhere = np.arange(len(t))
    fields = {
        "no disturbance": field,
        "field that changes along the way, 15 µT": field + while_ * body(changing),
        "magnet on the body, 15 µT": field + while_ * np.array([13.5e-6, -5.25e-6, 3.75e-6]),
        "steady field of 13 µT": field + while_ * steady,
        "steady field of 13 µT, from the start": field + (s < END)[:, None] * steady,
        "single wrong readings, 5 %, 15 µT": field + while_ * spikes,
    }
    return {name: (f, everywhere) for name, f in fields.items()} | {
        "no magnetometer": (field, np.flatnonzero(~while_[:, 0])),
        "magnetometer that is noise, 30 µT": (
            np.where(while_, rng.normal(0.0, 30e-6, field.shape), field),
            everywhere,
        ),
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--json", action="store_true")
    args = parser.parse_args()
    t = np.arange(SECONDS * HERTZ, dtype=np.int64) * (10**9 // HERTZ)
    hand = model.Vehicle(
        heading=swaying((60, 0.11, 0), (30, 0.31, 1)),
        pitch=swaying((30, 0.17, 0), (10, 0.5, 2)),
        roll=swaying((40, 0.13, 0), (15, 0.41, 1)),
        dip=float(np.radians(65.0)),
        field=48e-6,
    )
    errors = model.Errors(
        gyroscope=model.SensorError(np.radians(0.1), (0.002, -0.003, 0.004)),
        accelerometer=model.SensorError(0.03),
        magnetometer=model.SensorError(0.4e-6),
    )
    truth = model.truth(hand, t * 1e-9)
    read = model.readings(truth, errors, 0, 0)
    imu = lf.Imu(t, read.angular_velocity, read.specific_force)
    found: dict[str, dict[str, list[float]]] = {}
    for world, (field, rows) in worlds(t, truth.quaternion, read.magnetic_field).items():
        mag = lf.MagneticField(t[rows], np.ascontiguousarray(field[rows]))
        for name, run in FILTERS.items():
            error = about_vertical(run(imu, mag).quaternion, truth.quaternion)
            if name == "inertial_attitude":
                error -= error[: BEGIN * HERTZ].mean()  # its heading starts anywhere
            spans = [slice(a * HERTZ, b * HERTZ) for a, b in SPANS.values()]
            rmse = [float(np.sqrt(np.mean(error[span] ** 2))) for span in spans]
            found.setdefault(world, {})[name] = rmse
    if args.json:
        print(json.dumps({"unit": "degrees", "spans": SPANS, "worlds": found}, indent=2))
        return
    print(f"| world | filter | {' | '.join(SPANS)} |")
    print(f"|---|---|{'---:|' * len(SPANS)}")
    for world, rows_ in found.items():
        for name, rmse in rows_.items():
            print(f"| {world} | {name} | {' | '.join(f'{x:.2f}' for x in rmse)} |")


if __name__ == "__main__":
    main()
