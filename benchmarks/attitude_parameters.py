"""What the parameters of heading_kalman do on trials of BROAD, and what choosing them is worth.

    LODEFLOW_DATA=FOLDER python benchmarks/attitude_parameters.py [--json]

FOLDER/broad holds trials (.mat). Figures are total RMSE in degrees over the samples in motion.
Three tables: the defaults with a part of the filter taken out; each of four parameters halved and
doubled; and all 81 combinations of these, of which one is chosen on all trials but one and judged
on the one that was left out, in turns. The last is what a choice of parameters is worth on a trial
that had no say in it.
"""

from __future__ import annotations

import argparse
import itertools
import json
import os
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

import lodeflow as lf
from lodeflow.clock import SimClock
from lodeflow.testing import run_node
from lodeflow_plugins.fusion.heading_kalman import filter as heading
from lodeflow_plugins.fusion.heading_kalman.node import HeadingKalman
from lodeflow_plugins.fusion.inertial_attitude.node import InertialAttitude
from lodeflow_plugins.scoring.attitude_score import metric
from lodeflow_plugins.sources.broad import BroadTrial

NEVER = 1e6
WITHOUT: dict[str, dict[str, Any]] = {
    "the defaults": {},
    "without the search for a magnet": {"magnet_time": NEVER},
    "without opening at a surprise": {"surprise": NEVER},
    "without the lag": {"lag": 0.0},
    "without the drift": {"drift": 0.0, "heading_walk": "0.6 deg/sqrt(s)"},
    "a step for each field": {"update_interval": 0.0},
}
CHOSEN = ("drift", "disturbance", "disturbance_time", "level_time")
FACTORS = (0.5, 1.0, 2.0)


class Trial(NamedTuple):
    """Attitudes without heading, fields at the same stamps, truth."""

    attitude: lf.Attitude
    mag: lf.MagneticField
    truth: lf.AttitudeTruth


def load(file: Path) -> Trial:
    source = BroadTrial(BroadTrial.Params(file=str(file)))
    imus, mags, truths = zip(*source.read(SimClock()), strict=True)
    attitude = run_node(InertialAttitude, imu=lf.Imu.concat(imus))["attitude"]
    return Trial(attitude, lf.MagneticField.concat(mags), lf.AttitudeTruth.concat(truths))


def total(trial: Trial, given: dict[str, Any]) -> float:
    """Total RMSE in degrees with some parameters."""
    constants = HeadingKalman.Params(report_interval=NEVER, **given).constants()
    attitude, mag, truth = trial
    n = len(attitude)
    rows = np.arange(n)
    out, believed, reports = np.empty((n, 4)), np.empty((n, 11)), np.empty(n, np.int64)
    heading.run(
        attitude.t,
        attitude.quaternion,
        rows,
        mag.magnetic_field,
        rows,
        heading.new_state(constants),
        out,
        believed,
        reports,
    )
    state = metric.new_state()
    metric.accumulate(out, truth.quaternion, truth.moving, state)
    return float(np.degrees(metric.score(state).total_rmse))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--json", action="store_true")
    args = parser.parse_args()
    if "LODEFLOW_DATA" not in os.environ:
        parser.error("LODEFLOW_DATA does not name a folder with broad/")
    files = sorted(Path(os.environ["LODEFLOW_DATA"], "broad").glob("*.mat"))
    if len(files) < 2:
        parser.error(f"fewer than two trials in {os.environ['LODEFLOW_DATA']}/broad")
    trials = {file.stem[:2]: load(file) for file in files}

    def row(given: dict[str, Any]) -> list[float]:
        return [total(trial, given) for trial in trials.values()]

    usual = HeadingKalman.Params()
    points = list(itertools.product(FACTORS, repeat=len(CHOSEN)))
    figures = np.array(
        [
            row({p: f * getattr(usual, p) for p, f in zip(CHOSEN, point, strict=True)})
            for point in points
        ]
    )
    alone = {
        f"{name} x {factor:g}": figures[
            points.index(tuple(factor if p == name else 1.0 for p in CHOSEN))
        ].tolist()
        for name in CHOSEN
        for factor in (0.5, 2.0)
    }
    others = [np.delete(figures, k, axis=1).mean(axis=1).argmin() for k in range(len(trials))]
    means = figures.mean(axis=1)
    tables = {
        "without a part": {name: row(given) for name, given in WITHOUT.items()},
        "one parameter": alone,
        f"{len(points)} combinations": {
            "best of all": figures[means.argmin()].tolist(),
            "worst of all": figures[means.argmax()].tolist(),
            "chosen on the other trials": [float(figures[n, k]) for k, n in enumerate(others)],
        },
    }
    if args.json:
        print(json.dumps({"unit": "degrees", "trials": list(trials), **tables}, indent=2))
        return
    for title, table in tables.items():
        print(f"\n| {title} | {' | '.join(trials)} | mean | median |")
        print(f"|---{'|---:' * (len(trials) + 2)}|")
        for name, found in table.items():
            shown = [*found, np.mean(found), np.median(found)]
            print(f"| {name} | {' | '.join(f'{x:.2f}' for x in shown)} |")


if __name__ == "__main__":
    main()
