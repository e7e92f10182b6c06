"""Links between processes: lodeflow beside raw zenoh, dora-rs, pyzmq and iceoryx2.

    python benchmarks/transport [--rounds 5] [--only latency] [--peers zenoh,lodeflow] [--json]

In each round every peer is measured once, in turn, so that what else the machine does meets all
alike. Shown are medians over the rounds, and the median of the ratios to raw zenoh (unix socket,
FifoChannel) of the same round. lodeflow's side is `lodeflow run` on graphs of plugins.
"""

from __future__ import annotations

import argparse
import json
import statistics
import sys
from typing import Any, NamedTuple

import launch as launching
from launch import PEERS, launch
from task import Task


class Measure(NamedTuple):
    """One line of the table: what is run, and what is read from it."""

    group: str
    name: str
    task: Task
    figure: str
    unit: str
    graph: str = "packets"
    peers: tuple[str, ...] = PEERS


IMU, PACKET = 324, 64
FLOW = 50_000
ROWS = 100


def _measures() -> list[Measure]:
    found = []
    for size, name, hz, count in (
        (64, "64 B", 250, 400),
        (100_000, "100 KB", 250, 400),
        (4_000_000, "4 MB", 20, 40),
    ):
        task = Task(size, count, hz)
        found += [
            Measure("latency", f"{name}, {figure}", task, figure, "us") for figure in ("p50", "p99")
        ]
    device = Task(64, 500, 250)
    found.append(
        Measure("device", "64 B, p50", device, "p50", "us", "device", ("zenoh", "lodeflow"))
    )
    found.append(Measure("messages", f"{IMU} B", Task(IMU, FLOW), "rate", "1/s", "imu samples"))
    for size, name, graph in ((PACKET, "64 B records", "blocks"), (IMU, "Imu", "imu")):
        task = Task(size * ROWS, 3_000_000, rows=ROWS)
        found.append(Measure("blocks", f"{name}, blocks of {ROWS}", task, "rate", "1/s", graph))
    chain = Task(64, 5000, 1000, relays=4)
    for figure, unit in (("p50", "us"), ("p99", "us"), ("cpu", "us")):
        found.append(Measure("chain", f"6 processes at 1 kHz, {figure}", chain, figure, unit))
    for numba in (False, True):
        name = "nodes with numba" if numba else "nodes with numpy"
        task = Task(64, 10, 100, numba=numba)
        found.append(Measure("start", f"{name}, first message", task, "start_ms", "ms"))
    return found


def _run(peer: str, measure: Measure, cpu: bool) -> dict[str, Any]:
    found = launch(peer, measure.task, graph=measure.graph, cpu=cpu)
    found["rate"] = measure.task.count / max(found["seconds"], 1e-9)
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--only", default="latency,device,messages,blocks,chain,start")
    parser.add_argument("--peers", default=",".join(PEERS))
    parser.add_argument("--limit", type=float, default=60.0, help="seconds for one of them")
    parser.add_argument("--json", action="store_true")
    given = parser.parse_args()
    launching.LIMIT = given.limit
    groups, peers = given.only.split(","), given.peers.split(",")
    measures = [measure for measure in _measures() if measure.group in groups]
    runs = list(dict.fromkeys((m.group, m.task, m.graph, m.peers) for m in measures))
    seen: dict[tuple[Any, str], list[dict[str, Any] | None]] = {}
    for number in range(given.rounds):
        for run in runs:
            group, task, _, able = run
            measure = next(m for m in measures if (m.group, m.task, m.graph, m.peers) == run)
            order = [peer for peer in PEERS if peer in peers and peer in able]
            turn = number % max(len(order), 1)
            for peer in order[turn:] + order[:turn]:
                try:
                    found = _run(peer, measure, group == "chain")
                except RuntimeError as error:
                    print(f"{peer}, {group}: {error}", file=sys.stderr)
                    found = None
                seen.setdefault((run, peer), []).append(found)
            print(f"round {number + 1}: {group}, {task.size} B", file=sys.stderr)
    table = []
    for measure in measures:
        run = (measure.group, measure.task, measure.graph, measure.peers)
        row: dict[str, Any] = {"group": measure.group, "name": measure.name, "unit": measure.unit}
        base = seen.get((run, "zenoh"), [])
        for peer in peers:
            got = seen.get((run, peer), [])
            values = [one[measure.figure] for one in got if one]
            if not values:
                continue
            ratios = [
                one[measure.figure] / raw[measure.figure]
                for one, raw in zip(got, base, strict=False)
                if one and raw
            ]
            row[peer] = {
                "median": statistics.median(values),
                "ratio": statistics.median(ratios) if ratios else None,
                "rounds": values,
                "missing": max(one["missing"] for one in got if one),
            }
        table.append(row)
    if given.json:
        print(json.dumps({"rounds": given.rounds, "table": table}))
        return
    print(f"{'':<44}" + "".join(f"{peer:>24}" for peer in peers))
    for row in table:
        line = f"{row['group']:<9}{row['name'] + ' [' + row['unit'] + ']':<35}"
        for peer in peers:
            cell = row.get(peer)
            if cell is None:
                line += f"{'-':>24}"
                continue
            ratio = "" if cell["ratio"] is None else f" ({cell['ratio']:.2f})"
            lost = f" !{cell['missing']}" if cell["missing"] else ""
            line += f"{cell['median']:,.0f}{ratio}{lost}".rjust(24)
        print(line)


if __name__ == "__main__":
    main()
