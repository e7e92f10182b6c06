"""Drawings of a graph: a listing for the terminal, Mermaid, and Graphviz dot."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Literal, get_args

from lodeflow.graph.model import Gate, Graph, GraphNode, Wire
from lodeflow.graph.topology import Edge, edges, order
from lodeflow.node import SINGLE_PORT
from lodeflow.sync import describe

Format = Literal["text", "mermaid", "dot"]


def draw(
    graph: Graph,
    format: Format = "text",  # noqa: A002 - the option is called so
    notes: Mapping[str, str] = MappingProxyType({}),
) -> str:
    """Return a drawing of a graph.

    Args:
        graph: the graph.
        format: "text", nodes in the order in which they run, with ports, types, syncs and gates;
            "mermaid", for Markdown; "dot", for Graphviz.
        notes: what is said of streams beside their types, by "node" or "node.port".

    Raises:
        ValueError: no such format.
    """
    drawings: dict[str, Callable[[Graph, Mapping[str, str]], str]] = {
        "text": _text,
        "mermaid": _mermaid,
        "dot": _dot,
    }
    if format not in drawings:
        raise ValueError(f"format {format!r} is none of {', '.join(get_args(Format))}")
    return drawings[format](graph, notes)


def _text(graph: Graph, notes: Mapping[str, str]) -> str:
    count = sum(1 for _ in graph.streams())
    lines = [f"{graph.name}: {_plural(len(graph.nodes), 'node')}, {_plural(count, 'stream')}"]
    groups = {node: group for group, it in graph.processes.items() for node in it.nodes}
    width = max((len(name) for name in graph.nodes), default=0)
    done, left = order(graph.nodes)
    for name in [*done, *left]:
        node = graph.nodes[name]
        spec = node.plugin.spec
        how = "source" if spec.is_source else describe(spec.sync) if spec.sync else ""
        group = f"in process {groups[name]}" if name in groups else ""
        head = ", ".join(part for part in (how, group) if part)
        lines += ["", f"{name:{width}}  {node.use}" + (f"  ({head})" if head else "")]
        rows = _rows(graph, node, notes)
        for at, row in enumerate(rows):
            lines.append(f"{'└' if at == len(rows) - 1 else '├'}─ {row}")
    return "\n".join(lines)


def _rows(graph: Graph, node: GraphNode, notes: Mapping[str, str]) -> list[str]:
    """Return one line per input, gate and output of a node."""
    spec = node.plugin.spec
    delayed = {edge.port for edge in edges(graph.nodes) if edge.to == node.name and edge.delayed}
    ports = [(port.name, port.type.__name__) for port in spec.inputs]
    ports += [("" if p.name == SINGLE_PORT else p.name, p.type.__name__) for p in spec.outputs]
    name_width = max(len(name) for name, _ in ports)
    kind_width = max(len(kind) for _, kind in ports)
    rows = []
    for port, (name, kind) in zip(spec.inputs, ports, strict=False):
        wire = node.inputs.get(port.name)
        source = f"← {wire}" if wire else "  not wired"
        late = "  (delayed)" if port.name in delayed else ""
        head = f"{name:{name_width}}  {kind:{kind_width}}"
        rows.append(f"in   {head}  {source}{late}")
    rows += [f"when {gate.wire} is {' or '.join(_names(graph, gate))}" for gate in node.gates]
    for output, (name, kind) in zip(spec.outputs, ports[len(spec.inputs) :], strict=True):
        wire = Wire(node.name, output.name)
        kept = "  recorded" if _is_recorded(graph, wire) else ""
        end = "  at the end" if output.by_finish and not output.by_step else ""
        head = f"{name:{name_width}}  {kind:{kind_width}}"
        note = f"  {notes[str(wire)]}" if str(wire) in notes else ""
        rows.append(f"out  {head}{end}{kept}{note}".rstrip())
    if node.allow:
        rows.append(f"may lose: {', '.join(sorted(node.allow))}")
    return rows


def _mermaid(graph: Graph, notes: Mapping[str, str]) -> str:
    """Node ids get a prefix: some words, such as `end`, mean something to Mermaid."""
    lines = ["flowchart LR"]

    def box(node: GraphNode, indent: str) -> str:
        label = f"<b>{_entities(node.name)}</b><br/>{_entities(node.use)}"
        opening, closing = ("([", "])") if node.plugin.spec.is_source else ("[", "]")
        return f'{indent}n_{node.name}{opening}"{label}"{closing}'

    grouped = {name for group in graph.processes.values() for name in group.nodes}
    for group, members in graph.processes.items():
        lines.append(f'  subgraph g_{group}["{_entities(group)}"]')
        lines += [box(graph.nodes[name], "    ") for name in members.nodes]
        lines.append("  end")
    lines += [box(node, "  ") for name, node in graph.nodes.items() if name not in grouped]
    for edge in edges(graph.nodes):
        arrow = "-->" if edge.port is not None and not edge.delayed else "-.->"
        label = _entities(_label(graph, edge))
        if str(edge.wire) in notes:
            label += f"<br/>{_entities(notes[str(edge.wire)])}"
        lines.append(f'  n_{edge.wire.node} {arrow}|"{label}"| n_{edge.to}')
    return "\n".join(lines)


def _dot(graph: Graph, notes: Mapping[str, str]) -> str:
    lines = [f"digraph {_quoted(graph.name)} {{", "  rankdir=LR;", "  node [shape=box];"]

    def box(node: GraphNode, indent: str) -> str:
        style = ", style=rounded" if node.plugin.spec.is_source else ""
        return f"{indent}{_quoted(node.name)} [label={_quoted(node.name, node.use)}{style}];"

    grouped = {name for group in graph.processes.values() for name in group.nodes}
    for group, members in graph.processes.items():
        lines.append(f"  subgraph {_quoted('cluster_' + group)} {{")
        lines.append(f"    label={_quoted(group)};")
        lines += [box(graph.nodes[name], "    ") for name in members.nodes]
        lines.append("  }")
    lines += [box(node, "  ") for name, node in graph.nodes.items() if name not in grouped]
    for edge in edges(graph.nodes):
        style = "" if edge.port is not None and not edge.delayed else ", style=dashed"
        ends = f"{_quoted(edge.wire.node)} -> {_quoted(edge.to)}"
        note = [notes[str(edge.wire)]] if str(edge.wire) in notes else []
        lines.append(f"  {ends} [label={_quoted(_label(graph, edge), *note)}{style}];")
    return "\n".join([*lines, "}"])


def _label(graph: Graph, edge: Edge) -> str:
    """Return what an edge carries and where it enters."""
    if edge.port is None:
        gates = graph.nodes[edge.to].gates
        return " and ".join(
            f"when {' or '.join(_names(graph, gate))}" for gate in gates if gate.wire == edge.wire
        )
    output = graph.nodes[edge.wire.node].plugin.spec.output(edge.wire.port)
    kind = output.type.__name__ if output else ""
    return f"{edge.port}: {kind}{', delayed' if edge.delayed else ''}"


def _names(graph: Graph, gate: Gate) -> list[str]:
    output = graph.nodes[gate.wire.node].plugin.spec.output(gate.wire.port)
    constants = output.type.constants if output else {}
    return [name.lower() for name, value in constants.items() if value in gate.allowed]


def _is_recorded(graph: Graph, wire: Wire) -> bool:
    if graph.record is None:
        return False
    return graph.record.streams is None or wire in graph.record.streams


def _plural(count: int, noun: str) -> str:
    return f"{count} {noun}{'' if count == 1 else 's'}"


def _entities(text: str) -> str:
    """Escape a text for a quoted Mermaid label, which knows entities written #NAME; only."""
    named = {"#": "#35;", '"': "#quot;", "<": "#lt;", ">": "#gt;", "&": "#amp;"}
    return "".join(named.get(char, char) for char in text)


def _quoted(*lines: str) -> str:
    """Return a quoted dot text."""
    escaped = [line.replace("\\", "\\\\").replace('"', '\\"') for line in lines]
    return '"' + "\\n".join(escaped) + '"'
