"""Process groups of a graph file: which nodes share a process, and what follows a crash."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any, get_args

from lodeflow.errors import did_you_mean
from lodeflow.graph.model import Group, OnCrash, Restart
from lodeflow.graph.problems import Problems, join, show
from lodeflow.graph.reading import TITLE, check_keys, is_misspelt, mapping
from lodeflow.graph.tree import Tree

RECORDER = "recorder"
"""Name of the process that records when a graph is split; no group can be called so."""
KEYS = ("nodes", "restart", "limit", "on_crash", "allow_gaps", "latest")


def read_groups(
    tree: Tree | None, nodes: Mapping[str, Any], problems: Problems
) -> dict[str, Group]:
    """Return the groups that `processes` describes, as far as they are right.

    Args:
        tree: the value of `processes`, or None.
        nodes: the nodes of the graph.
        problems: where problems are added.
    """
    groups = mapping(tree, "processes", "groups to lists of nodes", problems)
    placed: dict[str, str] = {}
    found = {name: _group(name, it, nodes, placed, problems) for name, it in groups.items()}
    missing = [name for name in nodes if name not in placed]
    all_right = sum(len(group.nodes) for group in found.values()) == len(placed)
    if tree and found and missing and all_right:
        what = f"in no group: {', '.join(missing)}; add to one"
        problems.add(tree.name_place, "processes", what)
    return found


def with_sources(groups: dict[str, Group], readers: Mapping[str, str]) -> dict[str, Group]:
    """Return the groups with sources added, each to the group of the node that reads it."""
    found = {}
    for name, group in groups.items():
        mine = [source for source, reader in readers.items() if reader in group.nodes]
        found[name] = replace(group, nodes=(*group.nodes, *mine))
    return found


def _group(
    name: str, tree: Tree, nodes: Mapping[str, Any], placed: dict[str, str], problems: Problems
) -> Group:
    path = join("processes", name)
    if not TITLE.fullmatch(name):
        problems.add(tree.name_place, path, "a name is a-z, then a-z, 0-9, _ and -")
    if name == RECORDER:
        what = f"'{RECORDER}' is the process that records; choose another name"
        problems.add(tree.name_place, path, what)
    if not isinstance(tree.value, dict):
        return Group(_members(name, tree, path, nodes, placed, problems))
    check_keys(tree, path, KEYS, problems)
    members: tuple[str, ...] = ()
    if listed := tree.find("nodes"):
        members = _members(name, listed, join(path, "nodes"), nodes, placed, problems)
    elif not is_misspelt(tree, "nodes", KEYS):
        problems.add(tree.name_place, join(path, "nodes"), "missing; list the nodes of the group")
    defaults = Group(())
    latest = _choice(tree, "latest", path, (True, False), defaults.latest, problems)
    speaking = [node for node in members if (p := nodes[node].plugin) and p.spec.outputs]
    if latest and speaking and (place := tree.find("latest")):
        what = f"'{speaking[0]}' has outputs; only nodes without any may miss samples"
        place.refuse(problems, join(path, "latest"), what)
    return Group(
        members,
        _choice(tree, "restart", path, get_args(Restart), defaults.restart, problems),
        _limit(tree, path, defaults.limit, problems),
        _choice(tree, "on_crash", path, get_args(OnCrash), defaults.on_crash, problems),
        _choice(tree, "allow_gaps", path, (True, False), defaults.allow_gaps, problems),
        latest,
    )


def _members(
    group: str,
    tree: Tree,
    path: str,
    nodes: Mapping[str, Any],
    placed: dict[str, str],
    problems: Problems,
) -> tuple[str, ...]:
    if not tree.items:
        tree.refuse(problems, path, f"should be a list of nodes, got {show(tree.plain())}")
    for item in tree.items:
        name = item.value
        if not isinstance(name, str) or name not in nodes:
            near = did_you_mean(str(name), nodes)
            item.refuse(problems, path, f"no node {show(item.plain())}{near}")
        elif name in placed:
            what = f"'{name}' is in group '{placed[name]}' already; a node runs in one"
            item.refuse(problems, path, what)
        else:
            placed[name] = group
    return tuple(str(item.value) for item in tree.items)


def _choice(
    tree: Tree, key: str, path: str, known: tuple[Any, ...], default: Any, problems: Problems
) -> Any:
    value = tree.find(key)
    if value is None:
        return default
    if not any(value.value is one or value.value == one for one in known) or (
        isinstance(known[0], bool) is not isinstance(value.value, bool)
    ):
        names = [str(one).lower() if isinstance(one, bool) else one for one in known]
        near = did_you_mean(str(value.value), names)
        what = f"should be {' or '.join(names)}, got {show(value.plain())}{near}"
        value.refuse(problems, join(path, key), what)
        return default
    return value.value


def _limit(tree: Tree, path: str, default: int, problems: Problems) -> int:
    value = tree.find("limit")
    if value is None:
        return default
    if type(value.value) is not int or value.value < 0:
        what = f"should be a whole number from 0 up, got {show(value.plain())}"
        value.refuse(problems, join(path, "limit"), what)
        return default
    return value.value
