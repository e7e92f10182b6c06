"""What the tests of feeds share: one source at a time, and its rows by definition."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import Any

from hypothesis import strategies as st
from runtime_toys import block, graph

import lodeflow as lf
from lodeflow.runtime.plan import Plan, PlanNode

Rows = list[tuple[int, float]]


def planned(plugin: type[lf.Source]) -> PlanNode:
    return Plan(graph(s=plugin)).nodes["s"]


def by_definition(given: Rows) -> tuple[Rows, dict[str, int]]:
    kept: Rows = []
    lost = {"nonfinite": 0, "disorder": 0}
    for t, x in given:
        if not math.isfinite(x):
            lost["nonfinite"] += 1
        elif kept and t <= kept[-1][0]:
            lost["disorder"] += 1
        else:
            kept.append((t, x))
    return kept, {why: count for why, count in lost.items() if count}


any_rows = st.lists(
    st.tuples(
        st.integers(-20, 20), st.sampled_from([0.0, 1.5, -2.0, math.nan, math.inf, -math.inf])
    ),
    max_size=25,
)


def cut(given: Rows, cuts: list[int], samples: bool) -> list[Any]:
    """Return rows as items of a source: blocks cut at some indices, or samples where of one."""
    edges = [0, *sorted(min(c, len(given)) for c in cuts), len(given)]
    parts = [block(*given[a:b]) for a, b in pairwise(edges)]
    return [part.row(0) if samples and len(part) == 1 else part for part in parts]
