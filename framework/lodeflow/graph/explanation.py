"""Explain a value: what is in force, what it means, and who set it."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

from lodeflow.errors import GraphError, did_you_mean
from lodeflow.graph.arguments import ARG
from lodeflow.graph.layers import NODE_KEYS, Layers
from lodeflow.graph.load import resolve_file
from lodeflow.graph.model import Graph, GraphNode
from lodeflow.graph.plugins import doc_of, field_of, names_of, unit
from lodeflow.graph.problems import show


def explain(
    path: str | Path,
    target: str,
    *,
    overlays: Sequence[str | Path] = (),
    sets: Sequence[str] = (),
    swaps: Sequence[str] = (),
    args: Sequence[str] = (),
) -> str:
    """Return the value of a parameter in force, its unit and meaning, and each step that set it.

    Args:
        path: the graph file.
        target: "node.params.x" or "node.x"; also "node.inputs.port" and "node.use".
        overlays: see `load_graph`, as for the others.
        sets: "node.x=1".
        swaps: "node=plugin".
        args: "name=value".

    Raises:
        GraphError: the graph does not check, or has no such value.
    """
    graph, layers = resolve_file(path, overlays, sets, swaps, args)
    node, names = _find(graph, target)
    if names[0] == "params":
        head, meaning, steps = _parameter(node, names[1:])
    else:
        head, meaning, steps = [".".join([node.name, *names])], [], []
    in_force = 0 if steps else None
    for step, sets_it in _ladder(layers, graph, ("nodes", node.name, *names)):
        steps.append(step)
        in_force = len(steps) - 1 if sets_it else (0 if names[0] == "params" else None)
    width = max((len(label) for label, _ in steps), default=0)
    lines = [
        f"  {label:{width}}  {shown}" + ("   <- in force" if at == in_force else "")
        for at, (label, shown) in enumerate(steps)
    ]
    if names[0] != "params":
        lines = lines or ["  not set"]
    return "\n".join([*head, *(f"  {line}" for line in meaning), "", *lines])


def _find(graph: Graph, target: str) -> tuple[GraphNode, list[str]]:
    """Return the node of a target, and the path of the value inside it."""

    def refuse(what: str) -> GraphError:
        return GraphError([f"explain {target}: {what}"])

    words = target.split(".")
    if words[0] == "nodes" and len(words) > 2:
        words = words[1:]
    if len(words) < 2 or not all(words):
        raise refuse("write node.param, such as fuser.gain")
    name, *names = words
    if (node := graph.nodes.get(name)) is None:
        raise refuse(f"no node '{name}'{did_you_mean(name, graph.nodes)}")
    if names[0] not in NODE_KEYS or names == ["params"]:
        names = ["params", *names]
    if names[0] == "params":
        above: list[str] = []
        for word in names[1:]:
            known = names_of(node.plugin.Params, above)
            if word not in known:
                near = did_you_mean(word, known) or f" (it has {', '.join(known) or 'none'})"
                raise refuse(f"no such parameter of '{node.use}'{near}")
            above.append(word)
    return node, names


def _parameter(
    node: GraphNode, names: list[str]
) -> tuple[list[str], list[str], list[tuple[str, str]]]:
    """Return the head line, the meaning, and the default of a parameter."""
    field = field_of(node.plugin.Params, names)
    of = unit(field)
    value: Any = node.params.model_dump()
    for name in names:
        value = value.get(name) if isinstance(value, dict) else None
    symbol = f" {of.symbol}" if of.symbol and value is not None else ""
    head = [f"{node.name}.params.{'.'.join(names)} = {show(value, 1000)}{symbol}"]
    meaning = doc_of(node.plugin.Params, names).splitlines()
    if of.symbol:
        meaning.append(f"Units: {of.quantity()}; a plain number is in {of.symbol}.")
    if field is None or field.is_required():
        return head, meaning, [(f"default of '{node.use}'", "none, it must be given")]
    default = field.get_default(call_default_factory=True, validated_data={})
    shown = show(default.tolist() if hasattr(default, "tolist") else default, 1000)
    return head, meaning, [(f"default of '{node.use}'", shown)]


def _ladder(
    layers: Layers, graph: Graph, path: Sequence[str]
) -> Iterable[tuple[tuple[str, str], bool]]:
    """Yield (place, value) of each layer that touches a value, and whether it sets it."""
    for layer in layers.layers:
        tree = layer.tree
        for depth, name in enumerate(path):
            if name not in tree.entries:
                if tree.value is None and layer.removes and depth:
                    yield (str(tree.place), f"removes {'.'.join(path[:depth])}"), False
                break
            tree = tree.entries[name]
        else:
            if tree.value is None and layer.removes:
                yield (str(tree.place), "null, removes it"), False
                continue
            shown = show(tree.plain(), 1000)
            if isinstance(tree.value, str) and (used := ARG.findall(tree.value)):
                values = layers.merged.find("args")
                told = [
                    f"{name} = {show(arg.plain())} from {arg.place}"
                    for name in used
                    if values and (arg := values.entries.get(name))
                ]
                shown += f" ({', '.join(told)})"
            yield (str(tree.place), shown), True
