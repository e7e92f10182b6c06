"""All graphs that lodeflow comes with, each with arguments that make a short run of it."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import scipy.io
from command_line import CommandLine

GRAPHS = Path(__file__).parents[2] / "graphs"
DATA = os.environ.get("LODEFLOW_DATA")
ON_DATA = {
    "gravimetry": "gravity/EastVicTest_8001.04.npz",
    "pedestrian": "steps/ngimu_short_walk.npz",
    "steps": "steps/ngimu_short_walk.npz",
}
"""Graphs on other people's recordings, where those are."""
ARGUMENTS = {
    "heading": ["--arg", "duration=20"],
    "attitude": ["--arg", "recording=trial.mcap"],
    "broad": ["--arg", "recording=trial.mcap"],
    "dmc": ["--arg", "duration=60"],
    "tilt_errors": ["--set", "level.samples=9000", "--set", "noisy.samples=9000"],
}
NAMES = sorted(
    path.stem for path in GRAPHS.glob("*.yaml") if DATA is not None or path.stem not in ON_DATA
)


def prepared(name: str, lodeflow: CommandLine) -> list[str]:
    """Return the file of a graph and its arguments; what it reads is written first."""
    arguments = list(ARGUMENTS.get(name, ()))
    if name in ON_DATA:
        arguments += ["--arg", f"file={Path(str(DATA)) / ON_DATA[name]}"]
    if "recording=trial.mcap" in arguments:
        trial(lodeflow.folder / "trial.mat")
        lodeflow("import", "broad", "trial.mat", "trial.mcap")
    return [str(GRAPHS / f"{name}.yaml"), *arguments]


def trial(path: Path, rows: int = 2000) -> None:
    """Write a file in the form of BROAD's, with a gap in the truth."""
    rng = np.random.default_rng(1)
    truth = np.tile([1.0, 0.0, 0.0, 0.0], (rows, 1))
    truth[100:120] = np.nan
    scipy.io.savemat(
        path,
        {
            "imu_gyr": 0.1 * rng.standard_normal((rows, 3)),
            "imu_acc": np.array([0, 0, 9.81]) + 0.1 * rng.standard_normal((rows, 3)),
            "imu_mag": np.array([0, 20, -40]) + rng.standard_normal((rows, 3)),
            "opt_quat": truth,
            "movement": np.ones((rows, 1)),
            "sampling_rate": 2000 / 7,
        },
    )
