"""Draw docs/figures/pedestrian.png from a walk and a run of the folder that LODEFLOW_DATA names.

    LODEFLOW_DATA=... python docs/figures/pedestrian.py

Runs graphs/pedestrian.yaml on both and reads its recordings: how much the foot moves, with the
steps that were counted, and the tracks against the optical position.
"""

from __future__ import annotations

import os
import tempfile
from pathlib import Path

import matplotlib as mpl
import numpy as np

import lodeflow as lf
from lodeflow.graph import load_graph
from lodeflow.recording.reader import Recording
from lodeflow.supervisor.run import run
from lodeflow_plugins.scoring.track_score.alignment import align

mpl.use("Agg")
import matplotlib.pyplot as plt

HERE = Path(__file__).parent
GRAPH = HERE.parents[1] / "graphs" / "pedestrian.yaml"
TRIALS = {"walking": "2017-11-22-11-35-59", "running": "2017-11-27-11-13-10"}
STREAMS = {
    "imu": lf.Imu,
    "geographic": lf.Acceleration,
    "steps": lf.Step,
    "walk/position": lf.PositionTruth,
    "step_track": lf.Position,
    "stance_track": lf.Position,
}


def streams_of(trial: str) -> dict[str, lf.Message]:
    """Run the graph on a trial and read what it recorded."""
    file = Path(os.environ["LODEFLOW_DATA"]) / "steps" / f"{trial}.npz"
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "pedestrian.mcap"
        run(load_graph(GRAPH, args=[f"file={file}"]), record=str(path))
        with Recording(path) as recording:
            return {
                name: kind.concat(list(recording.stream(f"/{name}", kind)))
                for name, kind in STREAMS.items()
            }


def main() -> None:
    """Run, read, draw."""
    figure, axes = plt.subplots(
        2, 2, figsize=(9, 6.5), layout="constrained", gridspec_kw={"width_ratios": [2, 1]}
    )
    for (gait, trial), (left, right) in zip(TRIALS.items(), axes, strict=True):
        found = streams_of(trial)
        imu, steps = found["imu"], found["steps"]
        seconds = imu.t * 1e-9
        parts = {
            "acceleration, m/s²": np.linalg.norm(found["geographic"].acceleration, axis=1),
            "angular rate times 2.5 m": 2.5 * np.linalg.norm(imu.angular_velocity, axis=1),
        }
        for (name, part), color in zip(parts.items(), ("C0", "C1"), strict=True):
            left.semilogy(seconds, part, color=color, lw=0.8, label=name)
        left.axhline(2.5, color="C0", ls=":", lw=1, label="paper's threshold")
        first = steps.moment[0] * 1e-9
        shown = (first - 2.0, first + 9.0)
        inside = steps.moment[steps.moment * 1e-9 < shown[1]] * 1e-9
        left.plot(inside, np.full(len(inside), 120.0), "kv", ms=5, label="steps of swing_steps")
        left.set(xlim=shown, ylim=(0.05, 200), xlabel="time, s", title=gait)
        left.grid(alpha=0.3)
        if gait == "walking":
            left.legend(loc="lower right", fontsize=8)

        truth = found["walk/position"]
        right.plot(*truth.position[:, :2].T, color="0.6", lw=3, label="optical")
        for name, color in (("step_track", "C1"), ("stance_track", "C0")):
            track = found[name]
            at = np.searchsorted(truth.t, track.t)
            right.plot(
                *align(track.position[:, :2], truth.position[at, :2]).T,
                color=color,
                lw=1,
                marker=".",
                ms=3,
                label=name,
            )
        right.set(aspect="equal", xlabel="m")
        right.grid(alpha=0.3)
        if gait == "walking":
            right.legend(loc="lower right", fontsize=8)
    figure.savefig(HERE / "pedestrian.png", dpi=110, metadata={"Software": None})


if __name__ == "__main__":
    main()
