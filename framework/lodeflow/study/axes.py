"""What a study file says of its axes; every mistake becomes a problem at its place."""

from __future__ import annotations

import glob
import math
import re
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

from lodeflow.graph.arguments import NAME
from lodeflow.graph.layers import Kind
from lodeflow.graph.problems import Problems, join, show
from lodeflow.graph.reading import check_keys, mapping
from lodeflow.graph.tree import Tree
from lodeflow.study.changes import CHANGES, Changes
from lodeflow.study.model import Axis, Change, Point

TARGETS: dict[str, Kind | None] = {"arg": "arg", "set": "set", "swap": "swap", "replay": None}
"""What an axis of values varies."""
LISTS = {"values": (), "files": ("label",), "from": ("to", "step")}
"""How an axis lists its values, and the keys that go with it."""
RESERVED = ("wall", "data", "error")
"""Columns of the table of cells that are no axes."""
MOST_POINTS = 100_000

_FORMS = "{arg|set|swap|replay: ..., values|files|from: ...} or {cases: ...}"
_MEANS = {"arg": "the name of an arg", "set": "node.param", "swap": "a node"}


@dataclass(frozen=True)
class Axes:
    """Reads axes.

    Attributes:
        changes: reads what a point changes.
    """

    changes: Changes

    @property
    def problems(self) -> Problems:
        """Where problems are added."""
        return self.changes.problems

    def read(self, tree: Tree | None) -> dict[str, Axis]:
        """Return the axes of a study."""
        found: dict[str, Axis] = {}
        for name, axis in mapping(tree, "axes", "names to axes", self.problems).items():
            path = join("axes", name)
            if not NAME.fullmatch(name) or name in RESERVED:
                reserved = f", and not {', '.join(RESERVED)}"
                what = f"a name is a-z, then a-z, 0-9 and _{reserved}"
                self.problems.add(axis.name_place, path, what)
            elif points := tuple(self._points(axis, path)):
                found[name] = Axis(name, points)
        return found

    def _points(self, tree: Tree, path: str) -> Iterator[Point]:
        if not isinstance(tree.value, dict):
            tree.refuse(self.problems, path, f"should be {_FORMS}, got {show(tree.plain())}")
            return
        if "cases" in tree.value:
            check_keys(tree, path, ("cases",), self.problems)
            yield from self._cases(tree.value["cases"], join(path, "cases"))
            return
        targets = [name for name in TARGETS if name in tree.value]
        lists = [name for name in LISTS if name in tree.value]
        more = [key for name in lists or LISTS for key in LISTS[name]]
        check_keys(tree, path, (*TARGETS, *LISTS, *more, "cases"), self.problems)
        if len(targets) != 1 or len(lists) != 1:
            incomplete = not targets or not lists
            what = "is not complete" if incomplete else "says two things at once"
            self.problems.add(tree.name_place, path, f"{what}; write {_FORMS}")
        else:
            yield from self._values(targets[0], tree, lists[0], path)

    def _cases(self, tree: Tree, path: str) -> Iterator[Point]:
        cases = mapping(tree, path, "names to changes", self.problems)
        if not cases:
            self.problems.add(tree.name_place, path, "empty; write {name: {set: ...}}")
        for label, case in cases.items():
            here = join(path, label)
            mapping(case, here, ", ".join(CHANGES), self.problems)
            check_keys(case, here, CHANGES, self.problems)
            yield Point(label, label, self.changes.change(case, here))

    def _values(self, target: str, tree: Tree, listed: str, path: str) -> Iterator[Point]:
        """Yield the points of an axis that gives values to one thing."""
        given = list(self._given(tree, listed, path))
        labels = [label for label, _ in given]
        for label, value in given:
            if labels.count(label) > 1:
                what = f"two values are called '{label}'; give them names, {{name: value, ...}}"
                value.refuse(self.problems, join(path, listed), what)
                return
        named, here = tree.entries[target], join(path, target)
        kind = TARGETS[target]
        if kind is None:
            yield from self._recordings(named, given, here)
        elif not isinstance(named.value, str):
            what = f"should be {_MEANS[target]}, got {show(named.plain())}"
            named.refuse(self.problems, here, what)
        elif self.changes.is_target(kind, named.value, named, here):
            for label, value in given:
                number = value.value if isinstance(value.value, int | float) else label
                where = join(path, listed, label)
                for option in self.changes.option(kind, named.value, named.place, value, where):
                    yield Point(label, number, Change(options=(option,)))

    def _recordings(self, named: Tree, given: list[tuple[str, Tree]], path: str) -> Iterator[Point]:
        """Yield a point per recording that is replayed, as a whole or from some nodes on."""
        if named.value != "all" and not named.items:
            what = "should be all, or a list of nodes to compute from"
            named.refuse(self.problems, path, f"{what}, got {show(named.plain())}")
            return
        start = tuple(str(item.value) for item in named.items)
        for label, value in given:
            if (file := self.changes.file(value, path)) is not None:
                yield Point(label, label, Change(recording=file, start=start))

    def _given(self, tree: Tree, listed: str, path: str) -> Iterator[tuple[str, Tree]]:
        """Yield (label, value) of what an axis lists."""
        given, here = tree.entries[listed], join(path, listed)
        if listed == "files":
            yield from self._files(given, tree.find("label"), path)
        elif listed == "from":
            yield from self._range(tree, path)
        elif isinstance(given.value, dict) and given.value:
            yield from given.value.items()
        elif given.items:
            yield from ((label_of(item), item) for item in given.items)
        else:
            what = "should be a list of values, or a mapping of labels to values"
            given.refuse(self.problems, here, f"{what}, got {show(given.plain())}")

    def _files(self, tree: Tree, label: Tree | None, path: str) -> Iterator[tuple[str, Tree]]:
        """Yield the files that fit, called by their stem, or by what of it fits an expression."""
        here = join(path, "files")
        try:
            expression = re.compile(".*" if label is None else str(label.value))
        except re.error as error:
            what = f"not a regular expression: {error}"
            (label or tree).refuse(self.problems, join(path, "label"), what)
            return
        for pattern in tree.items or (tree,):
            if not isinstance(pattern.value, str) or not pattern.value:
                what = f"should be a pattern such as rides/*.mcap, got {show(pattern.plain())}"
                pattern.refuse(self.problems, here, what)
                continue
            where = self.changes.path(pattern.value)
            found = sorted(glob.glob(str(where), recursive=True))  # noqa: PTH207 (may be absolute)
            if not found:
                pattern.refuse(self.problems, here, f"no file fits '{where}'")
            for file in found:
                if (fits := expression.search(Path(file).stem)) is None:
                    what = f"fits nothing in '{Path(file).stem}'"
                    (label or tree).refuse(self.problems, join(path, "label"), what)
                else:
                    yield fits[1 if fits.groups() else 0], replace(pattern, value=file)

    def _range(self, tree: Tree, path: str) -> Iterator[tuple[str, Tree]]:
        """Yield the numbers from `from` to `to`, which is one of them."""
        first = tree.entries["from"]
        numbers: list[float] = []
        for name in ("from", "to", "step"):
            value = tree.find(name)
            if value is None and name == "to":
                self.problems.add(tree.name_place, path, "has no 'to', the last of its values")
                return
            number = 1 if value is None else value.value
            if type(number) not in (int, float) or not math.isfinite(float(str(number))):
                value = value or first
                what = f"should be a number, got {show(value.plain())}"
                value.refuse(self.problems, join(path, name), what)
                return
            numbers.append(float(str(number)))
        begin, end, step = numbers
        count = math.floor(min((end - begin) / step, MOST_POINTS) + 1e-9) + 1 if step else 0
        if not 0 < count <= MOST_POINTS:
            what = f"from {begin:g} to {end:g} in steps of {step:g}"
            limit = f"an axis has 1 to {MOST_POINTS} values"
            self.problems.add(first.place, path, f"{what}: {limit}")
            return
        for at in range(count):
            number = round(begin + at * step, 12)
            value = Tree(int(number) if number == int(number) else number, first.place)
            yield label_of(value), value


def label_of(tree: Tree) -> str:
    """Return how a value is written in tables."""
    return tree.value if isinstance(tree.value, str) else show(tree.plain())
