"""The rules of event time by their definition, over whole streams, without bounds or queues."""

from __future__ import annotations

import random
from typing import Any

from graphs import Case, Streams, encoded, run_blocks, run_samples

from lodeflow.graph.model import GraphNode, Wire
from lodeflow.graph.topology import order
from lodeflow.runtime.plan import PlanNode
from lodeflow.sync import Each, Exact, Hold, Nearest, Sparse


def compare(case: Case, seed: int) -> None:
    """Run a case in every way and hold the results together."""
    rng = random.Random(seed)
    streams, counted = run_blocks(case, rng, whole=True)
    for other, other_counted in (
        run_blocks(case, rng, whole=False),
        run_samples(case, rng),
    ):
        assert other == streams
        assert other_counted == counted
    defined = run_by_definition(case)
    if defined is not None:
        assert defined == (streams, counted)


def run_by_definition(case: Case) -> tuple[Streams, dict[str, Any]] | None:
    """Return streams and counts; None for a graph with a delayed input, which has no order."""
    if any(
        isinstance(s := node.sync, Hold) and s.delay
        for node in map(PlanNode, case.graph.nodes.values())
    ):
        return None
    samples: dict[Wire, list[Any]] = {}
    counted = {}
    for name in order(case.graph.nodes)[0]:
        node = case.graph.nodes[name]
        if node.plugin.spec.is_source:
            for port, block in zip(node.plugin.spec.outputs, case.data[name], strict=True):
                samples[Wire(name, port.name)] = [block.row(i) for i in range(len(block))]
            counted[name] = (0, 0, 0)
        else:
            counted[name] = run_node(node, samples)
    return {wire: [e for m in rows for e in encoded(m)] for wire, rows in samples.items()}, counted


def run_node(node: GraphNode, samples: dict[Wire, list[Any]]) -> tuple[int, int, int]:
    spec = node.plugin.spec
    plugin: Any = node.plugin(node.params)
    plugin.start()
    for port in spec.outputs:
        samples[Wire(node.name, port.name)] = []
    inputs = {name: samples[wire] for name, wire in node.inputs.items()}
    rows, unmatched = align(spec, inputs)
    stepped = gated = 0
    for t, row in rows:
        if not all(passes(gate, samples[gate.wire], t) for gate in node.gates):
            gated += 1
            continue
        stepped += 1
        arguments = [row.get(port.name) for port in spec.inputs]
        if spec.has_step:
            returned = plugin.step(*arguments)
        else:
            returned = plugin.step_block(*as_blocks(spec, arguments, t))
        emit(node, samples, returned)
    emit(node, samples, plugin.finish() if hasattr(plugin, "finish") else None)
    return stepped, unmatched, gated


def as_blocks(spec: Any, arguments: list[Any], t: int) -> list[Any]:
    import numpy as np

    if not isinstance(spec.sync, Each):
        return [None if a is None else a.as_block() for a in arguments]
    stamps = np.array([t])
    return [
        Sparse(port.type.empty(), np.array([-1]), stamps)
        if a is None
        else Sparse(a.as_block(), np.array([0]), stamps)
        for port, a in zip(spec.inputs, arguments, strict=True)
    ]


def emit(node: GraphNode, samples: dict[Wire, list[Any]], returned: Any) -> None:
    if returned is None:
        return
    names = getattr(returned, "_fields", ("out",))
    for name, message in zip(
        names, returned if isinstance(returned, tuple) else (returned,), strict=True
    ):
        if message is not None:
            into = samples[Wire(node.name, name)]
            if message.is_block:
                into.extend(message.row(i) for i in range(len(message)))
            else:
                into.append(message)


def passes(gate: Any, stream: list[Any], t: int) -> bool:
    past = [message for message in stream if message.t <= t]
    return bool(past) and getattr(past[-1], gate.field) in gate.allowed


def align(spec: Any, inputs: dict[str, list[Any]]) -> tuple[list[tuple[int, Any]], int]:
    """Return the rows as (stamp, {input: message}), and how many lead rows found no partner."""
    sync = spec.sync
    if isinstance(sync, Each):
        stamps = sorted({m.t for stream in inputs.values() for m in stream})
        return [
            (t, {name: m for name, stream in inputs.items() for m in stream if m.t == t})
            for t in stamps
        ], 0
    lead = getattr(sync, "lead", spec.inputs[0].name)
    rows = []
    unmatched = 0
    for message in inputs[lead]:
        row = {lead: message}
        for name, stream in inputs.items():
            if name != lead:
                row[name] = partner(sync, name, stream, message.t)
        if None in row.values():
            unmatched += 1
        else:
            rows.append((message.t, row))
    return rows, unmatched


def partner(sync: Any, name: str, stream: list[Any], t: int) -> Any:
    match sync:
        case Exact():
            return next((m for m in stream if m.t == t), None)
        case Nearest(_, within):
            near = [m for m in stream if abs(m.t - t) <= within]
            return min(near, key=lambda m: (abs(m.t - t), m.t), default=None)
        case Hold():
            past = [m for m in stream if m.t <= t]
            return past[-1] if past else sync.first(name)
    raise AssertionError(sync)
