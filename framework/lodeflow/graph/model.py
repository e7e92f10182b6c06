"""Graph: the checked description of nodes, wires and parameters. It holds no live object."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any, Literal, NamedTuple

from lodeflow.node import SINGLE_PORT, Node, Source
from lodeflow.params import Params

Loss = Literal["nonfinite", "disorder", "late", "overflow", "gap", "undecodable"]
"""Why a sample of a source is missing: NaN or infinite; a stamp that repeats or goes back; later
than `max_delay`; more than its inbox holds; from a key, it did not arrive, or was no record."""


class Wire(NamedTuple):
    """An output port: where an input gets its messages from."""

    node: str
    port: str

    def __str__(self) -> str:
        return self.node if self.port == SINGLE_PORT else f"{self.node}.{self.port}"


@dataclass(frozen=True)
class Gate:
    """A condition on a row: the last value of `wire` at the row's stamp is one of `allowed`.

    Attributes:
        wire: stream of a message type with exactly one field with named constants.
        field: that field.
        allowed: values that let a row pass.
    """

    wire: Wire
    field: str
    allowed: frozenset[int]


@dataclass(frozen=True)
class GraphNode:
    """One node of a graph.

    Attributes:
        name: unique in the graph.
        use: plugin name, or "module:Class".
        plugin: the class.
        params: checked parameters.
        inputs: wire of each input port; optional ports may be absent.
        gates: conditions that must all hold for a row to be stepped.
        allow: losses of a source that do not fail the run.
        keys: further Zenoh keys of its outputs, by port.
    """

    name: str
    use: str
    plugin: type[Node] | type[Source]
    params: Params
    inputs: Mapping[str, Wire] = field(default_factory=dict)
    gates: tuple[Gate, ...] = ()
    allow: frozenset[Loss] = frozenset()
    keys: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class Record:
    """What is recorded, and where to.

    Attributes:
        to: path with {name}, {start} and {args} fields filled in when the run starts.
        streams: wires to record, or None for all of them.
    """

    to: str
    streams: tuple[Wire, ...] | None = None


Restart = Literal["never", "on-failure", "always"]
"""When the process of a group is started again after it has ended before its data."""
OnCrash = Literal["stop", "continue"]
"""What the other groups do once a group is gone for good."""


@dataclass(frozen=True)
class Group:
    """Nodes that run in one process, and what happens when it crashes.

    Attributes:
        nodes: their names.
        restart: when its process is started again; it begins anew, without its state.
        limit: starts again within a run, at most.
        on_crash: what the others do when it is not started again.
        allow_gaps: a crash of this group does not fail the run.
        latest: it only watches: what comes while it is behind is not kept for it, but counted.
    """

    nodes: tuple[str, ...]
    restart: Restart = "never"
    limit: int = 5
    on_crash: OnCrash = "stop"
    allow_gaps: bool = False
    latest: bool = False


@dataclass(frozen=True)
class Graph:
    """A checked graph.

    Attributes:
        name: name of the graph, part of every key and file name.
        nodes: by name, in the order of the file.
        record: what is recorded by default; None for nothing.
        processes: the process groups; empty for one process.
        args: the arguments with the values in force.
        document: the resolved file as plain data: what a run needs to be repeated.
        files: texts of the calibration files that values come from, by path.
        notes: what to tell the user although it is no mistake (params that a swap dropped).
    """

    name: str
    nodes: Mapping[str, GraphNode]
    record: Record | None = None
    processes: Mapping[str, Group] = field(default_factory=dict)
    args: Mapping[str, Any] = field(default_factory=dict)
    document: Mapping[str, Any] = field(default_factory=dict)
    files: Mapping[str, str] = field(default_factory=dict, compare=False)
    notes: tuple[str, ...] = field(default=(), compare=False)

    def streams(self) -> Iterator[Wire]:
        """Yield every output port, in the order of the nodes."""
        for node in self.nodes.values():
            for port in node.plugin.spec.outputs:
                yield Wire(node.name, port.name)
