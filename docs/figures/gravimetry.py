"""Draw docs/figures/gravimetry.png from a survey line of the folder that LODEFLOW_DATA names.

    LODEFLOW_DATA=... python docs/figures/gravimetry.py

Runs graphs/gravimetry.yaml, and once more with the inputs hardly filtered, and reads its
recordings.
"""

from __future__ import annotations

import os
import tempfile
from pathlib import Path

import matplotlib as mpl

import lodeflow as lf
from lodeflow.graph import load_graph
from lodeflow.recording.reader import Recording
from lodeflow.supervisor.run import run

mpl.use("Agg")
import matplotlib.pyplot as plt

HERE = Path(__file__).parent
GRAPH = HERE.parents[1] / "graphs" / "gravimetry.yaml"
MGAL = 1e-5


def corrections_of(period: int) -> dict[str, lf.GravityCorrection]:
    """Run the graph on a line and read the low-passed corrections."""
    file = Path(os.environ["LODEFLOW_DATA"]) / "gravity" / "EastVicTest_8001.04.npz"
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "gravimetry.mcap"
        run(load_graph(GRAPH, args=[f"file={file}", f"period={period}"]), record=str(path))
        with Recording(path) as recording:
            return {
                name: lf.GravityCorrection.concat(
                    list(recording.stream(f"/{name}", lf.GravityCorrection))
                )
                for name in ("classical", "modified", "exact")
            }


def main() -> None:
    """Run, read, draw."""
    figure, (above, below) = plt.subplots(2, 1, figsize=(8, 5.5), layout="constrained")
    found = corrections_of(60)
    for name, style in (("classical", "C1-"), ("modified", "C0-"), ("exact", "k:")):
        stream = found[name]
        above.plot(stream.t * 1e-9, stream.correction / MGAL, style, lw=1.2, label=name)
    above.set_title("filtered over 60 s before squaring", fontsize=10)
    above.legend()
    for period, color in ((5, "C3"), (10, "C2"), (20, "C4"), (60, "C0")):
        stream = found["modified"] if period == 60 else corrections_of(period)["modified"]
        below.plot(stream.t * 1e-9, stream.correction / MGAL, color, lw=1, label=f"{period} s")
    below.set_yscale("symlog", linthresh=1)
    below.set_title("modified, by the filter before squaring", fontsize=10)
    below.legend()
    for axis in (above, below):
        axis.set_ylabel("tilt correction, mGal")
        axis.grid(alpha=0.3)
    below.set_xlabel("time, s")
    figure.savefig(HERE / "gravimetry.png", dpi=110, metadata={"Software": None})


if __name__ == "__main__":
    main()
