"""What the online hard-iron estimator is worth on trials of BROAD.

    LODEFLOW_DATA=FOLDER python benchmarks/online_mag.py [--iron X Y Z] [--set mag_cal.P=V] [--json]

Each trial in FOLDER/broad is run through graphs/broad.yaml, as it is and with the overlay
graphs/overlays/broad_online_mag.yaml, behind the Chu filter and behind VQF. --iron adds a hard
iron, in microtesla. Figures are total RMSE in degrees over the samples in motion (Laidig et al.
2021).
"""

from __future__ import annotations

import argparse
import json
import os
import tempfile
from pathlib import Path

import numpy as np
from broad_table import GRAPH, imported

from lodeflow.graph import load_graph
from lodeflow.supervisor.run import run

OVERLAY = GRAPH.parent / "overlays" / "broad_online_mag.yaml"
IRON = """\
nodes:
  iron: {{use: iron_calibrator, inputs: {{mag: sensors.mag}}, params: {{hard_iron: {iron}}}}}
  {reader}: {{inputs: {{mag: iron}}}}
"""


def total(recording: Path, overlays: list[Path], swaps: list[str], sets: list[str]) -> float:
    """Total RMSE in degrees."""
    graph = load_graph(
        GRAPH, args=[f"recording={recording}"], overlays=overlays, swaps=swaps, sets=sets
    )
    summary = run(graph, record="")
    if summary.exit_code:
        raise SystemExit(f"{recording.name}: {summary.error or 'lost samples'}")
    return float(np.degrees(summary.scores["score"].total_rmse))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--iron", nargs=3, type=float, default=[0, 0, 0], metavar="uT")
    parser.add_argument("--set", dest="sets", action="append", default=[], metavar="mag_cal.P=V")
    parser.add_argument("--json", action="store_true")
    args = parser.parse_args()
    if "LODEFLOW_DATA" not in os.environ:
        parser.error("LODEFLOW_DATA does not name a folder with broad/")
    trials = sorted(Path(os.environ["LODEFLOW_DATA"], "broad").glob("*.mat"))
    iron = [-1e-6 * x for x in args.iron]
    table: dict[str, dict[str, float]] = {}
    with tempfile.TemporaryDirectory() as folder:
        for trial in trials:
            recording = imported(trial, Path(folder))
            row = table[trial.stem] = {}
            for fuser, swaps in (("chu", []), ("vqf", ["fuser=vqf"])):
                for name, overlays, sets in (("", [], []), (" online", [OVERLAY], args.sets)):
                    added = Path(folder) / "iron.yaml"
                    reader = "mag_cal" if overlays else "fuser"
                    added.write_text(IRON.format(iron=iron, reader=reader))
                    row[fuser + name] = total(recording, [*overlays, added], swaps, sets)
    mean = {name: float(np.mean([row[name] for row in table.values()])) for name in row}
    if args.json:
        print(json.dumps({"unit": "degrees", "trials": table, "mean": mean}, indent=2))
        return
    print(f"| trial | {' | '.join(mean)} |")
    print(f"|---|{'---|' * len(mean)}")
    for name, figures in {**table, "**mean**": mean}.items():
        print(f"| {name} | {' | '.join(f'{x:.2f}' for x in figures.values())} |")


if __name__ == "__main__":
    main()
