"""What a study file says of changes and axes; every mistake becomes a problem at its place."""

from __future__ import annotations

import glob
import math
import os
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from lodeflow.graph.layers import Kind, Option
from lodeflow.graph.problems import Problems, join, show
from lodeflow.graph.reading import check_keys, mapping
from lodeflow.graph.tree import Tree
from lodeflow.study.model import Axis, Change, Point

CHANGES = ("graph", "with", "swap", "set", "args")
"""Keys of a case; also at the top, for all cells."""
TARGETS = ("arg", "set", "swap", "replay")
"""What an axis of values varies."""
RESERVED = ("wall", "data", "error")
"""Columns of the table of cells that are no axes."""
MOST_POINTS = 100_000

_VARIABLE = re.compile(r"\$\{([A-Z][A-Z0-9_]*)\}")
_AXIS = re.compile(r"[a-z][a-z0-9_]*")
_FROM_VALUES = ("values", "files", "from")


def expand(tree: Tree, environment: Mapping[str, str], problems: Problems) -> Tree:
    """Return a tree with each ${NAME} in capitals replaced by the environment variable."""
    unset: set[str] = set()

    def filled(tree: Tree) -> Tree:
        if isinstance(tree.value, dict):
            entries = {name: filled(entry) for name, entry in tree.value.items()}
            return replace(tree, value=entries)
        if isinstance(tree.value, tuple):
            return replace(tree, value=tuple(map(filled, tree.value)))
        names = _VARIABLE.findall(tree.value) if isinstance(tree.value, str) else ()
        if not names:
            return tree
        for name in names:
            if name not in environment and name not in unset:  # told once is enough
                what = f"the environment variable {name} is not set; export {name}=... first"
                problems.add(tree.place, "", what)
                unset.add(name)
        text = _VARIABLE.sub(lambda found: environment.get(found[1], ""), str(tree.value))
        problems_silent = any(name in unset for name in names)
        if problems_silent:
            problems.silence(tree.place)
        told = "; ".join(f"${{{name}}} = {show(environment.get(name, ''))}" for name in names)
        return replace(tree, value=text, note=told)

    return filled(tree)


@dataclass(frozen=True)
class Reader:
    """Reads changes and axes.

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
        """Return the path of a file that must be there."""
        if not isinstance(tree.value, str) or not tree.value:
            tree.refuse(self.problems, path, f"should be a path, got {show(tree.plain())}")
            return None
        found = self.path(tree.value)
        if not found.is_file():
            tree.refuse(self.problems, path, f"no file {str(found)!r}")
            return None
        return found

    def change(self, tree: Tree, path: str) -> Change:
        """Return what the keys `CHANGES` of a mapping say."""
        graph = tree.find("graph")
        overlays = tree.find("with")
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

    def _options(self, kind: Kind, tree: Tree | None, path: str) -> Iterable[Option]:
        what = {"swap": "nodes to plugins", "set": "node.param to values", "arg": "args to values"}
        for target, value in mapping(tree, path, what[kind], self.problems).items():
            named = replace(value, place=value.name_place)
            if self._is_target(kind, target, named, join(path, target)):
                yield from self._option(kind, target, named, value, join(path, target))

    def _is_target(self, kind: Kind, target: str, tree: Tree, path: str) -> bool:
        """Whether a text may name what is changed."""
        names = target.split(".")
        if kind == "set" and (len(names) < 2 or not all(names)):
            tree.refuse(self.problems, path, "names no parameter; write node.param")
            return False
        if kind == "set" and names[1:] == ["use"]:
            tree.refuse(self.problems, path, f"write it under 'swap': {{{names[0]}: plugin}}")
            return False
        return True

    def _option(
        self, kind: Kind, target: str, named: Tree, value: Tree, path: str
    ) -> Iterable[Option]:
        if kind == "swap" and not (isinstance(value.value, str) and value.value):
            what = f"should be a plugin or module:Class, got {show(value.plain())}"
            value.refuse(self.problems, path, what)
        else:
            yield Option(kind, target, value, named.place)

    def axes(self, tree: Tree | None) -> dict[str, Axis]:
        """Return the axes of a study."""
        found: dict[str, Axis] = {}
        for name, axis in mapping(tree, "axes", "names to axes", self.problems).items():
            path = join("axes", name)
            if not _AXIS.fullmatch(name) or name in RESERVED:
                reserved = f", and not {', '.join(RESERVED)}"
                what = f"a name is a-z, then a-z, 0-9 and _{reserved}"
                self.problems.add(axis.name_place, path, what)
            elif points := self._points(axis, path):
                found[name] = Axis(name, points)
        return found

    def _points(self, tree: Tree, path: str) -> tuple[Point, ...]:
        forms = "{arg|set|swap|replay: ..., values|files|from: ...} or {cases: ...}"
        if not isinstance(tree.value, dict):
            tree.refuse(self.problems, path, f"should be {forms}, got {show(tree.plain())}")
            return ()
        if "cases" in tree.value:
            check_keys(tree, path, ("cases",), self.problems)
            return self._cases(tree.value["cases"], join(path, "cases"))
        check_keys(
            tree, path, (*TARGETS, *_FROM_VALUES, "to", "step", "label", "cases"), self.problems
        )
        targets = [name for name in TARGETS if name in tree.value]
        sources = [name for name in _FROM_VALUES if name in tree.value]
        if len(targets) != 1 or len(sources) != 1:
            missing = len(targets) < 1 or len(sources) < 1
            what = "is not complete" if missing else "says two things at once"
            self.problems.add(tree.name_place, path, f"{what}; write {forms}")
            return ()
        points = self._values(targets[0], tree, sources[0], path)
        return self._distinct(points, path)

    def _cases(self, tree: Tree, path: str) -> tuple[Point, ...]:
        cases = mapping(tree, path, "names to changes", self.problems)
        if not cases:
            self.problems.add(tree.name_place, path, "empty; write {name: {set: ...}}")
        points = []
        for label, case in cases.items():
            here = join(path, label)
            mapping(case, here, ", ".join(CHANGES), self.problems)
            check_keys(case, here, CHANGES, self.problems)
            points.append(Point(label, label, self.change(case, here)))
        return tuple(points)

    def _values(self, target: str, tree: Tree, source: str, path: str) -> list[Point]:
        """Return the points of an axis that gives values to one thing."""
        named = tree.entries[target]
        start: tuple[str, ...] = ()
        if target == "replay":
            if isinstance(named.value, tuple):
                start = tuple(str(item.value) for item in named.items)
            elif named.value != "all":
                what = "should be all, or a list of nodes to compute from"
                named.refuse(
                    self.problems, join(path, target), f"{what}, got {show(named.plain())}"
                )
                return []
        elif not isinstance(named.value, str):
            what = {"arg": "the name of an arg", "set": "node.param", "swap": "a node"}[target]
            named.refuse(
                self.problems, join(path, target), f"should be {what}, got {show(named.plain())}"
            )
            return []
        given = list(self._given(tree, source, path))
        points = []
        for label, value in given:
            here = join(path, source, label)
            scalar = value.value if isinstance(value.value, int | float) else label
            if target == "replay":
                if (file := self.file(value, here)) is not None:
                    points.append(Point(label, label, Change(recording=file, start=start)))
                continue
            kind: Kind = "swap" if target == "swap" else "set" if target == "set" else "arg"
            if self._is_target(kind, str(named.value), named, join(path, target)):
                options = self._option(kind, str(named.value), named, value, here)
                points += [Point(label, scalar, Change(options=(option,))) for option in options]
        return points

    def _given(self, tree: Tree, source: str, path: str) -> Iterable[tuple[str, Tree]]:
        """Yield (label, value) of what an axis lists."""
        given, here = tree.entries[source], join(path, source)
        if source == "files":
            yield from self._files(given, tree.find("label"), here)
        elif source == "from":
            yield from self._range(tree, path)
        elif isinstance(given.value, dict) and given.value:
            yield from given.value.items()
        elif given.items:
            for item in given.items:
                yield label_of(item), item
        else:
            what = "should be a list of values, or a mapping of labels to values"
            given.refuse(self.problems, here, f"{what}, got {show(given.plain())}")

    def _files(self, tree: Tree, label: Tree | None, path: str) -> Iterable[tuple[str, Tree]]:
        """Yield the files that fit, called by their stem, or by what of it fits an expression."""
        expression = re.compile("")
        if label is not None:
            try:
                expression = re.compile(str(label.value))
            except re.error as error:
                label.refuse(self.problems, path, f"not a regular expression: {error}")
                return
        for pattern in tree.items or (tree,):
            if not isinstance(pattern.value, str) or not pattern.value:
                pattern.refuse(self.problems, path, "should be a pattern such as rides/*.mcap")
                continue
            where = self.path(pattern.value)
            found = sorted(glob.glob(str(where), recursive=True))  # noqa: PTH207 (may be absolute)
            if not found:
                pattern.refuse(self.problems, path, f"no file fits '{where}'")
            for file in found:
                stem = Path(file).stem
                fits = expression.search(stem)
                if fits is None:
                    pattern.refuse(self.problems, path, f"the label fits nothing in '{stem}'")
                    continue
                yield fits[1] if fits.groups() else fits[0] or stem, replace(pattern, value=file)

    def _range(self, tree: Tree, path: str) -> Iterable[tuple[str, Tree]]:
        first = tree.entries["from"]
        numbers = []
        for name in ("from", "to", "step"):
            value = tree.find(name) or (Tree(1, first.place) if name == "step" else None)
            if value is None or isinstance(value.value, bool | str) or value.value is None:
                what = "should be a number" if value else "missing; the range ends with it"
                self.problems.add((value or first).place, join(path, name), what)
                return
            numbers.append(float(str(value.value)))
        begin, end, step = numbers
        count = math.floor((end - begin) / step + 1e-9) + 1 if step else 0
        if not 0 < count <= MOST_POINTS:
            what = f"from {begin:g} to {end:g} in steps of {step:g} is {max(count, 0)} values"
            self.problems.add(first.place, path, f"{what}; an axis has 1 to {MOST_POINTS}")
            return
        for at in range(count):
            number = round(begin + at * step, 12)
            value = Tree(int(number) if number == int(number) else number, first.place)
            yield label_of(value), value

    def _distinct(self, points: Sequence[Point], path: str) -> tuple[Point, ...]:
        labels = [point.label for point in points]
        for label in dict.fromkeys(label for label in labels if labels.count(label) > 1):
            place = next(p for p in points if p.label == label).change
            at = place.options[0].value.place if place.options else None
            what = f"two values are called '{label}'; give them names, {{name: value, ...}}"
            if at is not None:
                self.problems.add(at, path, what)
        return tuple(points)


def label_of(tree: Tree) -> str:
    """Return how a value is written in tables."""
    return tree.value if isinstance(tree.value, str) else show(tree.plain())
