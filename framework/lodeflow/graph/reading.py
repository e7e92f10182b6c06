"""What the files that people write have in common: keys, versions, names, and what is missing."""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import replace
from typing import get_args

from lodeflow.errors import did_you_mean
from lodeflow.graph.model import Loss
from lodeflow.graph.problems import Problems, join, show
from lodeflow.graph.tree import Tree

TITLE = re.compile(r"[a-z][a-z0-9_-]*")
"""Names of graphs, studies and process groups."""


def check_keys(tree: Tree, path: str, known: Iterable[str], problems: Problems) -> None:
    """Refuse keys that are not known."""
    for name, value in tree.entries.items():
        if name not in known:
            near = did_you_mean(name, known) or f" (keys: {', '.join(known)})"
            problems.add(value.name_place, join(path, name), f"unknown key{near}")


def is_misspelt(tree: Tree, name: str, known: Iterable[str]) -> bool:
    """Whether a key that is missing is there under a wrong name, which is told already."""
    strange = tree.entries.keys() - set(known)
    return any(f"'{name}'" in did_you_mean(other, known) for other in strange)


def missing(tree: Tree, name: str, what: str, known: Iterable[str], problems: Problems) -> None:
    """Tell that a key of the whole file is missing."""
    if not is_misspelt(tree, name, known):
        problems.add(replace(tree.place, length=0), name, f"missing; {what}")


def mapping(tree: Tree | None, path: str, what: str, problems: Problems) -> dict[str, Tree]:
    """Return the entries of a mapping; null is an empty one."""
    if tree is None or tree.value is None:
        return {}
    if not isinstance(tree.value, dict):
        tree.refuse(problems, path, f"should be a mapping of {what}, got {show(tree.plain())}")
    return tree.entries


def is_file(
    tree: Tree, kind: str, key: str, version: int, known: Iterable[str], problems: Problems
) -> bool:
    """Whether a tree is a file of a kind at all; look at its keys and its version.

    Args:
        tree: the file.
        kind: "graph" or "study".
        key: the key that holds the version of the format.
        version: the one that this code reads.
        known: the keys at the top.
        problems: where problems are added.
    """
    if tree.value is None:
        problems.add(tree.place, "", f"empty; a {kind} file begins with '{key}: {version}'")
        return False
    if not isinstance(tree.value, dict):
        tree.refuse(problems, "", f"should be a mapping of {', '.join(known)}")
        return False
    check_keys(tree, "", known, problems)
    found = tree.find(key)
    if found is None:
        what = f"a {kind} file begins with '{key}: {version}', the version of its format"
        missing(tree, key, what, known, problems)
    elif type(found.value) is not int or found.value != version:
        what = f"should be {version}, the version of the format that this lodeflow reads"
        found.refuse(problems, key, f"{what}, got {show(found.plain())}")
    return True


def title(tree: Tree, known: Iterable[str], problems: Problems) -> str:
    """Return the name that a file gives to what it describes, or "" after a problem."""
    name = tree.find("name")
    rule = "a name is a-z, then a-z, 0-9, _ and -; it goes into keys and file names"
    if name is None:
        missing(tree, "name", rule, known, problems)
    elif not isinstance(name.value, str) or not TITLE.fullmatch(name.value):
        name.refuse(problems, "name", f"{rule}, got {show(name.plain())}")
    else:
        return name.value
    return ""


def read_allow(tree: Tree, path: str, problems: Problems) -> list[Loss]:
    """Return the losses that an `allow` lists, as far as they are right."""
    losses: tuple[Loss, ...] = get_args(Loss)
    if not isinstance(tree.value, tuple):
        what = f"should be a list of {', '.join(losses)}, got {show(tree.plain())}"
        tree.refuse(problems, path, what)
    for at, item in enumerate(tree.items):
        if item.value not in losses:
            near = did_you_mean(str(item.value), losses) or f" (losses: {', '.join(losses)})"
            item.refuse(problems, join(path, at), f"no loss is called {show(item.plain())}{near}")
    return [loss for loss in losses if loss in tree.plain()] if tree.items else []
