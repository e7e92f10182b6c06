"""Nodes of the families beside a numpy reference: µs per sample.

    python benchmarks/families.py [FAMILY...] [--samples N] [--block N] [--rounds N] [--json]

Each node runs alone in a graph, in blocks and sample by sample; the time holds the messages that
come in and go out. The reference does the same by plain numpy and scipy calls without a framework,
on the same blocks and rows; where that makes no sense, on the whole record at once, in which it may
look ahead. Rounds are interleaved, figures are medians of processor time. Families are the modules
of family_rows/.
"""

from __future__ import annotations

import argparse
import json
import statistics
import time
from collections.abc import Callable
from functools import partial

import numpy as np
from family_rows import Row, calibration, gravimetry, interference, pedestrian

from lodeflow.registry import registry
from lodeflow.testing import Harness

FAMILIES = {
    module.__name__.rpartition(".")[2]: module.ROWS
    for module in (calibration, interference, pedestrian, gravimetry)
}
END = 2**62


def timed(work: Callable[[], object]) -> float:
    start = time.process_time()
    work()
    return time.process_time() - start


def forms_of(row: Row, n: int, length: int) -> tuple[Callable[[], object], Callable[[], object]]:
    """The node and the reference on n rows, so many at a time."""
    blocks = row.inputs(n)
    harness = Harness(registry().load(row.name), row.params, blocks)
    longest = max(blocks.values(), key=len).t
    cuts = [*longest[length::length].tolist(), END]
    at = {
        name: [0, *np.searchsorted(block.t, cuts[:-1]), len(block)]
        for name, block in blocks.items()
    }
    parts = [
        {name: block[at[name][k] : at[name][k + 1]] for name, block in blocks.items()}
        for k in range(len(cuts))
    ]

    def by_reference() -> None:
        reference = row.make_reference()
        for part in [blocks] if row.whole else parts:
            reference(part)

    by_node = harness.run_samples if length == 1 else partial(harness.run_blocks, cuts)
    return by_node, by_reference


def measure(row: Row, samples: int, block: int, rounds: int) -> dict[str, float]:
    """Median µs per sample: node in blocks and by samples, reference in blocks and by rows."""
    forms = {}
    for n, length, kind in ((samples, block, "block"), (max(samples // 10, 1), 1, "sample")):
        node, reference = forms_of(row, n, length)
        forms[f"node, {kind}"] = (node, n)
        if not (row.whole and length == 1):
            forms[f"numpy, {kind}"] = (reference, n)
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
        family: {row.name: measure(row, args.samples, args.block, args.rounds) for row in rows}
        for family, rows in FAMILIES.items()
        if not args.families or family in args.families
    }
    if args.json:
        print(json.dumps({"unit": "microseconds per sample", **found}, indent=2))
        return
    columns = ["node, block", "numpy, block", "node, sample", "numpy, sample"]
    for family, rows in found.items():
        print(f"| {family}, µs per sample | {' | '.join(columns)} |")
        print(f"|---|{'---:|' * len(columns)}")
        for name, figures in rows.items():
            cells = [f"{figures[c]:.3g}" if c in figures else "" for c in columns]
            print(f"| `{name}` | {' | '.join(cells)} |")
        print()


if __name__ == "__main__":
    main()
