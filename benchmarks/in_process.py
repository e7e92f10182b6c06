"""What the framework adds to a hop inside one process, beside plain calls of the same steps.

    python benchmarks/in_process.py [--json]

A chain of six nodes (each sends a fresh message) and a chain of six two-input joins, driven by
single samples and by blocks of 1000; and the six-node chain paced at 1 kHz, from the source's
sample to the last node's, beside the same plain calls paced alike.
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import numpy as np

import lodeflow as lf
from lodeflow.graph.model import Graph, GraphNode, Wire
from lodeflow.runtime.blocks import BlockDriver
from lodeflow.runtime.plan import Plan
from lodeflow.runtime.samples import SampleDriver

HOPS = 6
ROWS = 1000


class Two(NamedTuple):
    a: lf.AngularRate | None
    b: lf.AngularRate | None


class Hand(lf.Source):
    """Pushed by hand."""

    def read(self, clock: lf.Clock) -> Iterator[Two]:
        yield from ()


class Pass(lf.Node):
    """One input; a fresh message for each."""

    def step(self, x: lf.AngularRate) -> lf.AngularRate:
        return lf.AngularRate(x.t, x.angular_rate)


class PassBlock(lf.Node):
    """One input, as blocks."""

    def step_block(self, x: lf.AngularRate) -> lf.AngularRate:
        return lf.AngularRate(x.t, x.angular_rate)


class Meet(lf.Node):
    """Two inputs of equal stamps; a fresh message for each row."""

    sync = lf.Exact()

    def step(self, x: lf.AngularRate, y: lf.AngularRate) -> lf.AngularRate:
        return lf.AngularRate(x.t, y.angular_rate)


class MeetBlock(lf.Node):
    """Two inputs, as blocks."""

    sync = lf.Exact()

    def step_block(self, x: lf.AngularRate, y: lf.AngularRate) -> lf.AngularRate:
        return lf.AngularRate(x.t, y.angular_rate)


def chain(plugin: type[lf.Node]) -> Graph:
    """Return hand -> HOPS nodes in a row; a second input is always the source's."""
    nodes = {"hand": GraphNode("hand", "Hand", Hand, Hand.Params())}
    before = Wire("hand", "a")
    for i in range(HOPS):
        inputs = {"x": before}
        if len(plugin.spec.inputs) == 2:
            inputs["y"] = Wire("hand", "b")
        nodes[f"n{i}"] = GraphNode(f"n{i}", plugin.__name__, plugin, plugin.Params(), inputs)
        before = Wire(f"n{i}", "out")
    return Graph("bench", nodes)


def messages() -> tuple[lf.AngularRate, list[lf.AngularRate]]:
    block = lf.AngularRate(np.arange(ROWS, dtype=np.int64) * 10**6, np.zeros((ROWS, 3)))
    return block, [block.row(i) for i in range(ROWS)]


def shifted(block: lf.AngularRate, start: int) -> lf.AngularRate:
    return block.replace(t=block.t + start)


def samples_through(plugin: type[lf.Node]) -> Callable[[int], float]:
    """Return a call that gives µs per sample for the whole chain, single samples."""
    driver = SampleDriver(started(chain(plugin)))
    two = len(plugin.spec.inputs) == 2
    push = driver.push
    block, _ = messages()

    def once(start: int) -> float:
        part = shifted(block, start)
        rows = [part.row(i) for i in range(ROWS)]
        begin = time.perf_counter()
        if two:
            for row in rows:
                push("hand", 0, row)
                push("hand", 1, row)
        else:
            for row in rows:
                push("hand", 0, row)
        return (time.perf_counter() - begin) / ROWS * 1e6

    return once


def blocks_through(plugin: type[lf.Node]) -> Callable[[int], float]:
    """Return a call that gives µs per sample for the whole chain, blocks of ROWS."""
    driver = BlockDriver(started(chain(plugin)))
    two = len(plugin.spec.inputs) == 2
    block, _ = messages()

    def once(start: int) -> float:
        part = shifted(block, start)
        items = [(0, part), (1, part)] if two else [(0, part)]
        begin = time.perf_counter()
        driver.push("hand", items, int(part.t[-1]) + 1)
        return (time.perf_counter() - begin) / ROWS * 1e6

    return once


def plain_samples(plugin: type[lf.Node]) -> Callable[[int], float]:
    steps = [plugin().step for _ in range(HOPS)]  # type: ignore[attr-defined]
    two = len(plugin.spec.inputs) == 2
    _, rows = messages()

    def once(start: int) -> float:
        begin = time.perf_counter()
        if two:
            for row in rows:
                x = row
                for step in steps:
                    x = step(x, row)
        else:
            for row in rows:
                x = row
                for step in steps:
                    x = step(x)
        return (time.perf_counter() - begin) / ROWS * 1e6

    return once


def plain_blocks(plugin: type[lf.Node]) -> Callable[[int], float]:
    steps = [plugin().step_block for _ in range(HOPS)]  # type: ignore[attr-defined]
    two = len(plugin.spec.inputs) == 2
    block, _ = messages()

    def once(start: int) -> float:
        begin = time.perf_counter()
        x = block
        for step in steps:
            x = step(x, block) if two else step(x)
        return (time.perf_counter() - begin) / ROWS * 1e6

    return once


def started(graph: Graph) -> Plan:
    plan = Plan(graph)
    plan.start()
    return plan


def source_cost() -> Callable[[int], float]:
    """Return µs per push into a graph without nodes: what the harness itself costs."""
    driver = SampleDriver(started(Graph("bench", {"hand": chain(Pass).nodes["hand"]})))
    block, _ = messages()

    def once(start: int) -> float:
        part = shifted(block, start)
        rows = [part.row(i) for i in range(ROWS)]
        begin = time.perf_counter()
        for row in rows:
            driver.push("hand", 0, row)
        return (time.perf_counter() - begin) / ROWS * 1e6

    return once


def paced(seconds: float) -> dict[str, dict[str, float]]:
    """Return end-to-end latency at 1 kHz, through the framework and through plain calls."""
    plan = Plan(chain(Pass))
    got: list[int] = []
    plan.tap(Wire(f"n{HOPS - 1}", "out"), lambda m: got.append(time.perf_counter_ns()))
    plan.start()
    driver = SampleDriver(plan)
    steps = [Pass().step for _ in range(HOPS)]
    rate = np.zeros(3)
    found: dict[str, list[float]] = {"framework": [], "plain": []}
    begin = time.perf_counter()
    for i in range(int(seconds * 1000)):
        while time.perf_counter() < begin + i * 1e-3:
            time.sleep(max(0.0, begin + i * 1e-3 - time.perf_counter()))
        sent = time.perf_counter_ns()
        if i % 2:
            driver.push("hand", 0, lf.AngularRate(i, rate))
            found["framework"].append((got[-1] - sent) / 1e3)
        else:
            x = lf.AngularRate(i, rate)
            for step in steps:
                x = step(x)
            found["plain"].append((time.perf_counter_ns() - sent) / 1e3)
    return {
        name: {"p50": float(np.percentile(v, 50)), "p99": float(np.percentile(v, 99))}
        for name, v in found.items()
    }


def measure(rounds: int) -> dict[str, float]:
    """Return the median µs per sample of each case, all taken in turn."""
    cases: dict[str, Callable[[int], float]] = {
        "source": source_cost(),
        "one input, samples": samples_through(Pass),
        "one input, samples, plain": plain_samples(Pass),
        "two inputs, samples": samples_through(Meet),
        "two inputs, samples, plain": plain_samples(Meet),
        "one input, blocks": blocks_through(PassBlock),
        "one input, blocks, plain": plain_blocks(PassBlock),
        "two inputs, blocks": blocks_through(MeetBlock),
        "two inputs, blocks, plain": plain_blocks(MeetBlock),
    }
    times: dict[str, list[float]] = {name: [] for name in cases}
    for i in range(rounds):
        for name, case in cases.items():
            times[name].append(case((i + 1) * 10**10))
    return {name: float(np.median(values)) for name, values in times.items()}


GOALS = {
    "one input, samples": 0.5,
    "two inputs, samples": 3.0,
    "one input, blocks": 0.1,
    "two inputs, blocks": 0.3,
}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--json", action="store_true")
    parser.add_argument("--rounds", type=int, default=60)
    parser.add_argument("--seconds", type=float, default=4.0)
    options = parser.parse_args()
    us = measure(options.rounds)
    result: dict[str, Any] = {"hops": {}, "paced at 1 kHz, us": paced(options.seconds)}
    for name, goal in GOALS.items():
        pushes = {"one input, samples": 1, "two inputs, samples": 2}.get(name, 0)
        chain_us = us[name] - pushes * us["source"]
        plain = us[f"{name}, plain"]
        result["hops"][name] = {
            "plain_us_per_hop": plain / HOPS,
            "framework_us_per_hop": (chain_us - plain) / HOPS,
            "ratio": chain_us / plain,
            "goal_us_per_hop": goal,
        }
    if options.json:
        print(json.dumps(result, indent=2))
        return
    print(f"{'per hop and sample':24} {'plain µs':>9} {'added µs':>9} {'goal':>6} {'ratio':>7}")
    for name, row in result["hops"].items():
        print(
            f"{name:24} {row['plain_us_per_hop']:9.4f} {row['framework_us_per_hop']:9.4f} "
            f"{row['goal_us_per_hop']:6.1f} {row['ratio']:7.2f}"
        )
    print("\nsix nodes at 1 kHz, end to end (µs)")
    for name, row in result["paced at 1 kHz, us"].items():
        print(f"{name:10} p50 {row['p50']:7.1f}  p99 {row['p99']:7.1f}")


if __name__ == "__main__":
    main()
