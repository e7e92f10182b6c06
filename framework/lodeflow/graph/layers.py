"""The one order of overrides: plugin default < graph < --with < --swap and --set; and --arg.

Every override is a layer, a partial graph. Mappings merge, lists and scalars replace, and null in
an overlay removes what it stands for.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from lodeflow.errors import NodeError, did_you_mean
from lodeflow.graph.plugins import load_plugin
from lodeflow.graph.problems import Origin, Place, Problems, join, show
from lodeflow.graph.tree import Tree, parse

FIRST_OPTION = 1000
"""Rank of the first option; files come before."""
NODE_KEYS = ("use", "params", "inputs", "when", "allow")


@dataclass(frozen=True)
class Layer:
    """One step in the order of overrides.

    Attributes:
        tree: a partial graph.
        removes: null removes the entry (an overlay) and is not a value (`--set`).
    """

    tree: Tree
    removes: bool = False


@dataclass(frozen=True)
class Layers:
    """A graph file and all that changes it.

    Attributes:
        layers: in the order in which they apply.
        merged: the outcome; args are not yet filled in.
        notes: what a user should know although it is no mistake.
    """

    layers: tuple[Layer, ...]
    merged: Tree
    notes: tuple[str, ...]


def override(
    base: Tree,
    overlays: Sequence[Tree],
    sets: Sequence[str],
    swaps: Sequence[str],
    args: Sequence[str],
    problems: Problems,
) -> Layers:
    """Apply overlays, then swaps, then sets, then args to a graph file."""
    layers, notes = [Layer(base)], []
    merged = base
    for overlay in overlays:
        layers.append(Layer(overlay, removes=True))
        merged = merge(merged, overlay, "", problems, removes=True)
    rank = FIRST_OPTION
    for option in swaps:
        rank += 1
        if swapped := _swap(merged, option, _origin("--swap", option, rank), problems):
            merged, layer, dropped = swapped
            layers.append(layer)
            notes += dropped
    for kind, options, read in (("--set", sets, _set), ("--arg", args, _arg)):
        for option in options:
            rank += 1
            if tree := read(merged, option, _origin(kind, option, rank), problems):
                layers.append(Layer(tree))
                merged = merge(merged, tree, "", problems, removes=False)
    return Layers(tuple(layers), merged, tuple(notes))


def _origin(kind: str, option: str, rank: int) -> Origin:
    shown = option.encode("utf-8", "replace").decode()  # an argument may hold undecodable bytes
    return Origin(f"{kind} {' '.join(shown.split())}", rank)


def merge(base: Tree, over: Tree, path: str, problems: Problems, *, removes: bool = False) -> Tree:
    """Return one tree laid over another; `removes` tells whether null removes what it is over."""
    if not isinstance(base.value, dict) or not isinstance(over.value, dict):
        return over
    merged = dict(base.value)
    for name, value in over.value.items():
        here = join(path, name)
        if removes and value.value is None and path != "args":
            if merged.pop(name, None) is None:
                near = did_you_mean(name, base.value)
                problems.add(value.name_place, here, f"null removes, but nothing is here{near}")
        elif name in merged:
            merged[name] = merge(merged[name], value, here, problems, removes=removes)
        else:
            merged[name] = value
    return replace(base, value=merged)


def _nested(origin: Origin, names: Sequence[str], value: Tree) -> Tree:
    place = Place(origin)
    tree = replace(value, key=place)
    for name in reversed(names):
        tree = Tree({name: tree}, place, place)
    return tree


def _read(option: str, origin: Origin, usage: str, problems: Problems) -> tuple[str, Tree] | None:
    """Split NAME=VALUE and read the value as YAML."""
    target, equals, text = option.partition("=")
    if not target or not text.strip():
        what = "has no value (write '' for an empty text, or null)" if equals else "has no '='"
        problems.add(Place(origin), "", f"{what}; write {usage}")
        return None
    value = parse(text, origin, problems)
    return None if value is None else (target.strip(), value)


def _no_node(name: str, merged: Tree, origin: Origin, problems: Problems) -> bool:
    nodes = merged.find("nodes")
    known = nodes.entries if nodes else {}
    if name in known:
        return False
    problems.add(Place(origin), "", f"no node {show(name)}{did_you_mean(name, known)}")
    return True


def _set(merged: Tree, option: str, origin: Origin, problems: Problems) -> Tree | None:
    usage = "--set node.param=value"
    if (pair := _read(option, origin, usage, problems)) is None:
        return None
    node, *names = pair[0].split(".")
    if not names or not all((node, *names)):
        problems.add(Place(origin), "", f"names no parameter; write {usage}")
        return None
    if _no_node(node, merged, origin, problems):
        return None
    if names == ["use"]:
        problems.add(Place(origin), "", f"write --swap {node}=plugin")
        return None
    if names[0] not in NODE_KEYS or len(names) == 1:
        names = ["params", *names]
    return _nested(origin, ["nodes", node, *names], pair[1])


def read_setting(option: str, rank: int, problems: Problems) -> Tree | None:
    """Return the tree of an option "name=value" or "group.name=value" for parameters alone."""
    origin = _origin("--set", option, rank)
    if (pair := _read(option, origin, "--set name=value", problems)) is None:
        return None
    names = pair[0].split(".")
    if not all(names):
        problems.add(Place(origin), "", "names no parameter; write --set name=value")
        return None
    return _nested(origin, names, pair[1])


def _arg(merged: Tree, option: str, origin: Origin, problems: Problems) -> Tree | None:
    if (pair := _read(option, origin, "--arg name=value", problems)) is None:
        return None
    name, value = pair
    args = merged.find("args")
    known = args.entries if args else {}
    if name not in known:
        has = f" (args: {', '.join(known)})" if known else " (the graph has none)"
        near = did_you_mean(name, known)
        problems.add(Place(origin), "", f"no arg {show(name)}{near}{has}")
        return None
    return _nested(origin, ["args", name], value)


def _swap(
    merged: Tree, option: str, origin: Origin, problems: Problems
) -> tuple[Tree, Layer, list[str]] | None:
    """Return the graph with another plugin, keeping those params that it has too."""
    node, _, use = (part.strip() for part in option.partition("="))
    if not node or not use:
        problems.add(Place(origin), "", "names no plugin; write --swap node=plugin")
        return None
    if _no_node(node, merged, origin, problems):
        return None
    try:
        plugin = load_plugin(use)
    except NodeError as error:
        problems.add(Place(origin), join("nodes", node, "use"), str(error))
        return None
    named = Tree(use, Place(origin), Place(origin))
    merged = put(merged, ("nodes", node, "use"), named)
    dropped = []
    params = merged.find("nodes", node, "params")
    if params is not None and isinstance(params.value, dict):
        kept: dict[str, Tree] = {}
        for name, value in params.value.items():
            if name in plugin.Params.model_fields:
                kept[name] = replace(value, note=f"kept by {origin.label}")
            else:
                has = f"'{use}' has no parameter '{name}'"
                dropped.append(f"{origin.label}: {has}, dropped ({value.place})")
        merged = put(merged, ("nodes", node, "params"), replace(params, value=kept))
    return merged, Layer(_nested(origin, ["nodes", node, "use"], named)), dropped


def put(tree: Tree, names: Sequence[str], value: Tree) -> Tree:
    """Return the tree with another value under a chain of keys."""
    if not names:
        return value
    name, *rest = names
    below = tree.entries.get(name, value)
    return replace(tree, value={**tree.entries, name: put(below, rest, value)})
