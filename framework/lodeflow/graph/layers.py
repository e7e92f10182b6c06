"""The one order of overrides: plugin default < graph < --with < --swap and --set; and --arg.

Every override is a layer, a partial graph. Mappings merge, lists and scalars replace, and null in
an overlay removes what it stands for.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

from lodeflow.errors import NodeError, did_you_mean
from lodeflow.graph.plugins import load_plugin
from lodeflow.graph.problems import Origin, Place, Problems, join, show
from lodeflow.graph.tree import Tree, parse

FIRST_OPTION = 1000
"""Rank of the first option; files come before."""
NODE_KEYS = ("use", "params", "inputs", "when", "allow", "keys")


Kind = Literal["swap", "set", "arg"]
_USAGE: dict[Kind, str] = {
    "swap": "--swap node=plugin",
    "set": "--set node.param=value",
    "arg": "--arg name=value",
}


@dataclass(frozen=True)
class Option:
    """A change to one value of a graph, on the command line or in a study.

    Attributes:
        kind: what is changed.
        target: a node for a swap, "node.param" for a set, or the name of an arg.
        value: the plugin, or the value.
        place: where the target is written.
    """

    kind: Kind
    target: str
    value: Tree
    place: Place


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


def read_options(
    sets: Sequence[str], swaps: Sequence[str], args: Sequence[str], problems: Problems
) -> list[Option]:
    """Return what stands on a command line as options, in the order in which they apply."""
    found, rank = [], FIRST_OPTION
    texts: tuple[tuple[Kind, Sequence[str]], ...] = (("swap", swaps), ("set", sets), ("arg", args))
    for kind, given in texts:
        for text in given:
            rank += 1
            if option := _read(kind, text, _origin(kind, text, rank), problems):
                found.append(option)
    return found


def _origin(kind: Kind, text: str, rank: int) -> Origin:
    shown = text.encode("utf-8", "replace").decode()  # it may hold undecodable bytes
    return Origin(f"--{kind} {' '.join(shown.split())}", rank)


def override(
    base: Tree, overlays: Sequence[Tree], options: Sequence[Option], problems: Problems
) -> Layers:
    """Apply overlays, then swaps, then sets, then args to a graph file."""
    layers, notes = [Layer(base)], []
    merged = base
    for overlay in overlays:
        layers.append(Layer(overlay, removes=True))
        merged = merge(merged, overlay, "", problems, removes=True)
    for option in (option for option in options if option.kind == "swap"):
        if swapped := _swap(merged, option, problems):
            merged, layer, dropped = swapped
            layers.append(layer)
            notes += dropped
    for kind, nested in (("set", _set), ("arg", _arg)):
        for option in (option for option in options if option.kind == kind):
            if tree := nested(merged, option, problems):
                layers.append(Layer(tree))
                merged = merge(merged, tree, "", problems, removes=False)
    return Layers(tuple(layers), merged, tuple(notes))


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


def _nested(option: Option, names: Sequence[str]) -> Tree:
    tree = replace(option.value, key=option.place)
    for name in reversed(names):
        tree = Tree({name: tree}, option.place, option.place)
    return tree


def _read(kind: Kind, text: str, origin: Origin, problems: Problems) -> Option | None:
    """Split NAME=VALUE and read the value as YAML; a plugin is a text as it is."""
    target, equals, written = text.partition("=")
    target, place = target.strip(), Place(origin)
    if kind == "swap":
        if not target or not written.strip():
            problems.add(place, "", f"names no plugin; write {_USAGE[kind]}")
            return None
        return Option(kind, target, Tree(written.strip(), place, place), place)
    if not target or not written.strip():
        what = "has no value (write '' for an empty text, or null)" if equals else "has no '='"
        problems.add(place, "", f"{what}; write {_USAGE[kind]}")
        return None
    value = parse(written, origin, problems)
    return None if value is None else Option(kind, target, value, place)


def _no_node(name: str, merged: Tree, option: Option, problems: Problems) -> bool:
    nodes = merged.find("nodes")
    known = nodes.entries if nodes else {}
    if name in known:
        return False
    problems.add(option.place, "", f"no node {show(name)}{did_you_mean(name, known)}")
    return True


def _set(merged: Tree, option: Option, problems: Problems) -> Tree | None:
    node, *names = option.target.split(".")
    if not names or not all((node, *names)):
        problems.add(option.place, "", f"names no parameter; write {_USAGE['set']}")
        return None
    if _no_node(node, merged, option, problems):
        return None
    if names == ["use"]:
        problems.add(option.place, "", f"write --swap {node}=plugin")
        return None
    if names[0] not in NODE_KEYS or len(names) == 1:
        names = ["params", *names]
    return _nested(option, ["nodes", node, *names])


def read_setting(text: str, rank: int, problems: Problems) -> Tree | None:
    """Return the tree of an option "name=value" or "group.name=value" for parameters alone."""
    option = _read("set", text, _origin("set", text, rank), problems)
    if option is None:
        return None
    names = option.target.split(".")
    if not all(names):
        problems.add(option.place, "", "names no parameter; write --set name=value")
        return None
    return _nested(option, names)


def _arg(merged: Tree, option: Option, problems: Problems) -> Tree | None:
    name = option.target
    args = merged.find("args")
    known = args.entries if args else {}
    if name not in known:
        has = f" (args: {', '.join(known)})" if known else " (the graph has none)"
        near = did_you_mean(name, known)
        problems.add(option.place, "", f"no arg {show(name)}{near}{has}")
        return None
    return _nested(option, ["args", name])


def _swap(merged: Tree, option: Option, problems: Problems) -> tuple[Tree, Layer, list[str]] | None:
    """Return the graph with another plugin, keeping those params that it has too."""
    node, use = option.target, str(option.value.value)
    if _no_node(node, merged, option, problems):
        return None
    try:
        plugin = load_plugin(use)
    except NodeError as error:
        problems.add(option.value.place, join("nodes", node, "use"), str(error))
        return None
    named = replace(option.value, key=option.place)
    merged = put(merged, ("nodes", node, "use"), named)
    dropped = []
    params = merged.find("nodes", node, "params")
    if params is not None and isinstance(params.value, dict):
        kept: dict[str, Tree] = {}
        for name, value in params.value.items():
            if name in plugin.Params.model_fields:
                kept[name] = replace(value, note=f"kept by {option.place}")
            else:
                has = f"'{use}' has no parameter '{name}'"
                dropped.append(f"{option.place}: {has}, dropped ({value.place})")
        merged = put(merged, ("nodes", node, "params"), replace(params, value=kept))
    return merged, Layer(_nested(option, ["nodes", node, "use"])), dropped


def put(tree: Tree, names: Sequence[str], value: Tree) -> Tree:
    """Return the tree with another value under a chain of keys."""
    if not names:
        return value
    name, *rest = names
    below = tree.entries.get(name, value)
    return replace(tree, value={**tree.entries, name: put(below, rest, value)})
