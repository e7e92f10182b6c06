"""Order and cycles of a graph: which edges may close a cycle, and why others may not."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from lodeflow.graph.model import GraphNode, Wire
from lodeflow.node import Node
from lodeflow.sync import Hold, Nearest


@dataclass(frozen=True)
class Edge:
    """A wire seen from the node that it ends at; `port` is None where it is a gate."""

    wire: Wire
    to: str
    port: str | None
    delayed: bool


def edges(nodes: Mapping[str, GraphNode]) -> list[Edge]:
    """Return all wires and gates of a graph; those to unknown nodes are left out."""
    found = []
    for node in nodes.values():
        sync = getattr(node.plugin, "sync", None)
        delayed = isinstance(sync, Hold) and sync.delay
        for port, wire in node.inputs.items():
            held = delayed and port != getattr(sync, "lead", None)
            found.append(Edge(wire, node.name, port, held))
        found += [Edge(gate.wire, node.name, None, False) for gate in node.gates]
    return [edge for edge in found if edge.wire.node in nodes]


def order(nodes: Mapping[str, GraphNode]) -> tuple[list[str], list[str]]:
    """Return the nodes so that each comes after those it depends on, and the nodes left over.

    Delayed inputs are no dependency. Nodes left over lie on, or behind, a cycle that no delayed
    Hold closes. The order of the file is kept where the wires leave a choice.
    """
    waiting: dict[str, set[str]] = {name: set() for name in nodes}
    for edge in edges(nodes):
        if not edge.delayed:
            waiting[edge.to].add(edge.wire.node)
    done: dict[str, None] = {}
    while ready := next((n for n, needs in waiting.items() if needs <= done.keys()), None):
        done[ready] = None
        del waiting[ready]
    return list(done), list(waiting)


def cycles(nodes: Mapping[str, GraphNode]) -> list[set[str]]:
    """Return the sets of nodes that can reach each other (delayed inputs included)."""
    return _knots(nodes, edges(nodes))


def loops(nodes: Mapping[str, GraphNode]) -> list[list[Edge]]:
    """Return one closed chain of edges of each set of nodes that wait for each other.

    A chain is as short as can be and begins at the first of its nodes in the file. Delayed inputs
    do not wait.
    """
    waits = [edge for edge in edges(nodes) if not edge.delayed]
    found = []
    for knot in _knots(nodes, waits):
        first = next(name for name in nodes if name in knot)
        chains = [[edge] for edge in waits if edge.wire.node == first and edge.to in knot]
        seen = {first}
        while chains[0][-1].to != first:
            chain = chains.pop(0)
            if (at := chain[-1].to) not in seen:
                seen.add(at)
                chains += [[*chain, e] for e in waits if e.wire.node == at and e.to in knot]
        found.append(chains[0])
    return found


def _knots(nodes: Mapping[str, GraphNode], links: Iterable[Edge]) -> list[set[str]]:
    after: dict[str, set[str]] = {name: set() for name in nodes}
    for edge in links:
        after[edge.wire.node].add(edge.to)
    reach = {name: _reachable(after, name) for name in nodes}
    found: list[set[str]] = []
    for name in nodes:
        knot = {other for other in reach[name] if name in reach[other]}
        if knot and knot not in found:
            found.append(knot)
    return found


def obstacles(nodes: Mapping[str, GraphNode], cycle: Iterable[str]) -> list[str]:
    """Return why a cycle, though closed by a delayed Hold, could never move; empty if it can."""
    members = set(cycle)
    found = []
    for name in sorted(members):
        plugin = nodes[name].plugin
        if issubclass(plugin, Node) and plugin(nodes[name].params).lookback:
            found.append(f"'{name}' has a lookback, so it waits for its own output")
    for edge in edges(nodes):
        if edge.to not in members or edge.wire.node not in members:
            continue
        sync = getattr(nodes[edge.to].plugin, "sync", None)
        if isinstance(sync, Nearest) and edge.port not in (None, sync.lead):
            found.append(f"'{edge.to}' waits for what comes after each row (Nearest)")
        port = nodes[edge.wire.node].plugin.spec.output(edge.wire.port)
        if port is not None and port.by_finish:
            found.append(f"'{edge.wire}' speaks only at the end of its input")
    return found


def _reachable(after: Mapping[str, set[str]], start: str) -> set[str]:
    seen: set[str] = set()
    pending = list(after[start])
    while pending:
        if (name := pending.pop()) not in seen:
            seen.add(name)
            pending.extend(after[name])
    return seen
