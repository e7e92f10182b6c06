"""Calibration files: parameters of a node that `lodeflow calibrate` found, and how.

A node that declares a `CalibrationFile` parameter takes its parameters from such files. They are
read when a graph is loaded, and stand where the file is named: parameters set in the layers before
(the graph under an overlay or an option) count no more; those beside it, and in later layers, win
over it. The resolved graph holds the values and names no file.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from lodeflow.errors import NodeError, did_you_mean
from lodeflow.graph.layers import FIRST_OPTION, Layer, Layers, merge, put
from lodeflow.graph.plugins import Plugin, load_plugin
from lodeflow.graph.problems import Origin, Problems, join, show
from lodeflow.graph.tree import Tree, parse, read_text, to_yaml
from lodeflow.params import file_parameter
from lodeflow.registry import registry

FORMAT = 1
"""The version of the file format that this code reads and writes."""
KEYS = ("lodeflow_calibration", "use", "params", "results", "notes", "provenance")
_FIRST_FILE = 2 * FIRST_OPTION


def dump_calibration(
    use: str,
    params: Mapping[str, Any],
    results: Mapping[str, Any],
    notes: list[str],
    provenance: Mapping[str, Any],
) -> str:
    """Return the text of a calibration file.

    Args:
        use: the plugin that the parameters are for; "" for none.
        params: its parameters, as plain data.
        results: what was found, as plain data: {name: {value, unit, standard_error}}.
        notes: what a reader should know.
        provenance: from what, when and by what it was made.
    """
    document: dict[str, Any] = {"lodeflow_calibration": FORMAT}
    if use:
        document |= {"use": use, "params": dict(params)}
    document |= {"results": dict(results), "notes": notes, "provenance": dict(provenance)}
    return to_yaml(document)


def expand(layers: Layers, filled: Tree, problems: Problems) -> tuple[Layers, Tree, dict[str, str]]:
    """Return layers and graph with the content of calibration files where they were named.

    Args:
        layers: of the graph.
        filled: their outcome, args filled in.
        problems: where problems are added.

    Returns:
        The layers, with one more for each node that names files; the graph; and the texts of the
        files, by path.
    """
    texts: dict[str, str] = {}
    nodes = filled.find("nodes")
    for name, node in (nodes.entries if nodes else {}).items():
        plugin = _plugin(node)
        parameter = file_parameter(plugin.Params) if plugin else None
        params = node.find("params")
        if plugin is None or parameter is None or params is None:
            continue
        file = params.entries.get(parameter)
        if file is None or file.value is None:
            continue
        path = ("nodes", name, "params")
        brought = _content(file, join("", *path, parameter), node, plugin, texts, problems)
        rank = min(file.place.origin.rank, FIRST_OPTION)
        filled = put(filled, path, _over(brought, params, parameter, rank, problems))
        unfilled = layers.merged.find(*path) or params
        merged = put(layers.merged, path, _over(brought, unfilled, parameter, rank, Problems()))
        layers = replace(layers, merged=merged, layers=_with_layer(layers, path, brought, rank))
        if brought is None:
            for place in (params.name_place, params.place):
                problems.silence(place)  # what is missing is told by what was not read
    return layers, filled, texts


def _plugin(node: Tree) -> Plugin | None:
    use = node.find("use")
    if use is None or not isinstance(use.value, str):
        return None
    try:
        return load_plugin(use.value)
    except NodeError:
        return None  # the check tells


def _over(
    brought: Tree | None, params: Tree, parameter: str, rank: int, problems: Problems
) -> Tree:
    """Return the parameters of files under those that were set from some rank on."""
    given = {name: value for name, value in params.entries.items() if name != parameter}
    kept = {name: left for name, value in given.items() if (left := _from_rank(value, rank))}
    if brought is None:
        return replace(params, value=kept)
    return merge(replace(brought, key=params.key), replace(params, value=kept), "", problems)


def _from_rank(tree: Tree, rank: int) -> Tree | None:
    """Return what of a value was set in layers of some rank or above it."""
    if tree.entries:
        kept = {n: left for n, value in tree.entries.items() if (left := _from_rank(value, rank))}
        return replace(tree, value=kept) if kept else None
    return tree if tree.place.origin.rank >= rank else None


def _with_layer(
    layers: Layers, path: tuple[str, ...], brought: Tree | None, rank: int
) -> tuple[Layer, ...]:
    """Return the layers with that of the files before the one that names them."""
    if brought is None:
        return layers.layers
    lower = [layer for layer in layers.layers if layer.tree.place.origin.rank < rank]
    before = [found for layer in lower if (found := layer.tree.find(*path))]
    dropped = {name: Tree(None, brought.place) for found in before for name in found.entries}
    tree = replace(brought, value={**dropped, **brought.entries})
    for name in reversed(path):
        tree = Tree({name: tree}, brought.place, brought.place)
    return (*lower, Layer(tree, removes=True), *layers.layers[len(lower) :])


def _content(
    file: Tree, path: str, node: Tree, plugin: Plugin, texts: dict[str, str], problems: Problems
) -> Tree | None:
    """Return the parameters that some files hold, the later over the earlier ones."""
    named = file.items or (file,)
    if isinstance(file.value, dict) or not all(isinstance(n.value, str) and n.value for n in named):
        what = (
            f"should be the path of a calibration file, or a list of them, got {show(file.plain())}"
        )
        file.refuse(problems, path, what)
        return None
    read = [_params_in(item, path, node, plugin, texts, problems) for item in named]
    found = [params for params in read if params is not None]
    if len(found) < len(named):
        return None
    (brought, *others) = found
    for other in others:
        brought = merge(brought, other, "", problems)
    return brought


def _params_in(
    file: Tree, path: str, node: Tree, plugin: Plugin, texts: dict[str, str], problems: Problems
) -> Tree | None:
    name = str(file.value)
    try:
        text = read_text(name)
    except ValueError as error:
        hint = (
            "paths start at the current folder; 'lodeflow calibrate KIND REC --to FILE' makes one"
        )
        file.refuse(problems, path, f"'{name}': {error} ({hint})")
        return None
    before = len(problems)
    tree = parse(text, Origin(name, _FIRST_FILE + len(texts), ()), problems)
    texts[name] = text
    if tree is None:
        return None
    _check_head(tree, name, problems)
    params = tree.find("params")
    use = tree.find("use")
    if len(problems) > before:
        return None
    if use is None or params is None or not isinstance(params.value, dict):
        what = "holds no parameters: what it tells is in its results"
        problems.add(tree.place, "", f"{what}, so no node can read it")
        return None
    if not _is_for(str(use.value), str(node.find("use") and node.entries["use"].value), plugin):
        what = f"is for '{use.value}', not for '{node.entries['use'].value}' ({file.place})"
        problems.add(use.place, "use", what)
        return None
    for at, value in params.entries.items():
        if "${" in str(value.plain()):
            problems.add(value.place, join("params", at), "'${' has no meaning in a calibration")
    return params if len(problems) == before else None  # one mistake is told once


def _check_head(tree: Tree, name: str, problems: Problems) -> None:
    version = tree.find("lodeflow_calibration")
    if version is None:
        what = f"no calibration file; one begins with 'lodeflow_calibration: {FORMAT}'"
        problems.add(replace(tree.place, length=0), "", what)
    elif type(version.value) is not int or version.value != FORMAT:
        what = f"should be {FORMAT}, the version that this lodeflow reads"
        version.refuse(problems, "lodeflow_calibration", f"{what}, got {show(version.plain())}")
    else:
        for key, value in tree.entries.items():
            if key not in KEYS:
                near = did_you_mean(key, KEYS) or f" (keys: {', '.join(KEYS)})"
                problems.add(value.name_place, key, f"unknown key{near}")


def _is_for(wanted: str, use: str, plugin: Plugin) -> bool:
    """Whether parameters for one plugin suit another: the same, one made from it, or a file's."""
    known = registry().nodes
    if wanted == use or use not in known:
        return True
    if wanted not in known:
        return False
    try:
        return issubclass(plugin, registry().load(wanted))
    except NodeError:
        return False
