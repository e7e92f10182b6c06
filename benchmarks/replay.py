"""Replay recordings at full speed, MCAP to MCAP, and see how time and memory grow.

    python benchmarks/replay.py [--rounds 3] [--hours 24] [--json]

"heading": one hour at 100 Hz of graphs/heading.yaml, all its sixteen streams recorded, replayed by
`lodeflow replay`: the seven streams of the vehicle are read, the nine nodes computed anew, and all
sixteen streams recorded again ("recorded"), or nothing ("not recorded").

"length": the same graph over 1 minute to --hours of recorded sensors (the four streams that it
reads); what it computes is recorded. "nodes": ten minutes of the gyroscope through 1 to 64
calibrators, all recorded. Time should grow in proportion, and memory with the nodes alone.

Every replay is the real command in a process of its own. "real time" is event time per wall time
of the run, as the command says it; CPU time and peak memory are those of the whole process with
its start (imports, compiled filters from their cache), which takes one to two seconds. The cases
take turns; the best round counts.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

HEADING = Path(__file__).parents[1] / "graphs" / "heading.yaml"
SENSORS = "record: {streams: [vehicle.raw_mag, vehicle.raw_force, vehicle.raw_rate, vehicle.truth]}"
GYROSCOPE = (
    "lodeflow: 1\nname: gyroscopes\nnodes:\n  vehicle: {use: simulated_vehicle, params: %s}\n"
)
CALIBRATOR = """\
  cal_%d:
    use: gyro_calibrator
    inputs: {raw: vehicle.raw_rate}
    params:
      unit: 1 deg/s
      k:
        - [-0.1243681, -0.0012937, -0.0033316]
        - [0.0003576, 0.1237108, 0.0009321]
        - [0.0003312, -0.0001178, -0.1243840]
        - [-2.3843363, 2.3942377, -2.1203979]
      body_axes: frd
"""


def lodeflow(*arguments: object) -> dict[str, float]:
    """Run the command, and return the times and the peak memory that it took."""
    command = [sys.executable, "-m", "lodeflow.cli", *map(str, arguments), "--json"]
    with tempfile.TemporaryFile("w+") as out:
        process = subprocess.Popen(command, stdout=out, stderr=subprocess.DEVNULL)
        _, status, usage = os.wait4(process.pid, 0)
        if os.waitstatus_to_exitcode(status):
            sys.exit(f"{' '.join(command)} failed")
        out.seek(0)
        said = json.load(out)
    return {
        "seconds": said["event_seconds"],
        "wall": said["wall_seconds"],
        "cpu": usage.ru_utime + usage.ru_stime,
        "mb": usage.ru_maxrss / (1 << 20 if sys.platform == "darwin" else 1 << 10),
    }


class Bench:
    """Makes recordings in a folder, and replays them."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.sensors = folder / "sensors.yaml"
        self.sensors.write_text(SENSORS)

    def recorded(self, duration: int, *options: object) -> Path:
        path = self.folder / f"{duration}-{len(options)}.mcap"
        duration_arg = f"duration={duration}"
        lodeflow("run", HEADING, "--arg", duration_arg, "--record", path, *options)
        return path

    def gyroscopes(self, count: int, duration: int) -> Path:
        path = self.folder / f"{count}.yaml"
        nodes = "".join(CALIBRATOR % number for number in range(count))
        path.write_text(GYROSCOPE % f"{{duration: {duration}}}" + nodes)
        return path

    def replay(self, *arguments: object, record: bool = True) -> dict[str, float]:
        out = self.folder / "out.mcap"
        try:
            return lodeflow(
                "replay", *arguments, *(["--record", out] if record else ["--no-record"])
            )
        finally:
            out.unlink(missing_ok=True)


def best(found: list[dict[str, float]]) -> dict[str, float]:
    return {key: min(row[key] for row in found) for key in found[0]}


def measure(rounds: int, hours: float) -> dict[str, Any]:
    lengths = [s for s in (60, 600, 3600, 6 * 3600, 24 * 3600) if s < hours * 3600]
    lengths.append(round(hours * 3600))
    counts = (1, 2, 4, 8, 16, 32, 64)
    with tempfile.TemporaryDirectory() as folder:
        bench = Bench(Path(folder))
        hour, ten = bench.recorded(3600), bench.recorded(600, "--with", bench.sensors)
        heading: dict[str, list[dict[str, float]]] = {"recorded": [], "not recorded": []}
        nodes: dict[int, list[dict[str, float]]] = {count: [] for count in counts}
        length: dict[int, list[dict[str, float]]] = {seconds: [] for seconds in lengths}
        for _ in range(rounds):
            for name, found in heading.items():
                found.append(bench.replay(hour, record=name == "recorded"))
            for count in counts:
                nodes[count].append(bench.replay(ten, bench.gyroscopes(count, 600)))
        hour.unlink()
        ten.unlink()
        for seconds in lengths:
            path = bench.recorded(seconds, "--with", bench.sensors)
            for _ in range(rounds if seconds <= 3600 else 1):
                length[seconds].append(bench.replay(path))
            path.unlink()
    return {
        "heading": {name: best(found) for name, found in heading.items()},
        "length": {seconds: best(found) for seconds, found in length.items()},
        "nodes": {count: best(found) for count, found in nodes.items()},
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--hours", type=float, default=24.0, help="longest recording")
    parser.add_argument("--json", action="store_true", help="one JSON object instead of a table")
    options = parser.parse_args()
    found = measure(options.rounds, options.hours)
    if options.json:
        json.dump({**vars(options), **found}, sys.stdout)
        print()
        return
    print(
        f"{'one hour of the heading graph':<32}{'real time':>10}{'wall s':>9}{'CPU s':>9}{'MB':>7}"
    )
    for name, row in found["heading"].items():
        speed = row["seconds"] / row["wall"]
        print(f"{name:<32}{speed:>10.0f}{row['wall']:>9.2f}{row['cpu']:>9.2f}{row['mb']:>7.0f}")
    for what, unit in (("length", "s of data"), ("nodes", "nodes")):
        print(f"\n{'growth with ' + what:<32}{'real time':>10}{'wall s':>9}{'CPU s':>9}{'MB':>7}")
        for size, row in found[what].items():
            speed = row["seconds"] / row["wall"]
            print(
                f"{size:>9} {unit:<22}{speed:>10.0f}{row['wall']:>9.2f}{row['cpu']:>9.2f}"
                f"{row['mb']:>7.0f}"
            )


if __name__ == "__main__":
    main()
