"""Random graphs, and four ways to run them: whole blocks, split blocks, samples, by definition."""

from __future__ import annotations

import random
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Any

import nodes
import numpy as np
from hypothesis import strategies as st
from nodes import Value

import lodeflow as lf
from lodeflow.graph.model import Gate, Graph, GraphNode, Wire
from lodeflow.graph.topology import cycles, obstacles, order
from lodeflow.messages.cdr import layout_of
from lodeflow.runtime.blocks import BlockDriver
from lodeflow.runtime.plan import Plan
from lodeflow.runtime.samples import SampleDriver
from lodeflow.sync import END

Streams = dict[Wire, list[tuple[int, bytes]]]


@dataclass
class Case:
    """A graph, and what its sources have: per source and port, a block."""

    graph: Graph
    data: dict[str, list[Any]]


def make_node(name: str, plugin: Any, **more: Any) -> GraphNode:
    return GraphNode(name, plugin.__name__, plugin, plugin.Params(), **more)


@st.composite
def cases(draw: Callable[..., Any]) -> Case:
    n_sources = draw(st.integers(1, 3))
    n_nodes = draw(st.integers(1, 9))
    rng = random.Random(draw(st.integers(0, 2**32)))
    built: dict[str, GraphNode] = {}
    values: list[Wire] = []
    modes: list[Wire] = []
    data: dict[str, list[Any]] = {}
    for i in range(n_sources):
        name = f"s{i}"
        built[name] = make_node(name, nodes.Given)
        data[name] = [random_block(rng), random_block(rng)]
        values += [Wire(name, "a"), Wire(name, "b")]
    loops = []
    for i in range(n_nodes):
        name = f"n{i}"
        kinds = rng.choices([nodes.SINGLES, nodes.JOINS, nodes.LOOPS], [5, 5, 1])[0]
        plugin = rng.choice(kinds)
        spec = plugin.spec
        inputs = {
            port.name: rng.choice(values[-8:] if rng.random() < 0.6 else values)
            for port in spec.inputs
            if not port.optional or rng.random() < 0.5
        }
        gates = ()
        if modes and rng.random() < 0.3:
            allowed = frozenset(rng.sample([1, 2], rng.choice([1, 1, 2])))
            gates = (Gate(rng.choice(modes), "mode", allowed),)
        built[name] = make_node(name, plugin, inputs=inputs, gates=gates)
        if plugin in nodes.LOOPS:
            loops.append(name)
        for port in spec.outputs:
            (modes if port.type is lf.Mode else values).append(Wire(name, port.name))
    for name in loops:
        close_loop(rng, built, name, values)
    return Case(Graph("random", built), data)


def close_loop(
    rng: random.Random, built: dict[str, GraphNode], name: str, values: list[Wire]
) -> None:
    """Wire the held input of a Loop to something behind it, where that can move."""
    for wire in rng.sample(values, len(values)):
        node = built[name]
        tried = {**built, name: make_node(
            name, node.plugin, inputs={**node.inputs, "back": wire}, gates=node.gates
        )}  # fmt: skip
        found = cycles(tried)
        closed = any(name in cycle for cycle in found) and not order(tried)[1]
        if closed and not any(obstacles(tried, cycle) for cycle in found):
            built.update(tried)
            return


def random_block(rng: random.Random) -> Any:
    n = rng.choice([0, 1, 3, 12, 25])
    steps = [rng.choice([1, 1, 2, 3, 5, 9]) for _ in range(n)]
    t = np.cumsum([rng.randrange(20), *steps])[:n].astype(np.int64)
    return Value(t, np.array([rng.randrange(1000) for _ in range(n)], dtype=np.int64))


def collect(plan: Plan) -> Streams:
    streams: Streams = {wire: [] for wire in plan.taps}
    for wire, into in streams.items():

        def tap(message: Any, into: list[tuple[int, bytes]] = into) -> None:
            into.extend(encoded(message))

        plan.tap(wire, tap)
    return streams


def encoded(message: Any) -> list[tuple[int, bytes]]:
    layout = layout_of(type(message))
    if not message.is_block:
        return [(message.t, layout.encode_sample(message))]
    records = layout.encode_block(message)
    return [(t, record.tobytes()) for t, record in zip(message.t.tolist(), records, strict=True)]


def counts(plan: Plan) -> dict[str, tuple[int, int, int]]:
    return {
        name: (node.counters.stepped, node.counters.unmatched, node.counters.gated)
        for name, node in plan.nodes.items()
    }


def pieces(case: Case, rng: random.Random, whole: bool) -> list[tuple[str, list[Any], int]]:
    """Cut the sources' data at random stamps, in a random order between sources."""
    queues = []
    for name, blocks in case.data.items():
        stamps = sorted({int(t) for block in blocks for t in block.t})
        cuts = [] if whole else sorted({rng.choice(stamps) for _ in stamps if rng.random() < 0.5})
        queue = []
        start = -1
        for cut in [*cuts, END]:
            part = [
                (port, block[(block.t >= start) & (block.t < cut)])
                for port, block in enumerate(blocks)
            ]
            queue.append((name, [(p, b) for p, b in part if len(b)], cut))
            start = cut
        queues.append(queue)
    merged = []
    while queues := [queue for queue in queues if queue]:
        merged.append(rng.choice(queues).pop(0))
    return merged


def run_blocks(case: Case, rng: random.Random, *, whole: bool) -> tuple[Streams, dict[str, Any]]:
    plan = Plan(case.graph)
    streams = collect(plan)
    plan.start()
    driver = BlockDriver(plan)
    for name, blocks, bound in pieces(case, rng, whole):
        driver.push(name, blocks, bound)
    assert driver.unfinished() == []
    return streams, counts(plan)


def run_samples(case: Case, rng: random.Random) -> tuple[Streams, dict[str, Any]]:
    plan = Plan(case.graph)
    streams = collect(plan)
    plan.start()
    driver = SampleDriver(plan)
    queues = []
    for name, blocks in case.data.items():
        items = [
            (int(block.t[i]), name, port, block.row(i))
            for port, block in enumerate(blocks)
            for i in range(len(block))
        ]
        queues.append([*sorted(items, key=lambda item: item[:3]), (END, name, 0, None)])
    while queues := [queue for queue in queues if queue]:
        queue = rng.choice(queues)
        t, name, port, sample = queue.pop(0)
        if rng.random() < 0.7 or sample is None:
            driver.promise(name, t)
        if sample is not None:
            driver.push(name, port, sample)
    assert driver.unfinished() == []
    driver.count()
    return streams, counts(plan)


START = 100
"""Added to all stamps: a delayer looks back, and MCAP has no negative times."""


def playing(blocks: list[Any], cuts: list[int]) -> type:
    """Return a source that yields the blocks, cut at some stamps."""

    class Playing(nodes.Given):
        def read(self, clock: Any) -> Iterator[nodes.Pair]:
            for first, last in zip([0, *cuts], [*cuts, 2**62], strict=True):
                yield nodes.Pair(*[b[(b.t >= first) & (b.t < last)] for b in blocks])

    return Playing


def with_sources(case: Case, rng: random.Random) -> Graph:
    """Return the graph of a case, with sources that have its data."""
    built = dict(case.graph.nodes)
    for name, blocks in case.data.items():
        moved = [nodes.Value(block.t + START, block.value) for block in blocks]
        stamps = np.unique(np.concatenate([block.t for block in moved])).tolist()
        cuts = [t for t in stamps if rng.random() < 0.3]
        built[name] = replace(built[name], plugin=playing(moved, cuts))
    return replace(case.graph, nodes=built)
