"""Graph files to checked graphs: the one way that a Graph comes about."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from pathlib import Path
from typing import Any

from lodeflow.errors import did_you_mean
from lodeflow.graph.arguments import NAME, declared, fill, used
from lodeflow.graph.calibration_file import expand
from lodeflow.graph.check import check
from lodeflow.graph.layers import Layers, Option, override, read_options
from lodeflow.graph.model import Graph
from lodeflow.graph.problems import Origin, Place, Problems, join
from lodeflow.graph.tree import Tree, parse, read_text, to_yaml


def load_graph(
    path: str | Path,
    *,
    overlays: Sequence[str | Path] = (),
    sets: Sequence[str] = (),
    swaps: Sequence[str] = (),
    args: Sequence[str] = (),
) -> Graph:
    """Return the checked graph of a file.

    Overrides apply in one order: plugin default < graph file < overlays, in their order < swaps
    < sets; args last.

    Args:
        path: the graph file.
        overlays: partial graph files; mappings merge, lists and scalars replace, null removes.
        sets: texts "node.params.x=1" or "node.x=1"; the value is YAML.
        swaps: texts "node=plugin"; the node keeps its wires and the params that both plugins have.
        args: texts "name=value"; the value is YAML.

    Raises:
        GraphError: with all problems of the files and options, in the order of their places.
    """
    return resolve_file(path, overlays, sets, swaps, args)[0]


def load_graph_text(
    text: str,
    *,
    filename: str = "graph.yaml",
    overlays: Sequence[str | Path] = (),
    sets: Sequence[str] = (),
    swaps: Sequence[str] = (),
    args: Sequence[str] = (),
) -> Graph:
    """Return the checked graph of a text, such as the one kept in a recording.

    Args:
        text: what a graph file holds.
        filename: what problems name as the place.
        overlays: see `load_graph`, as for the others.
        sets: "node.x=1".
        swaps: "node=plugin".
        args: "name=value".

    Raises:
        GraphError: with all problems.
    """
    problems = Problems()
    options = read_options(sets, swaps, args, problems)
    return _resolve(text, filename, overlays, options, problems)[0]


def dump(graph: Graph) -> str:
    """Return the text of a graph: loading it gives the same graph, without any override."""
    return to_yaml(graph.document)


def resolve_file(
    path: str | Path,
    overlays: Sequence[str | Path],
    sets: Sequence[str],
    swaps: Sequence[str],
    args: Sequence[str],
) -> tuple[Graph, Layers]:
    """Return the checked graph of a file and the layers that it was made of.

    Raises:
        GraphError: with all problems.
    """
    problems = Problems()
    return _resolve_file(path, overlays, read_options(sets, swaps, args, problems), problems)


def load_graph_with(
    path: str | Path, overlays: Sequence[str | Path], options: Sequence[Option]
) -> Graph:
    """Return the checked graph of a file, with options that know where they are written.

    Raises:
        GraphError: with all problems.
    """
    return _resolve_file(path, overlays, options, Problems())[0]


def _resolve_file(
    path: str | Path,
    overlays: Sequence[str | Path],
    options: Sequence[Option],
    problems: Problems,
) -> tuple[Graph, Layers]:
    text = read_file(path, Origin(str(path), 0, ()), problems)
    return _resolve(text, str(path), overlays, options, problems)


def _resolve(
    text: str | None,
    filename: str,
    overlays: Sequence[str | Path],
    options: Sequence[Option],
    problems: Problems,
) -> tuple[Graph, Layers]:
    base = _parse(text, Origin(filename, 0, ()), problems)
    others = []
    for rank, overlay in enumerate(overlays, 1):
        origin = Origin(str(overlay), rank, ())
        others.append(_parse(read_file(overlay, origin, problems), origin, problems))
    readable = [tree for tree in others if tree is not None]
    if base is None or len(readable) < len(others):
        raise problems.error()  # without one of the files, nothing true can be said of the others
    layers = override(base, readable, options, problems)
    values = declared(layers.merged, problems)
    referred = used(layer.tree for layer in layers.layers)
    misspelt = "".join(did_you_mean(name, values) for name in referred - values.keys())
    for name in values.keys() - referred:
        if NAME.fullmatch(name) and f"'{name}'" not in misspelt:
            what = f"never used; write ${{{name}}} where it should go, or remove it"
            problems.add(values[name].name_place, join("args", name), what)
    filled = fill(layers.merged, values, problems)
    layers, filled, files = expand(layers, filled, problems)
    in_force = {name: values[name].plain() for name in values if name in used([layers.merged])}
    document = _document(layers.merged, in_force)
    graph = check(filled, in_force, problems, document=document, notes=layers.notes, files=files)
    if graph is None or len(problems):
        raise problems.error()
    return graph, layers


def read_file(path: str | Path, origin: Origin, problems: Problems) -> str | None:
    """Return the text of a file, or None after a problem."""
    try:
        return read_text(path)
    except ValueError as error:
        problems.add(Place(origin), "", str(error))
        return None


def _parse(text: str | None, origin: Origin, problems: Problems) -> Tree | None:
    if text is None:
        return None
    good = _parsed(text, origin)
    return parse(text, origin, problems) if good is None else good


@lru_cache(maxsize=8)  # a study loads one file for each of its cells
def _parsed(text: str, origin: Origin) -> Tree | None:
    """Return the tree of a text without problems; None for others."""
    problems = Problems()
    tree = parse(text, origin, problems)
    return None if len(problems) else tree


def _document(merged: Tree, args: dict[str, Any]) -> dict[str, Any]:
    """Return the graph as plain data, with the args that something still refers to."""
    document = merged.plain()
    if not isinstance(document, dict):
        return {}
    if args:
        return {**document, "args": args}
    return {name: value for name, value in document.items() if name != "args"}
