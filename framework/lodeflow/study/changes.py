"""What a study file says of changes to a graph; every mistake becomes a problem at its place."""

from __future__ import annotations

import os
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

from lodeflow.graph.layers import Kind, Option
from lodeflow.graph.problems import Place, Problems, join, show
from lodeflow.graph.reading import mapping
from lodeflow.graph.tree import Tree
from lodeflow.study.model import Change

CHANGES = ("graph", "with", "swap", "set", "args")
"""Keys of a case; also at the top, for all cells."""

_VARIABLE = re.compile(r"\$\{([A-Z][A-Z0-9_]*)\}")


def expand(tree: Tree, environment: Mapping[str, str], problems: Problems) -> Tree:
    """Return a tree with each ${NAME} in capitals replaced by the environment variable."""
    unset: set[str] = set()

    def filled(tree: Tree) -> Tree:
        if isinstance(tree.value, dict):
            return replace(tree, value={name: filled(item) for name, item in tree.value.items()})
        if isinstance(tree.value, tuple):
            return replace(tree, value=tuple(map(filled, tree.value)))
        names = _VARIABLE.findall(tree.value) if isinstance(tree.value, str) else ()
        if not names:
            return tree
        missing = [name for name in names if name not in environment]
        for name in missing:
            if name not in unset:  # told once is enough
                what = f"the environment variable {name} is not set; export {name}=... first"
                problems.add(tree.place, "", what)
                unset.add(name)
        if missing:
            problems.silence(tree.place)
        text = _VARIABLE.sub(lambda found: environment.get(found[1], ""), str(tree.value))
        told = "; ".join(f"${{{name}}} = {show(environment.get(name, ''))}" for name in names)
        return replace(tree, value=text, note=told)

    return filled(tree)


@dataclass(frozen=True)
class Changes:
    """Reads changes.

    Attributes:
        folder: of the study file, from which paths in it start.
        problems: where problems are added.
    """

    folder: Path
    problems: Problems

    def path(self, text: str) -> Path:
        """Return a path in the study file as one from the current folder."""
        return Path(os.path.normpath(self.folder / text))

    def file(self, tree: Tree, path: str) -> Path | None:
        """Return the path of a file that must be there; None after a problem."""
        if not isinstance(tree.value, str) or not tree.value:
            tree.refuse(self.problems, path, f"should be a path, got {show(tree.plain())}")
            return None
        found = self.path(tree.value)
        if not found.is_file():
            tree.refuse(self.problems, path, f"no file '{found}'")
            return None
        return found

    def change(self, tree: Tree, path: str) -> Change:
        """Return what the keys `CHANGES` of a mapping say."""
        graph, overlays = tree.find("graph"), tree.find("with")
        files = (overlays.items or (overlays,)) if overlays is not None else ()
        found = [self.file(file, join(path, "with")) for file in files]
        return Change(
            None if graph is None else self.file(graph, join(path, "graph")),
            tuple(file for file in found if file is not None),
            (
                *self._options("swap", tree.find("swap"), join(path, "swap")),
                *self._options("set", tree.find("set"), join(path, "set")),
                *self._options("arg", tree.find("args"), join(path, "args")),
            ),
        )

    def _options(self, kind: Kind, tree: Tree | None, path: str) -> Iterator[Option]:
        what = {"swap": "nodes to plugins", "set": "node.param to values", "arg": "args to values"}
        for target, value in mapping(tree, path, what[kind], self.problems).items():
            here = join(path, target)
            if self.is_target(kind, target, replace(value, place=value.name_place), here):
                yield from self.option(kind, target, value.name_place, value, here)

    def is_target(self, kind: Kind, target: str, written: Tree, path: str) -> bool:
        """Whether a text may name what is changed; add a problem at `written` if it may not."""
        names = target.split(".")
        if kind == "set" and (len(names) < 2 or not all(names)):
            written.refuse(self.problems, path, "names no parameter; write node.param")
            return False
        if kind == "set" and names[1:] == ["use"]:
            written.refuse(self.problems, path, f"write it under 'swap': {{{names[0]}: plugin}}")
            return False
        return True

    def option(
        self, kind: Kind, target: str, written: Place, value: Tree, path: str
    ) -> Iterator[Option]:
        """Yield the option that gives a value to a target, if it may be one."""
        if kind == "swap" and not (isinstance(value.value, str) and value.value):
            what = f"should be a plugin or module:Class, got {show(value.plain())}"
            value.refuse(self.problems, path, what)
        else:
            yield Option(kind, target, value, written)
