"""Draw docs/figures/interference.png: three headings of one recording.

    python docs/figures/interference.py

Records a drive of graphs/dmc.yaml, replays it with other stages, and draws the heading errors.
"""

from __future__ import annotations

import tempfile
from pathlib import Path

import matplotlib as mpl
import numpy as np

import lodeflow as lf
from lodeflow.graph import load_graph
from lodeflow.recording.reader import Recording
from lodeflow.recording.replay import replaying
from lodeflow.supervisor.run import run

mpl.use("Agg")
import matplotlib.pyplot as plt

HERE = Path(__file__).parent
GRAPH = HERE.parents[1] / "graphs" / "dmc.yaml"
DRIVE = ["scenario=mixed", "seed=5003"]
SWAPS = {
    "thresholds, then the gyro": (
        ["heading=integrated_heading"],
        ["mode.inputs.credibility=stage1"],
    ),
    "thresholds and clusters, then the gyro": (["heading=integrated_heading"], []),
    "heading_estimator": ([], []),
}


def main() -> None:
    """Record, replay, draw."""
    figure, (above, below) = plt.subplots(2, 1, sharex=True, figsize=(8, 5), layout="constrained")
    with tempfile.TemporaryDirectory() as folder:
        drive = Path(folder) / "drive.mcap"
        run(load_graph(GRAPH, args=DRIVE), record=str(drive))
        true = _stream(drive, "/vehicle/truth", lf.Heading)
        compass = _stream(drive, "/features", lf.CompassFeatures)
        seconds = true.t * 1e-9
        above.plot(seconds, _error(compass.heading, true.heading), lw=0.6, color="0.6",
                   label="both compasses")  # fmt: skip
        for at, (label, (swaps, sets)) in enumerate(SWAPS.items()):
            again = Path(folder) / f"{at}.mcap"
            graph = load_graph(GRAPH, args=DRIVE, swaps=swaps, sets=sets)
            with Recording(drive) as recording:
                replay = replaying(graph, recording, start=("mode", "heading"))
            run(replay.graph, record=str(again))
            heading = _stream(again, "/heading/heading", lf.Heading)
            below.plot(seconds, _error(heading.heading, true.heading), lw=0.9, label=label)
    above.set_ylabel("heading error, deg")
    below.set_ylabel("heading error, deg")
    below.set_xlabel("time, s")
    for axes in (above, below):
        axes.grid(alpha=0.3)
        axes.legend(loc="upper left", fontsize=8)
    figure.savefig(HERE / "interference.png", dpi=110, metadata={"Software": None})


def _stream(path: Path, topic: str, kind: type[lf.Message]) -> lf.Message:
    with Recording(path) as recording:
        return kind.concat(list(recording.stream(topic, kind)))


def _error(heading: np.ndarray, truth: np.ndarray) -> np.ndarray:
    return np.degrees((heading - truth + np.pi) % (2 * np.pi) - np.pi)


if __name__ == "__main__":
    main()
