"""Draw docs/figures/calibration.png: a magnetometer and a level compass before and after.

    python docs/figures/calibration.py

Records the tumble of graphs/calibration/tumble.yaml and an undisturbed drive of graphs/dmc.yaml,
and calibrates from the recordings as `lodeflow calibrate mag` and `lodeflow calibrate ellipse` do.
"""

from __future__ import annotations

import tempfile
from pathlib import Path

import matplotlib as mpl

from lodeflow.graph import load_graph
from lodeflow.supervisor.calibrate import calibrate
from lodeflow.supervisor.run import run

mpl.use("Agg")
import matplotlib.pyplot as plt

HERE = Path(__file__).parent
GRAPHS = HERE.parents[1] / "graphs"


def main() -> None:
    """Record, calibrate, draw."""
    figure = plt.figure(figsize=(9, 9), layout="constrained")
    above, below = figure.subfigures(2, 1, height_ratios=(1.3, 1))
    with tempfile.TemporaryDirectory() as folder:
        tumble, turn = Path(folder) / "tumble.mcap", Path(folder) / "turn.mcap"
        run(load_graph(GRAPHS / "calibration" / "tumble.yaml"), record=str(tumble))
        run(load_graph(GRAPHS / "dmc.yaml", args=["scenario=none"]), record=str(turn))
        calibrate("mag", [tumble]).found.draw(above)
        calibrate("ellipse", [turn], streams=["mag=vehicle.first"]).found.draw(below)
    above.suptitle("lodeflow calibrate mag: ellipsoid of a tumble, aligned to gravity", fontsize=11)
    below.suptitle("lodeflow calibrate ellipse: a level compass", fontsize=11)
    figure.savefig(HERE / "calibration.png", dpi=100, metadata={"Software": None})


if __name__ == "__main__":
    main()
