"""From the tree of a graph file to a checked Graph; every mistake becomes a problem."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

from lodeflow.errors import NodeError, did_you_mean
from lodeflow.graph.arguments import NAME, RECORD_FIELDS, path_fields
from lodeflow.graph.groups import read_groups, with_sources
from lodeflow.graph.keyed import read_keys
from lodeflow.graph.layers import NODE_KEYS
from lodeflow.graph.model import Graph, GraphNode, Loss, Record, Wire
from lodeflow.graph.parameters import read_params
from lodeflow.graph.plugins import Plugin, load_plugin
from lodeflow.graph.problems import Problems, join, show
from lodeflow.graph.reading import (
    check_keys,
    is_file,
    is_misspelt,
    mapping,
    missing,
    read_allow,
    title,
)
from lodeflow.graph.tree import Tree
from lodeflow.graph.wiring import Wiring
from lodeflow.params import Params

FORMAT = 1
"""The version of the file format that this code reads."""
KEYS = ("lodeflow", "name", "args", "nodes", "record", "processes")
RECORDED_TO = "recordings/{name}-{start}.mcap"


def check(
    tree: Tree, args: Mapping[str, Any], problems: Problems, **described: Any
) -> Graph | None:
    """Return the graph that a tree describes, or None after adding every problem found.

    Args:
        tree: the file after overrides, args filled in.
        args: values of the args.
        problems: where problems are added.
        described: further attributes of the graph.
    """
    if not is_file(tree, "graph", "lodeflow", FORMAT, KEYS, problems):
        return None
    name = title(tree, KEYS, problems)
    if (drafts := _nodes(tree, problems)) is None:
        return None
    wiring = Wiring({node: draft.plugin for node, draft in drafts.items()}, problems)
    finished = {node: draft.finish(wiring, problems) for node, draft in drafts.items()}
    nodes = {node: found for node, found in finished.items() if found}
    nodes |= {name: source for name, (_, source) in wiring.keyed.items()}
    wiring.cycles(nodes)
    record = _record(tree, args, wiring, problems)
    processes = with_sources(
        read_groups(tree.find("processes"), drafts, problems),
        {source: reader for source, (reader, _) in wiring.keyed.items()},
    )
    return None if len(problems) else Graph(name, nodes, record, processes, args, **described)


class _Draft:
    """One node while it is checked."""

    def __init__(self, name: str, tree: Tree, others: Iterable[str], problems: Problems) -> None:
        self.name, self.tree, self.path = name, tree, join("nodes", name)
        self.use = ""
        self.plugin: Plugin | None = None
        if not NAME.fullmatch(name):
            problems.add(tree.name_place, self.path, "a name is a-z, then a-z, 0-9 and _")
        if not isinstance(tree.value, dict):
            what = f"should be a mapping, such as {{use: plugin}}, got {show(tree.plain())}"
            tree.refuse(problems, self.path, what)
            return
        check_keys(tree, self.path, NODE_KEYS, problems)
        self._load(others, problems)

    def _load(self, others: Iterable[str], problems: Problems) -> None:
        use = self.tree.find("use")
        path = join(self.path, "use")
        if use is None:
            if is_misspelt(self.tree, "use", NODE_KEYS):
                return
            near = did_you_mean(self.name, [other for other in others if other != self.name])
            what = f"missing; name a plugin, or module:Class{near and f'; or{near[1:]}'}"
            problems.add(self.tree.name_place, path, what)
        elif not isinstance(use.value, str):
            what = f"should be a plugin or module:Class, got {show(use.plain())}"
            use.refuse(problems, path, what)
        else:
            self.use = use.value
            try:
                self.plugin = load_plugin(use.value)
            except NodeError as error:
                use.refuse(problems, path, str(error))

    def finish(self, wiring: Wiring, problems: Problems) -> GraphNode | None:
        """Return the node with its parameters and wires, as far as they are right."""
        owner, plugin = self.tree.name_place, self.plugin
        inputs = wiring.inputs(self.name, self.tree.find("inputs"), owner)
        gates = wiring.gates(self.name, self.tree.find("when"))
        allow = self._allow(problems)
        if plugin is None:
            return None
        path = join(self.path, "params")
        params = read_params(plugin, self.use, self.tree.find("params"), path, owner, problems)
        return GraphNode(
            self.name,
            self.use,
            plugin,
            Params() if params is None else params,
            inputs,
            gates,
            frozenset(allow),
            read_keys(self.tree.find("keys"), plugin, join(self.path, "keys"), problems),
        )

    def _allow(self, problems: Problems) -> list[Loss]:
        tree, path = self.tree.find("allow"), join(self.path, "allow")
        if tree is None:
            return []
        if self.plugin is not None and not self.plugin.spec.is_source:
            what = f"only a source drops samples, and {self.plugin.__name__} is none; remove it"
            problems.add(tree.name_place, path, what)
            return []
        return read_allow(tree, path, problems)


def _nodes(tree: Tree, problems: Problems) -> dict[str, _Draft] | None:
    """Return the nodes, or None where there are none to speak of."""
    nodes = tree.find("nodes")
    if nodes is None:
        what = "a graph has nodes, {name: {use: plugin}}"
        missing(tree, "nodes", what, KEYS, problems)
        return None
    given = mapping(nodes, "nodes", "names to {use: plugin}", problems)
    if nodes.value in (None, {}):
        problems.add(nodes.name_place, "nodes", "empty; a graph has at least one node")
    drafts = {name: _Draft(name, node, given, problems) for name, node in given.items()}
    return drafts or None


def _record(
    tree: Tree, args: Mapping[str, Any], wiring: Wiring, problems: Problems
) -> Record | None:
    record = tree.find("record")
    if record is None or record.value is None:
        return None
    given = mapping(record, "record", "to and streams", problems)
    check_keys(record, "record", ("to", "streams"), problems)
    to = RECORDED_TO
    if path := given.get("to"):
        if isinstance(path.value, str) and path.value:
            to = path.value
            _check_path(path, to, args, problems)
        else:
            what = f"should be the path of a file, such as {RECORDED_TO}, got {show(path.plain())}"
            path.refuse(problems, "record.to", what)
    streams = given.get("streams")
    if streams is None or streams.value == "all":
        return Record(to)
    if not isinstance(streams.value, tuple):
        what = f"should be all, or a list of streams, got {show(streams.plain())}"
        streams.refuse(problems, "record.streams", what)
    wires: dict[Wire, None] = {}
    for at, item in enumerate(streams.items):
        wires.update(dict.fromkeys(wiring.recorded(item, join("record", "streams", at))))
    return Record(to, tuple(wires))


def _check_path(path: Tree, to: str, args: Mapping[str, Any], problems: Problems) -> None:
    fields = path_fields(to)
    if fields is None:
        path.refuse(problems, "record.to", "a '{' or '}' has no partner; write {name} or {start}")
        return
    known = (*RECORD_FIELDS, *args)
    for field in fields:
        if field not in known:
            near = did_you_mean(field, known) or f" (fields: {', '.join(known)})"
            path.refuse(problems, "record.to", f"nothing is called {{{field}}}{near}")
        elif field in args and not isinstance(args[field], (str, int, float)):
            what = f"the arg '{field}' is {show(args[field])}, which cannot stand in a path"
            what += f"; give one with --arg {field}=..." if args[field] is None else ""
            path.refuse(problems, "record.to", what)
