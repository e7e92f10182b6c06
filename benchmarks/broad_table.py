"""Score attitude filters on trials of BROAD, through import, recording and graph.

    LODEFLOW_DATA=FOLDER python benchmarks/broad_table.py [--swap PLUGIN] [--set N.P=V] [--json]

FOLDER/broad holds trials (.mat). Each is imported into a recording and run through
graphs/broad.yaml, once as the graph is ("free") and once with the accelerometer gate at 0.5 m/s^2
("gated"); with --swap, once with that fuser. Figures are total/heading/inclination RMSE in
degrees over the samples in motion (Laidig et al. 2021, Data 6(7):72).
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

from lodeflow.graph import load_graph
from lodeflow.supervisor.run import run

GRAPH = Path(__file__).parents[1] / "graphs" / "broad.yaml"
Errors = tuple[float, float, float]


def imported(trial: Path, folder: Path) -> Path:
    """Turn a trial into a recording, as on the command line."""
    recording = folder / f"{trial.stem}.mcap"
    command = ["import", "broad", str(trial), str(recording)]
    subprocess.run(
        [sys.executable, "-m", "lodeflow.cli", *command], check=True, stdout=subprocess.DEVNULL
    )
    return recording


def score(recording: Path, sets: list[str], swaps: list[str]) -> Errors:
    """Total, heading and inclination RMSE in degrees."""
    graph = load_graph(GRAPH, args=[f"recording={recording}"], sets=sets, swaps=swaps)
    summary = run(graph)
    if summary.exit_code:
        raise SystemExit(f"{recording.name}: {summary.error or 'lost samples'}")
    found = summary.scores["score"]
    rmse = np.degrees([found.total_rmse, found.heading_rmse, found.inclination_rmse])
    total, heading, inclination = rmse.tolist()
    return total, heading, inclination


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--swap", metavar="PLUGIN", help="another fuser that takes imu and mag")
    parser.add_argument("--set", dest="sets", action="append", default=[], metavar="NODE.PARAM=V")
    parser.add_argument("--json", action="store_true")
    args = parser.parse_args()
    if "LODEFLOW_DATA" not in os.environ:
        parser.error("LODEFLOW_DATA does not name a folder with broad/")
    trials = sorted(Path(os.environ["LODEFLOW_DATA"], "broad").glob("*.mat"))
    if not trials:
        parser.error(f"no trials in {os.environ['LODEFLOW_DATA']}/broad")
    swaps = [f"fuser={args.swap}"] if args.swap else []
    variants = {"free": args.sets, "gated": [*args.sets, "fuser.gate=0.5"]}
    if args.swap:
        variants = {args.swap: args.sets}

    table: dict[str, dict[str, Errors]] = {}
    with tempfile.TemporaryDirectory() as folder:
        for trial in trials:
            recording = imported(trial, Path(folder))
            table[trial.stem] = {
                name: score(recording, sets, swaps) for name, sets in variants.items()
            }
    columns = {name: [row[name] for row in table.values()] for name in variants}
    means = {name: tuple(np.mean(rows, axis=0).tolist()) for name, rows in columns.items()}
    if args.json:
        print(json.dumps({"unit": "degrees", "trials": table, "mean": means}, indent=2))
        return
    print(f"| trial | {' | '.join(variants)} |")
    print(f"|---|{'---|' * len(variants)}")
    for name, row in {**table, "**mean**": means}.items():
        print(f"| {name} | {' | '.join('/'.join(f'{x:.2f}' for x in v) for v in row.values())} |")


if __name__ == "__main__":
    main()
