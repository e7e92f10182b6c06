"""The args of a graph: `${seed}` stands for a value that `--arg seed=8` changes."""

from __future__ import annotations

import re
import string
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace

from lodeflow.errors import did_you_mean
from lodeflow.graph.problems import Problems, join, show
from lodeflow.graph.tree import Tree

ARG = re.compile(r"\$\{([a-z][a-z0-9_]*)\}")
NAME = re.compile(r"[a-z][a-z0-9_]*")
RECORD_FIELDS = ("name", "start")
"""What {...} in the path of a recording may stand for besides the args."""


def declared(tree: Tree, problems: Problems) -> dict[str, Tree]:
    """Return the args of a graph with the values in force."""
    args = tree.find("args")
    if args is None or args.value is None:
        return {}
    if not isinstance(args.value, dict):
        args.refuse(problems, "args", f"should be a mapping of names, got {show(args.plain())}")
        return {}
    for name, value in args.value.items():
        path = join("args", name)
        if not NAME.fullmatch(name):
            problems.add(value.name_place, path, "a name is a-z, then a-z, 0-9 and _")
        if name in RECORD_FIELDS:
            problems.add(value.name_place, path, "this name stands for itself in record.to")
        for text in _texts(value):
            if "${" in str(text.value):
                text.refuse(problems, path, "an arg cannot refer to another arg")
    return args.value


def used(trees: Iterable[Tree]) -> set[str]:
    """Return the names of all args that some graphs refer to."""
    found: set[str] = set()
    for tree in trees:
        for name, part in tree.entries.items():
            if name != "args":
                found.update(name for text in _texts(part) for name in ARG.findall(str(text.value)))
        if (to := tree.find("record", "to")) is not None and isinstance(to.value, str):
            found.update(name for name in path_fields(to.value) or () if name)
    return found


def path_fields(path: str) -> list[str] | None:
    """Return the {fields} of the path of a recording, or None if its braces do not match."""
    try:
        parts = list(string.Formatter().parse(ARG.sub("", path)))
    except ValueError:
        return None
    fields = []
    for _, field, form, conversion in parts:
        if field is not None:
            how = (f"!{conversion}" if conversion else "") + (f":{form}" if form else "")
            fields.append(field + how)
    return fields


def fill(tree: Tree, args: Mapping[str, Tree], problems: Problems, path: str = "") -> Tree:
    """Return the tree with each ${arg} replaced.

    A value that is exactly ${x} keeps the arg's type; inside a text the arg is formatted.
    """
    if isinstance(tree.value, dict):
        entries = {
            name: fill(entry, args, problems, join(path, name)) if path or name != "args" else entry
            for name, entry in tree.value.items()
        }
        return replace(tree, value=entries)
    if isinstance(tree.value, tuple):
        items = enumerate(tree.value)
        return replace(
            tree, value=tuple(fill(item, args, problems, join(path, at)) for at, item in items)
        )
    return _fill_text(tree, args, problems, path)


def _fill_text(tree: Tree, args: Mapping[str, Tree], problems: Problems, path: str) -> Tree:
    if not isinstance(tree.value, str) or "${" not in tree.value:
        return tree
    text = tree.value
    names = list(dict.fromkeys(ARG.findall(text)))
    whole = ARG.fullmatch(text) is not None
    wrong = []
    if "${" in ARG.sub("", text):
        wrong.append("'${' begins the name of an arg, as in ${seed}")
    for name in names:
        if name not in args:
            known = f" (args: {', '.join(args)})" if args else "; declare it under 'args:'"
            wrong.append(f"no arg '{name}'{did_you_mean(name, args)}{known}")
        elif not whole and not isinstance(args[name].value, (str, int, float)):
            got = show(args[name].plain())
            what = f"the arg '{name}' is {got}, which cannot stand inside a text"
            hint = f"; give one with --arg {name}=..." if args[name].value is None else ""
            wrong.append(what + hint)
    if wrong:
        for what in wrong:
            tree.refuse(problems, path, what)
        problems.silence(tree.place)
        return tree
    told = [f"${{{name}}} = {show(args[name].plain())}, from {args[name].place}" for name in names]
    note = "; ".join([*told, *([tree.note] if tree.note else [])])
    if whole:
        return replace(tree, value=args[names[0]].value, note=note)
    return replace(tree, value=ARG.sub(lambda match: _formatted(args[match[1]]), text), note=note)


def _formatted(tree: Tree) -> str:
    """Return a scalar as it stands inside a text."""
    return tree.value if isinstance(tree.value, str) else show(tree.value)


def _texts(tree: Tree) -> Iterator[Tree]:
    """Yield every text in a tree, keys left out."""
    if isinstance(tree.value, str):
        yield tree
    for inner in (*tree.entries.values(), *tree.items):
        yield from _texts(inner)
