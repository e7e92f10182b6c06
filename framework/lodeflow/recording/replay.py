"""Replay: a checked graph and a recording make the graph that runs from recorded streams."""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

from lodeflow.clock import Clock
from lodeflow.errors import GraphError, LodeflowError, RecordingError, did_you_mean
from lodeflow.graph import Edge, Graph, GraphNode, Record, Wire, edges, load_graph_text
from lodeflow.messages.cdr import StreamConstants
from lodeflow.messages.message import Message
from lodeflow.node import Source
from lodeflow.params import Params
from lodeflow.recording.mcap.file import McapFile
from lodeflow.recording.mcap.raw import topics
from lodeflow.recording.reader import Recording
from lodeflow.recording.recorder import topic
from lodeflow.recording.source import aligned, recorded_constants
from lodeflow.runtime.intake import Fed, Intake
from lodeflow.runtime.plan import PlanNode

RECORDED_TO = "recordings/{name}-replay-{start}.mcap"
"""Where a replay is recorded if nothing else is said."""


@dataclass(frozen=True)
class Replay:
    """How a graph runs from a recording.

    Attributes:
        graph: what to run: nodes to recompute, and sources in the place of the others; its
            document is that of the whole graph.
        fed: streams that come from the recording.
        computed: nodes that are computed anew.
        notes: what to tell the user although it is no mistake.
    """

    graph: Graph
    fed: tuple[Wire, ...]
    computed: tuple[str, ...]
    notes: tuple[str, ...] = ()

    @property
    def recomputed(self) -> tuple[Wire, ...]:
        """Streams that are computed anew."""
        return tuple(wire for wire in self.graph.streams() if wire.node in self.computed)


def replaying(
    graph: Graph, recording: Recording, *, start: Sequence[str] = (), complete: bool = True
) -> Replay:
    """Return how to run a graph from a recording.

    Sources play what was recorded of them; a source of which nothing was recorded is computed
    anew, as far as the recorded run had come if it is the same. What a node reads from outside of
    the recomputed part comes from the recording; other nodes are left out.

    Args:
        graph: a checked graph, its streams named as those of the recording.
        recording: where the streams are.
        start: nodes to recompute, with all that lies downstream of them; none for all but sources.
        complete: feed every recorded stream that is not recomputed, also where nobody reads it,
            so that a recording of the replay has the same streams.

    Raises:
        GraphError: with each stream that is read and is neither recorded nor computed, each that
            has another type, and each unknown or live node in `start`.
    """
    before = recorded_graph(recording)
    problems = _unknown(graph, start)
    if problems:
        raise GraphError(problems)
    links = edges(graph.nodes)
    anew = _downstream(start, links) if start else _all_but_sources(graph, recording)
    anew |= {  # a source that left nothing behind, and that somebody needs
        edge.wire.node
        for edge in links
        if edge.to in anew and _computable(graph.nodes[edge.wire.node], recording)
    }
    if not anew:
        problems.append(
            f"{recording.path}: nothing to compute, graph '{graph.name}' has only sources, and "
            "they are recorded; name a graph with nodes that read them"
        )
    fed: set[Wire] = set()
    for wire, readers in _read_from_outside(links, anew).items():
        why = _not_readable(graph.nodes[wire.node], wire, recording, readers)
        problems += [f"{recording.path}: {why}"] if why else []
        fed.add(wire)
    if problems:
        raise GraphError(problems)
    if complete:
        fed |= {w for w in graph.streams() if w.node not in anew and _fits(graph, w, recording)}
    nodes = {}
    for name, node in graph.nodes.items():
        if name in anew:
            nodes[name] = _as_far_as_recorded(node, before, recording)
        elif ports := [wire for wire in fed if wire.node == name]:
            nodes[name] = _fed(node, ports, recording.path)
    wanted = None if graph.record is None else graph.record.streams
    recorded = fed | {
        wire
        for wire in graph.streams()
        if wire.node in anew
        and (wanted is None or wire in wanted or topic(wire) in recording.topics)
    }
    record = Record(RECORDED_TO, tuple(wire for wire in graph.streams() if wire in recorded))
    return Replay(
        replace(graph, nodes=nodes, record=record, processes={}),
        tuple(wire for wire in graph.streams() if wire in fed),
        tuple(name for name in graph.nodes if name in anew),
        tuple(_notes(graph, before, {wire.node for wire in fed}, recording)),
    )


def without_effect(replay: Replay, changes: Iterable[tuple[str, str]]) -> list[str]:
    """Return what is wrong with changes of nodes that are not computed.

    Args:
        replay: how the graph runs.
        changes: (where it is written, node) of each change.
    """
    return [
        f"{place}: '{node}' is not computed, its streams come from the recording; "
        f"--from {node} computes it anew"
        for place, node in changes
        if node not in replay.computed
    ]


def recorded_graph(recording: Recording) -> Graph | None:
    """Return the graph in a recording; None if there is none, or it does not check here."""
    try:
        return load_graph_text(recording.attachment("graph.yaml").decode())
    except (LodeflowError, UnicodeDecodeError):
        return None


def is_complete(recording: Recording) -> bool:
    """Whether the run that wrote a recording came to its end, and was not killed."""
    return _summary(recording) is not None


def last_stamps(path: Path, wires: Iterable[Wire]) -> dict[Wire, int]:
    """Return the stamp, in ns, at which each recorded stream that has messages ends.

    Raises:
        RecordingError: the file cannot be read.
    """
    found: dict[Wire, int] = {}
    with McapFile(path) as file:
        channels = topics(file)
        missing = {w: channels[topic(w)] for w in wires if topic(w) in channels}
        for place in reversed(file.chunks):
            for wire in missing.keys() - found.keys():
                indexes = [file.index(place, channel.id) for channel in missing[wire]]
                stamps = [int(index["log_time"].max()) for index in indexes if len(index)]
                if stamps:
                    found[wire] = max(stamps)
    return {wire: found[wire] for wire in missing if wire in found}


def _summary(recording: Recording) -> Mapping[str, Any] | None:
    try:
        found: Mapping[str, Any] = json.loads(recording.metadata("lodeflow.summary")["summary"])
    except (RecordingError, KeyError, ValueError, RecursionError):
        return None
    return found if isinstance(found, dict) else None


def _unknown(graph: Graph, start: Iterable[str]) -> list[str]:
    """Return why nodes cannot be those to start from."""
    problems = []
    for name in start:
        if name not in graph.nodes:
            near = did_you_mean(name, graph.nodes) or f" (nodes: {', '.join(graph.nodes)})"
            problems.append(f"--from {name}: no node '{name}' in graph '{graph.name}'{near}")
        elif _is_live(graph.nodes[name]):
            problems.append(
                f"--from {name}: '{name}' is a live device, which cannot be computed anew; start "
                "from nodes behind it"
            )
    return problems


def _downstream(start: Iterable[str], links: Sequence[Edge]) -> set[str]:
    found = set(start)
    while more := {edge.to for edge in links if edge.wire.node in found} - found:
        found |= more
    return found


def _all_but_sources(graph: Graph, recording: Recording) -> set[str]:
    return {
        name
        for name, node in graph.nodes.items()
        if not node.plugin.spec.is_source or _computable(node, recording)
    }


def _computable(node: GraphNode, recording: Recording) -> bool:
    """Whether a node is a source of which nothing is recorded, and that can be read again."""
    if not node.plugin.spec.is_source or _is_live(node):
        return False
    wires = [Wire(node.name, port.name) for port in node.plugin.spec.outputs]
    return not any(topic(wire) in recording.topics for wire in wires)


def _is_live(node: GraphNode) -> bool:
    return getattr(node.plugin, "max_delay", None) is not None


def _read_from_outside(links: Sequence[Edge], anew: set[str]) -> dict[Wire, list[str]]:
    """Return the streams that recomputed nodes read from others, with who reads them, and where."""
    found: dict[Wire, list[str]] = {}
    for edge in links:
        if edge.to in anew and edge.wire.node not in anew:
            where = f"input {edge.port}" if edge.port is not None else "gate"
            found.setdefault(edge.wire, []).append(f"'{edge.to}' ({where})")
    return found


def _kind(node: GraphNode, wire: Wire) -> type[Message]:
    return next(port.type for port in node.plugin.spec.outputs if port.name == wire.port)


def _not_readable(
    node: GraphNode, wire: Wire, recording: Recording, readers: list[str]
) -> str | None:
    """Return why a stream cannot come from a recording, who needs it and what to do; or None."""
    if topic(wire) not in recording.topics:
        what = f"'{wire}' is not recorded, but read by {', '.join(readers)}; "
        if _is_live(node):
            return what + "it comes from a live device: take a recording that holds it"
        return what + f"--from {node.name} computes it anew"
    try:
        recording.stream(topic(wire), _kind(node, wire))
    except RecordingError as error:
        return f"{str(error).removeprefix(f'{recording.path}: ')}; read by {', '.join(readers)}"
    return None


def _fits(graph: Graph, wire: Wire, recording: Recording) -> bool:
    """Whether a stream is recorded with the type that it has in the graph."""
    return _not_readable(graph.nodes[wire.node], wire, recording, []) is None


class FedParams(Params):
    """Which streams a source plays."""

    file: Path
    """MCAP recording."""
    topics: dict[str, str]
    """Topic of each port; the others are silent."""


def _fed(node: GraphNode, wires: Iterable[Wire], file: Path) -> GraphNode:
    """Return a source in the place of a node, with the same ports and what was recorded of them."""
    kinds = {port.name: port.type for port in node.plugin.spec.outputs}
    yielded: Any = NamedTuple("Ports", list(kinds.items()))  # type: ignore[misc]

    def read(self: Source, clock: Clock) -> Iterator[Any]:
        with Recording(self.params.file) as recording:
            streams = {
                port: recording.stream(name, kinds[port])
                for port, name in self.params.topics.items()
            }
            for blocks in aligned(streams):
                yield yielded(*[blocks.get(port) for port in kinds])

    def constants(self: Source) -> dict[str, StreamConstants]:
        topics = {port: (name, kinds[port]) for port, name in self.params.topics.items()}
        return recorded_constants(self.params.file, topics)

    read.__annotations__["return"] = Iterator[yielded]
    body = {"Params": FedParams, "read": read, "constants": constants}
    made = type("RecordedStreams", (Fed,), body)
    params = FedParams(file=file, topics={wire.port: topic(wire) for wire in wires})
    return GraphNode(node.name, node.use, made, params)


def _limited(node: GraphNode, counts: Sequence[int]) -> GraphNode:
    """Return a source that ends as soon as each port has sent so many messages."""
    plugin: Any = node.plugin

    def read(self: Source, clock: Clock) -> Iterator[Any]:
        intake = Intake(PlanNode(node))  # what it drops was not counted as sent
        left = list(counts)
        for item in plugin.read(self, clock) if any(left) else ():
            blocks = dict(intake.take(item).messages)
            if any(len(block) > left[port] for port, block in blocks.items()):
                last = [b[: left[i]] if (b := blocks.get(i)) else None for i in range(len(left))]
                yield tuple(last) if plugin.spec.step_tuple else last[0]
                return
            for port, block in blocks.items():
                left[port] -= len(block)
            yield item
            if not any(left):
                return

    made: Any = type(plugin.__name__, (plugin,), {"__module__": plugin.__module__})
    made.read = read  # the class is made already: its ports are those of the plugin
    return replace(node, plugin=made)


def _as_far_as_recorded(node: GraphNode, before: Graph | None, recording: Recording) -> GraphNode:
    """Return a source that ends where the recorded run ended; a changed one, or a node, as it is.

    A run may end before its sources do: by Ctrl-C, or by a limit on its duration.
    """
    summary = _summary(recording)
    same = before is not None and before.nodes.get(node.name) == node
    if not node.plugin.spec.is_source or not same or summary is None:
        return node
    sent = summary.get("streams", {})
    wires = [Wire(node.name, port.name) for port in node.plugin.spec.outputs]
    if not all(isinstance(sent.get(str(wire)), int) for wire in wires):
        return node
    return _limited(node, [sent[str(wire)] for wire in wires])


def _notes(
    graph: Graph, before: Graph | None, fed: set[str], recording: Recording
) -> Iterator[str]:
    if before is None:
        return
    for name in graph.nodes:
        if name in fed and name in before.nodes and before.nodes[name] != graph.nodes[name]:
            yield (
                f"'{name}' is not what it was when {recording.path} was recorded, but its streams "
                f"come from there; --from {name} computes them anew"
            )
