"""Partition: a graph cut into groups, and what each of them gets from and owes to the others."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace

from lodeflow.graph.groups import RECORDER
from lodeflow.graph.model import Graph, Group, Wire
from lodeflow.graph.topology import edges


@dataclass(frozen=True)
class Part:
    """One group seen by itself.

    Attributes:
        name: of the group.
        nodes: nodes that run in it; none in the recorder.
        inlets: streams that it reads from other groups, and which group each comes from.
        outlets: streams that it owes to other groups, and which groups read each.
        knot: groups that it reads from and that, directly or not, read from it. What they send is
            never held back, or two groups could wait for each other.
        reports_to: groups that it tells of itself although it owes them no stream, and that are
            linked for that: each group and the recorder.
    """

    name: str
    nodes: tuple[str, ...]
    inlets: Mapping[Wire, str] = field(default_factory=dict)
    outlets: Mapping[Wire, tuple[str, ...]] = field(default_factory=dict)
    knot: frozenset[str] = frozenset()
    reports_to: tuple[str, ...] = ()

    @property
    def peers(self) -> tuple[str, ...]:
        """Names of the groups that it exchanges anything with."""
        readers = [name for names in self.outlets.values() for name in names]
        return tuple(dict.fromkeys([*self.inlets.values(), *readers, *self.reports_to]))


def split(graph: Graph) -> Graph:
    """Return the graph with a group for each node, named like it; who only watches goes on so."""
    watching = {node for group in graph.processes.values() if group.latest for node in group.nodes}
    groups = {
        f"{n}-node" if n == RECORDER else n: Group((n,), latest=n in watching) for n in graph.nodes
    }
    listed = {
        name: {"nodes": list(group.nodes), "latest": True} if group.latest else list(group.nodes)
        for name, group in groups.items()
    }
    document = {**graph.document, "processes": listed}
    return replace(graph, processes=groups, document=document)


def unsplit(graph: Graph) -> Graph:
    """Return the graph without groups."""
    document = {name: value for name, value in graph.document.items() if name != "processes"}
    return replace(graph, processes={}, document=document)


def partition(graph: Graph, recorded: Iterable[Wire] = ()) -> dict[str, Part]:
    """Return the parts of a graph with groups, in the order of the file; the recorder is last.

    Args:
        graph: a checked graph with `processes`.
        recorded: streams that the recorder gets; none for no recorder.
    """
    home = {node: name for name, group in graph.processes.items() for node in group.nodes}
    inlets: dict[str, dict[Wire, str]] = {name: {} for name in graph.processes}
    for edge in edges(graph.nodes):
        if (sender := home[edge.wire.node]) != home[edge.to]:
            inlets[home[edge.to]][edge.wire] = sender
    if wires := tuple(recorded):
        inlets[RECORDER] = {wire: home[wire.node] for wire in wires}
    outlets: dict[str, dict[Wire, tuple[str, ...]]] = {name: {} for name in inlets}
    for reader, wires_in in inlets.items():
        for wire, sender in wires_in.items():
            outlets[sender][wire] = (*outlets[sender].get(wire, ()), reader)
    reporting = tuple(graph.processes)
    reach = _reach({name: set(found.values()) for name, found in inlets.items()})
    return {
        name: Part(
            name,
            graph.processes[name].nodes if name in graph.processes else (),
            inlets[name],
            outlets[name],
            frozenset(other for other in reach[name] if name in reach[other]),
            reporting if name == RECORDER else tuple(n for n in inlets if n == RECORDER),
        )
        for name in inlets
    }


def farthest(parts: Mapping[str, Part]) -> int:
    """Return the number of links between the two groups that are farthest from each other."""
    most = 0
    for name in parts:
        near, found, away = {name}, {name}, 0
        while near := {peer for each in near for peer in parts[each].peers} - found:
            found |= near
            away += 1
        most = max(most, away)
    return most


def _reach(before: Mapping[str, set[str]]) -> dict[str, set[str]]:
    """Return all groups that lie upstream of each."""
    found = {name: set(names) for name, names in before.items()}
    grown = True
    while grown:
        grown = False
        for names in found.values():
            more = {far for near in names for far in found[near]} - names
            if more:
                names |= more
                grown = True
    return found
