"""Wires, gates and cycles: who sends what to whom, and what is wrong with it."""

from __future__ import annotations

import re
from collections.abc import Mapping

from lodeflow.errors import did_you_mean
from lodeflow.graph import topology
from lodeflow.graph.keyed import read_key
from lodeflow.graph.model import Gate, GraphNode, Wire
from lodeflow.graph.plugins import Plugin
from lodeflow.graph.problems import Place, Problems, join, show
from lodeflow.graph.tree import Tree
from lodeflow.messages.message import Message
from lodeflow.node import SINGLE_PORT, InputPort, NodeSpec, OutputPort

_WIRE = re.compile(r"([a-z][a-z0-9_]*)(?:\.([A-Za-z_]\w*))?", re.ASCII)


class Wiring:
    """Resolves what a graph says of streams.

    Args:
        plugins: class of each node, None where it is not known (its ports are not judged then).
        problems: where problems are added.

    Attributes:
        keyed: sources that inputs from Zenoh keys ask for, by name, with the node that reads each.
    """

    def __init__(self, plugins: Mapping[str, Plugin | None], problems: Problems) -> None:
        self._plugins = plugins
        self._problems = problems
        self._written: dict[tuple[str, str | None, Wire], tuple[Place, str]] = {}
        self.keyed: dict[str, tuple[str, GraphNode]] = {}

    def inputs(self, name: str, tree: Tree | None, owner: Place) -> dict[str, Wire]:
        """Return the wires of a node's inputs.

        Args:
            name: the node.
            tree: its `inputs`; None for none.
            owner: place of the node's name.
        """
        path = join("nodes", name, "inputs")
        given = tree.entries if tree else {}
        if tree is not None and tree.value is not None and not isinstance(tree.value, dict):
            what = f"should be a mapping of ports to streams, got {show(tree.plain())}"
            tree.refuse(self._problems, path, what)
            return {}
        plugin = self._plugins[name]
        if plugin is not None and plugin.spec.is_source:
            if given and tree:
                what = f"{plugin.__name__} is a source, it has no inputs; remove them"
                self._problems.add(tree.name_place, path, what)
            return {}
        owned = plugin.__name__ if plugin else ""
        ports = {port.name: port for port in plugin.spec.inputs} if plugin else {}
        wires, guessed = {}, ""
        for port, value in given.items():
            if plugin is not None and port not in ports:
                near = did_you_mean(port, ports)
                guessed += near
                has = "" if near else f" (inputs: {_ports(plugin.spec.inputs)})"
                what = f"no such input of {plugin.__name__}{near}{has}"
                self._problems.add(value.name_place, join(path, port), what)
            elif wire := self._input(name, value, join(path, port), ports.get(port)):
                wires[port] = wire
                self._written[name, port, wire] = value.place, join(path, port)
        for port, declared in ports.items():
            if port not in given and not declared.optional and f"'{port}'" not in guessed:
                what = f"not wired; {owned} expects {declared.type.__name__}"
                place = tree.name_place if tree and tree.value is not None else owner
                what += f". {self._senders(declared.type, name)}"
                self._problems.add(place, join(path, port), what)
        return wires

    def _input(self, name: str, value: Tree, path: str, port: InputPort | None) -> Wire | None:
        if isinstance(value.value, dict):
            return self._from_key(name, value, path, port) if port else None
        found = self._stream(value, path, port.type if port else None, but=name)
        if found is None:
            return None
        wire, output = found
        if port and not issubclass(output.type, port.type):
            plugin = self._plugins[name]
            what = (
                f"{plugin.__name__ if plugin else name} expects {port.type.__name__}, but "
                f"'{value.value}' sends {output.type.__name__}. {self._senders(port.type, name)}"
            )
            value.refuse(self._problems, path, what)
            return None
        return wire

    def _from_key(self, name: str, value: Tree, path: str, port: InputPort) -> Wire | None:
        source = f"{name}_{port.name}"
        while source in self._plugins or source in self.keyed:
            source += "_key"
        node = read_key(source, value, path, port.type, self._problems)
        if node is None:
            return None
        self.keyed[source] = name, node
        return Wire(source, SINGLE_PORT)

    def gates(self, name: str, tree: Tree | None) -> tuple[Gate, ...]:
        """Return the conditions of a node, its `when`."""
        path = join("nodes", name, "when")
        if tree is None or tree.value is None:
            return ()
        if not isinstance(tree.value, dict):
            what = f"should be a mapping of streams to lists of names, got {show(tree.plain())}"
            tree.refuse(self._problems, path, what)
            return ()
        plugin = self._plugins[name]
        if plugin is not None and plugin.spec.is_source:
            what = f"{plugin.__name__} is a source, it has no rows to hold back; gate its receivers"
            self._problems.add(tree.name_place, path, what)
            return ()
        gates = [self._gate(name, stream, value, path) for stream, value in tree.value.items()]
        return tuple(gate for gate in gates if gate)

    def _gate(self, name: str, stream: str, value: Tree, path: str) -> Gate | None:
        path = join(path, stream)
        key = Tree(stream, value.name_place)
        found = self._stream(key, path, None, but=name)
        names = [item.value for item in value.items]
        if not names or not all(isinstance(item, str) for item in names):
            what = f"should be a list of names at which rows pass, got {show(value.plain())}"
            value.refuse(self._problems, path, what)
            return None
        if found is None:
            return None
        wire, output = found
        fields = [field.name for field in output.type.fields if field.integer]
        if len(fields) != 1 or not output.type.constants:
            what = (
                f"'{stream}' sends {output.type.__name__}, which has no named values; a gate needs "
                "a message with constants and one integer field, such as Mode"
            )
            key.refuse(self._problems, path, what)
            return None
        known = {constant.lower(): number for constant, number in output.type.constants.items()}
        for item in value.items:
            if item.value not in known:
                near = did_you_mean(str(item.value), known)
                what = f"{output.type.__name__} has no value {show(item.value)}{near}"
                has = "" if near else f" (values: {', '.join(known)})"
                item.refuse(self._problems, path, what + has)
        if not known.keys() >= set(names):
            return None
        self._written[name, None, wire] = key.place, path
        return Gate(wire, fields[0], frozenset(known[str(item)] for item in names))

    def recorded(self, value: Tree, path: str) -> list[Wire]:
        """Return the streams that an item of `record.streams` names; a node means all of its."""
        plugin = self._plugins.get(str(value.value))
        if plugin is not None and plugin.spec.outputs:
            return [Wire(str(value.value), port.name) for port in plugin.spec.outputs]
        found = self._stream(value, path, None, but="")
        return [found[0]] if found else []

    def cycles(self, nodes: Mapping[str, GraphNode]) -> None:
        """Add a problem for each set of nodes that wait for each other; none could ever step."""
        closes = "an input held with delay: sync = Hold(lead, initial={...}, delay=True)"
        for loop in topology.loops(nodes):
            closing = loop[-1]
            ring = " -> ".join([*(edge.wire.node for edge in loop), closing.to])
            what = (
                f"a cycle, {ring}, in which each waits for the one before; it can be closed by "
                if len(loop) > 1
                else f"'{closing.to}' waits for its own output; it can be fed back to "
            ) + closes
            self._problems.add(*self._written[closing.to, closing.port, closing.wire], what)
        if len(self._problems):
            return
        for members in topology.cycles(nodes):
            closing = next(
                edge
                for edge in topology.edges(nodes)
                if edge.delayed and edge.to in members and edge.wire.node in members
            )
            try:
                found = topology.obstacles(nodes, members)
            except Exception as error:  # it makes a node, whose author may raise anything
                found = [f"one of them cannot be made: {type(error).__name__}: {error}"]
            for why in found:
                what = f"the cycle of {', '.join(sorted(members))} cannot move: {why}"
                self._problems.add(*self._written[closing.to, closing.port, closing.wire], what)

    def _stream(
        self, value: Tree, path: str, kind: type[Message] | None, but: str
    ) -> tuple[Wire, OutputPort] | None:
        """Return the output that a text names; None if it is wrong, or cannot be known."""
        match = _WIRE.fullmatch(value.value) if isinstance(value.value, str) else None
        if match is None:
            what = f"should be a stream, written node or node.port, got {show(value.plain())}"
            value.refuse(self._problems, path, what)
            return None
        node, port = match.groups()
        if node not in self._plugins:
            near = did_you_mean(node, self._plugins)
            value.refuse(self._problems, path, f"no node '{node}'{near}")
            return None
        if (plugin := self._plugins[node]) is None:
            return None
        spec: NodeSpec = plugin.spec
        fits = [output.name for output in spec.outputs if kind and issubclass(output.type, kind)]
        listed = f"(outputs: {_ports(spec.outputs)})"
        if not spec.outputs:
            what = f"'{node}' has no output, {plugin.__name__} is a sink"
            more = f". {self._senders(kind, but)}" if kind else ""
            value.refuse(self._problems, path, what + more)
            return None
        if port is None and len(spec.outputs) > 1:
            wanted = fits[0] if len(fits) == 1 else "port"
            what = f"'{node}' has several outputs; write {node}.{wanted} {listed}"
            value.refuse(self._problems, path, what)
            return None
        output = spec.outputs[0] if port is None else spec.output(port)
        if output is None:
            near = did_you_mean(port, [output.name for output in spec.outputs])
            value.refuse(self._problems, path, f"'{node}' has no output '{port}'{near} {listed}")
            return None
        return Wire(node, output.name), output

    def _senders(self, kind: type[Message], but: str) -> str:
        fitting = [
            str(Wire(node, port.name))
            for node, plugin in self._plugins.items()
            if plugin is not None and node != but
            for port in plugin.spec.outputs
            if issubclass(port.type, kind)
        ]
        if not fitting:
            return f"No node sends {kind.__name__}."
        return f"Nodes that send {kind.__name__}: {', '.join(fitting)}."


def _ports(ports: tuple[InputPort, ...] | tuple[OutputPort, ...]) -> str:
    return ", ".join(f"{port.name}: {port.type.__name__}" for port in ports)
