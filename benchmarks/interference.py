"""Time the whole graph of two compasses and a gyro on an hour at 100 Hz, from a recording.

    python benchmarks/interference.py [--hours 1] [--rounds 3] [--json]

Recorded once is what the sensors send; each round replays the recording through calibration,
features, both stages, the mode and the heading, and does not record. Times real time, the median
round, by the clock on the wall and by that of the processor, which other work on the machine
disturbs less. Reading and decoding the recording are in it.
"""

from __future__ import annotations

import argparse
import json
import statistics
import tempfile
import time
from pathlib import Path

from lodeflow.graph import load_graph
from lodeflow.supervisor.run import run

GRAPH = Path(__file__).parents[1] / "graphs" / "dmc.yaml"
STAGES = ("first", "second", "features", "stage1", "stage2", "mode", "heading")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--hours", type=float, default=1.0)
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args()
    seconds = options.hours * 3600
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "hour.mcap"
        args = [f"duration={seconds}", "rate=100", "scenario=mixed"]
        run(load_graph(GRAPH, args=args), record=str(file))
        results = {}
        for heading in ("heading_estimator", "integrated_heading"):
            graph = _from_recording(file, heading)
            wall, processor = [], []
            for _ in range(options.rounds + 1):
                begin, used = time.perf_counter(), time.process_time()
                summary = run(graph, record="")
                wall.append(time.perf_counter() - begin)
                processor.append(time.process_time() - used)
                if summary.exit_code:
                    raise SystemExit(str(summary.error))
            results[heading] = {
                "wall": seconds / statistics.median(wall[1:]),
                "processor": seconds / statistics.median(processor[1:]),
            }
    if options.json:
        print(json.dumps(results))
    else:
        for heading, speed in results.items():
            print(
                f"{heading:20s} {speed['wall']:7.0f} times real time, "
                f"{speed['processor']:7.0f} by processor time"
            )


def _from_recording(file: Path, heading: str):
    """The stages of the graph, fed by the recorded streams of the vehicle."""
    from lodeflow.recording.reader import Recording
    from lodeflow.recording.replay import replaying

    graph = load_graph(GRAPH, swaps=[f"heading={heading}"])
    with Recording(file) as recording:
        return replaying(graph, recording, start=STAGES, complete=False).graph


if __name__ == "__main__":
    main()
