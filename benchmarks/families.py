"""Nodes of the families beside a numpy reference: µs per sample.

    python benchmarks/families.py [FAMILY...] [--samples N] [--block N] [--rounds N] [--json]

Each node runs alone in a graph, in blocks and sample by sample; the reference does the same with
plain numpy calls on the same blocks, without a framework. Rounds are interleaved, figures are
medians. A family is a function that returns rows; add yours to FAMILIES.
"""

from __future__ import annotations

import argparse
import json
import statistics
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

import lodeflow as lf
from lodeflow.registry import registry
from lodeflow.testing import Harness

Reference = Callable[[Mapping[str, Any]], object]


@dataclass(frozen=True)
class Row:
    """A node to measure.

    Attributes:
        name: of the plugin.
        make_reference: makes a fresh one: the same by numpy, called with a block per input port.
        params: of the node; its example if None.
        inputs: makes the blocks of N rows for its ports; random data for all ports if None.
    """

    name: str
    make_reference: Callable[[], Reference]
    params: Mapping[str, Any] | None = None
    inputs: Callable[[int], Mapping[str, lf.Message]] | None = None


def random_blocks(plugin: type[lf.Node], n: int) -> dict[str, lf.Message]:
    """Random columns at 100 Hz for each input port."""
    rng = np.random.default_rng(0)
    t = np.arange(n, dtype=np.int64) * 10_000_000
    return {
        port.name: port.type(t, *[rng.standard_normal((n, *f.shape)) for f in port.type.fields])
        for port in plugin.spec.inputs
    }


def affine(plugin: str, port: str, field_name: str, matrix: str) -> Row:
    """A calibrator: matrix x + offset."""
    node = registry().load(plugin)
    live = node(node.Params(**node.example))
    live.start()
    model = getattr(live, matrix)
    transposed = model.matrix.T.copy()
    return Row(
        plugin, lambda: lambda blocks: getattr(blocks[port], field_name) @ transposed + model.offset
    )


def online_by_numpy() -> Reference:
    """The sums of the online estimator over a segment, row by row with numpy's small matrices."""
    turn, sums = np.eye(3), [np.zeros((3, 3)), np.zeros(3), np.zeros(3), 0.0]

    def run(blocks: Mapping[str, Any]) -> None:
        nonlocal turn
        rates, fields = blocks["imu"].angular_velocity, blocks["mag"].magnetic_field
        for rate, m in zip(rates, fields, strict=True):
            x, y, z = 0.01 * rate
            cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
            angle = np.sqrt(x * x + y * y + z * z)
            turn = turn @ (
                np.eye(3)
                + np.sin(angle) / angle * cross
                + (1.0 - np.cos(angle)) / angle**2 * (cross @ cross)
            )
            sums[0] = sums[0] + turn
            sums[1] = sums[1] + m
            sums[2] = sums[2] + turn @ m
            sums[3] = sums[3] + m @ m

    return run


def calibration() -> list[Row]:
    """Calibrators."""
    return [
        affine("mag_calibrator", "raw", "counts", "field"),
        affine("accel_calibrator", "raw", "counts", "force"),
        affine("gyro_calibrator", "raw", "counts", "rate"),
        affine("iron_calibrator", "mag", "magnetic_field", "field"),
        Row("online_mag_calibrator", online_by_numpy, params={}),
    ]


FAMILIES: dict[str, Callable[[], list[Row]]] = {"calibration": calibration}


def timed(work: Callable[[], object]) -> float:
    start = time.perf_counter()
    work()
    return time.perf_counter() - start


def measure(row: Row, samples: int, block: int, rounds: int) -> dict[str, float]:
    """Median µs per sample: node in blocks and by samples, reference in blocks and by rows."""
    plugin = registry().load(row.name)
    few = max(samples // 10, 1)
    makes = row.inputs or (lambda n: random_blocks(plugin, n))
    forms = {}
    for n, length, kind in ((samples, block, "block"), (few, 1, "sample")):
        blocks = makes(n)
        harness = Harness(plugin, row.params, blocks)
        stamps = next(iter(blocks.values())).t
        cuts = [int(t) for t in stamps[length::length]] + [2**62]
        parts = [
            {name: b[at : at + length] for name, b in blocks.items()} for at in range(0, n, length)
        ]

        def by_reference(parts: list[dict[str, lf.Message]] = parts) -> None:
            reference = row.make_reference()
            for part in parts:
                reference(part)

        by_node = harness.run_samples if length == 1 else partial(harness.run_blocks, cuts)
        forms[f"node, {kind}"] = (by_node, n)
        forms[f"numpy, {kind}"] = (by_reference, n)
    times: dict[str, list[float]] = {name: [] for name in forms}
    for work, _ in forms.values():
        work()  # compiles, fills caches
    for _ in range(rounds):
        for name, (work, _) in forms.items():
            times[name].append(timed(work))
    return {name: 1e6 * statistics.median(times[name]) / n for name, (_, n) in forms.items()}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("families", nargs="*", choices=[[], *FAMILIES], metavar="FAMILY")
    parser.add_argument("--samples", type=int, default=20_000)
    parser.add_argument("--block", type=int, default=1000)
    parser.add_argument("--rounds", type=int, default=7)
    parser.add_argument("--json", action="store_true")
    args = parser.parse_args()
    found = {
        family: {row.name: measure(row, args.samples, args.block, args.rounds) for row in make()}
        for family, make in FAMILIES.items()
        if not args.families or family in args.families
    }
    if args.json:
        print(json.dumps({"unit": "microseconds per sample", **found}, indent=2))
        return
    for family, rows in found.items():
        columns = list(next(iter(rows.values())))
        print(f"{family:<26}" + "".join(f"{column:>16}" for column in columns))
        for name, figures in rows.items():
            print(f"  {name:<24}" + "".join(f"{figures[c]:>16.3f}" for c in columns))


if __name__ == "__main__":
    main()
