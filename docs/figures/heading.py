"""Draw docs/figures/heading.png from a run of graphs/heading.yaml.

    python docs/figures/heading.py

Runs the graph, reads its recording, and draws the heading error of the compass and of the filter.
"""

from __future__ import annotations

import tempfile
from pathlib import Path

import matplotlib as mpl
import numpy as np

import lodeflow as lf
from lodeflow.graph import load_graph
from lodeflow.recording.reader import Recording
from lodeflow.supervisor.run import run

mpl.use("Agg")
import matplotlib.pyplot as plt

HERE = Path(__file__).parent
GRAPH = HERE.parents[1] / "graphs" / "heading.yaml"


def main() -> None:
    """Run, read, draw."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "heading.mcap"
        run(load_graph(GRAPH), record=str(path))
        with Recording(path) as recording:
            true, compass = [
                lf.EulerAngles.concat(list(recording.stream(topic, lf.EulerAngles)))
                for topic in ("/vehicle/euler", "/compass/euler")
            ]
            estimate = lf.Heading.concat(list(recording.stream("/heading", lf.Heading)))

    seconds = true.t * 1e-9
    errors = [
        np.degrees((measured.heading - true.heading + np.pi) % (2.0 * np.pi) - np.pi)
        for measured in (compass, estimate)
    ]
    figure, axes = plt.subplots(3, 1, figsize=(8, 6.5), sharex=True, layout="constrained")
    axes[0].plot(seconds, np.degrees(true.heading), color="black", lw=1)
    axes[0].set_ylabel("heading, °")
    axes[0].set_yticks([0, 90, 180, 270, 360])
    names = ("tilt-compensated compass alone", "Kalman filter")
    for axis, error, name, color in zip(axes[1:], errors, names, ("C1", "C0"), strict=True):
        axis.plot(seconds, error, color=color, lw=0.6)
        rms, worst = np.sqrt(np.mean(error**2)), np.abs(error).max()
        axis.set_title(f"{name}: rms {rms:.2f}°, largest {worst:.2f}°", fontsize=10)
        axis.set_ylabel("error, °")
    axes[2].set_ylim(-0.25, 0.25)
    for axis in axes:
        axis.grid(alpha=0.3)
    axes[2].set_xlabel("time, s")
    figure.savefig(HERE / "heading.png", dpi=110, metadata={"Software": None})


if __name__ == "__main__":
    main()
