"""Plan: a graph made ready to run. Live nodes in order, who reads what, and what is counted."""

from __future__ import annotations

import sys
import traceback
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

from lodeflow.errors import ContractError, MessageError, NodeFailure, did_you_mean
from lodeflow.graph.model import Gate, Graph, GraphNode, Loss, Wire
from lodeflow.graph.topology import order
from lodeflow.messages.cdr import StreamConstants, complete_constants
from lodeflow.messages.message import Message
from lodeflow.node import InputPort, Node, NodeSpec, OutputPort, Source
from lodeflow.sync import NEVER, Each, Sync

RAISED = (Exception, SystemExit)
"""What a plugin may raise and the run reports: also an exit, which is no plugin's to call."""

Tap = Callable[[Message], None]
"""Gets every message of a port, as sample or block, in order; it must not block or write."""


@dataclass
class Counters:
    """What happened at one node.

    Attributes:
        stepped: rows given to the node.
        unmatched: lead rows that found no partner.
        gated: rows that a closed gate held back.
        sent: messages sent, by output port.
        lost: messages that a source dropped, by reason.
    """

    stepped: int = 0
    unmatched: int = 0
    gated: int = 0
    sent: dict[str, int] = field(default_factory=dict)
    lost: dict[Loss, int] = field(default_factory=dict)

    def lose(self, why: Loss, count: int = 1) -> None:
        """Count dropped messages."""
        if count:
            self.lost[why] = self.lost.get(why, 0) + count


class Inlet(Source):
    """Base of the stand-ins for nodes that run in another group; nobody reads them."""


class Change(NamedTuple):
    """From a stamp on, a node is another one: rows from `t` go to a fresh instance.

    Attributes:
        t: stamp, ns.
        node: the node from then on.
        plugin: its instance, started; None to make one when it is due.
    """

    t: int
    node: GraphNode
    plugin: Node | None = None


class PlanNode:
    """One node of a plan: the live plugin, its wired inputs and its counters.

    Attributes:
        changes: what it is to become, in the order of their stamps.
        gaps: stamps, [begin, end), that it is not to get of a stream, by the stream's name.
    """

    def __init__(self, graph_node: GraphNode) -> None:
        self.name = graph_node.name
        self.kind = graph_node.plugin
        self.wires: dict[str, Wire] = dict(graph_node.inputs)
        try:
            self.plugin: Node | Source = graph_node.plugin(graph_node.params, name=graph_node.name)
        except RAISED as error:
            raise self.failure("__init__", NEVER, error) from error
        self.spec: NodeSpec = graph_node.plugin.spec
        self.gates: tuple[Gate, ...] = graph_node.gates
        self.allow = graph_node.allow
        self.counters = Counters(sent={port.name: 0 for port in self.spec.outputs})
        self.lookback = 0
        if isinstance(self.plugin, Node):
            self.lookback = self.plugin.lookback
        self.changes: deque[Change] = deque()
        self.gaps: dict[str, list[tuple[int, int]]] = {}

    def change(self) -> None:
        """Become what the next change says.

        Raises:
            NodeFailure: the new plugin raised while it started.
        """
        change = self.changes.popleft()
        self.kind = change.node.plugin
        plugin: Any = change.plugin
        try:
            if plugin is None:
                plugin = change.node.plugin(change.node.params, name=self.name)
                plugin.start()
        except RAISED as error:
            raise self.failure("start", change.t, error) from error
        self.plugin, self.spec = plugin, change.node.plugin.spec

    @property
    def wired(self) -> list[InputPort]:
        """Input ports that have a wire, in the order of the step's arguments."""
        return [port for port in self.spec.inputs if port.name in self.wires]

    @property
    def sync(self) -> Sync | None:
        """How the wired inputs meet; None where only one is wired and every row is its own."""
        sync = self.spec.sync
        if len(self.wired) == 1 and not isinstance(sync, Each):
            return None
        return sync

    @property
    def lead(self) -> str:
        """Name of the input whose rows the node follows."""
        named: str | None = getattr(self.spec.sync, "lead", None)
        return named if named is not None else self.wired[0].name

    def promises_freely(self, port: OutputPort) -> bool:
        """Whether the port's bound may follow the inputs' bounds, beyond the rows stepped."""
        return port.by_step and not port.by_finish and not self.lookback

    def bound_after(self, port: OutputPort, row: int) -> int:
        """Return the bound that a stepped row gives a port that does not promise freely."""
        # Last words may still carry the stamp of the last row.
        return row - self.lookback + (0 if port.by_finish else 1)

    def failure(self, what: str, t: Any, error: BaseException) -> NodeFailure:
        """Return the error to raise when the plugin raised: node, stamp, inputs, and cause."""
        inputs = ", ".join(f"{port}={wire}" for port, wire in self.wires.items())
        when = "before its first message" if t == NEVER else f"at t={t}"
        failure = NodeFailure(
            f"node '{self.name}' ({self.kind.__name__}.{what}) failed {when}"
            f"{f' on {inputs}' if inputs else ''}: {type(error).__name__}: {error}"
            f"{_place(self.kind, error)}"
        )
        failure.__cause__ = error
        return failure

    def broken(self, port: str, rule: str) -> ContractError:
        """Return the error to raise when the node broke a rule of event time."""
        return ContractError(
            f"node '{self.name}' ({self.kind.__name__}) broke the contract of port '{port}': {rule}"
        )


def _place(kind: type, error: BaseException) -> str:
    """Return where in the plugin's own file an error arose, as " (file:line)"."""
    file = getattr(sys.modules.get(kind.__module__), "__file__", None)
    lines = [
        number
        for frame, number in traceback.walk_tb(error.__traceback__)
        if frame.f_code.co_filename == file
    ]
    return f" ({Path(file).name}:{lines[-1]})" if file and lines else ""


class Plan:
    """A graph with live nodes, ready for a driver.

    Attributes:
        graph: the description.
        nodes: in an order in which each comes after those it reads from (delayed inputs aside).
        taps: who else gets the messages of a port.
    """

    def __init__(self, graph: Graph) -> None:
        self.graph = graph
        names, left = order(graph.nodes)
        if left:
            raise ContractError(f"nodes on a cycle that no delayed Hold closes: {', '.join(left)}")
        self.nodes = {name: PlanNode(graph.nodes[name]) for name in names}
        self.taps: dict[Wire, list[Tap]] = {wire: [] for wire in graph.streams()}

    @property
    def mine(self) -> list[PlanNode]:
        """The nodes that run here, not the stand-ins for others, in the order of the file."""
        nodes = [self.nodes[name] for name in self.graph.nodes]
        return [node for node in nodes if not isinstance(node.plugin, Inlet)]

    @property
    def sources(self) -> list[PlanNode]:
        """The source nodes that run here, in the order of the file."""
        return [node for node in self.mine if node.spec.is_source]

    @property
    def lossless(self) -> bool:
        """Whether no source lost a message that the graph does not allow to lose."""
        return not any(
            count and why not in node.allow
            for node in self.sources
            for why, count in node.counters.lost.items()
        )

    def constants(self) -> dict[Wire, StreamConstants]:
        """Return what sources say does not change within their streams.

        Raises:
            NodeFailure: a source raised.
            ContractError: it named another port, or a member that there is not.
        """
        return {
            Wire(node.name, port): constants
            for node in self.sources
            for port, constants in _constants(node).items()
        }

    def tap(self, wire: Wire, tap: Tap) -> None:
        """Let `tap` have every message of a port, from the start of the run on."""
        self.taps[wire].append(tap)

    def start(self) -> None:
        """Give every node a fresh state."""
        for node in self.nodes.values():
            try:
                node.plugin.start()
            except RAISED as error:
                raise node.failure("start", NEVER, error) from error


def _constants(node: PlanNode) -> dict[str, StreamConstants]:
    source: Any = node.plugin
    try:
        given = dict(source.constants())
    except RAISED as error:
        raise node.failure("constants", NEVER, error) from error
    kinds = {port.name: port.type for port in node.spec.outputs}
    found = {}
    for port, constants in given.items():
        try:
            found[port] = complete_constants(kinds[port], constants)
        except KeyError:
            near = did_you_mean(port, kinds)
            raise node.broken(port, f"constants of a port that there is not{near}") from None
        except MessageError as error:
            raise node.broken(port, f"constants: {error}") from error
    return found


def check_output(node: PlanNode, port: OutputPort, message: Any) -> None:
    """Look at an output in full: its type, shapes and form.

    Raises:
        ContractError: it is not what the port declares.
    """
    if type(message) is not port.type:
        raise node.broken(
            port.name, f"it must send {port.type.__name__}, got {type(message).__name__}"
        )
    try:
        message.validate()
    except Exception as error:
        raise node.broken(port.name, str(error)) from error


def check_sample(
    node: PlanNode, port: OutputPort, message: Any, earliest: int, *, thorough: bool
) -> None:
    """Look at what a sample step sent: type, form, and stamp against its row.

    Raises:
        ContractError: the rule that it broke.
    """
    if thorough or type(message) is not port.type or type(message.t) is not int:
        check_output(node, port, message)
        if message.is_block:
            raise node.broken(port.name, "a sample step must send samples, got a block")
    if message.t < earliest:
        raise node.broken(
            port.name,
            f"stamp {message.t} lies before its row minus the lookback of {node.lookback} ns",
        )


def last_words(node: PlanNode, outputs: Sequence[Any], last_row: int) -> list[tuple[Any, Any]]:
    """Let a node finish; return what it sends as (output, block) pairs, looked at in full.

    Raises:
        NodeFailure: `finish` raised.
        ContractError: it returned something else than its ports.
    """
    finish = getattr(node.plugin, "finish", None)
    try:
        returned = None if finish is None else finish()
    except RAISED as error:
        raise node.failure("finish", last_row, error) from error
    if returned is None:
        return []
    by_name = {output.port.name: output for output in outputs if output.port.by_finish}
    if isinstance(returned, Message) and len(by_name) == 1:
        pairs = [(*by_name.values(), returned)]
    elif hasattr(returned, "_fields") and set(returned._fields) <= set(by_name):
        named = zip(returned._fields, returned, strict=True)
        pairs = [(by_name[name], message) for name, message in named if message is not None]
    else:
        raise node.broken(", ".join(by_name) or "(none)", f"finish returned {returned!r}")
    for output, message in pairs:
        check_output(node, output.port, message)
    return [(output, m if m.is_block else m.as_block()) for output, m in pairs]
