"""What a study file says of tables and figures; every mistake becomes a problem at its place."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any, get_args

from lodeflow.errors import MessageError, did_you_mean
from lodeflow.graph.problems import Problems, join, show
from lodeflow.graph.reading import check_keys, mapping
from lodeflow.graph.tree import Tree
from lodeflow.messages.units import Dimensionless
from lodeflow.study.axes import label_of
from lodeflow.study.model import Axis, Column, Figure, FigureKind, Table, Value, Where
from lodeflow.study.statistics import Statistic

TABLE = (
    "title", "rows", "columns", "value", "values", "unit", "statistic", "digits", "where",
    "margin", "compare", "reference",
)  # fmt: skip
FIGURE = (
    "title", "kind", "x", "series", "value", "unit", "statistic", "where", "log",
)  # fmt: skip
VALUE = ("value", "unit", "statistic", "digits")

_NAME = re.compile(r"[a-z][a-z0-9_-]*")


@dataclass(frozen=True)
class Views:
    """Reads tables and figures.

    Attributes:
        axes: of the study.
        columns: that its cells have.
        problems: where problems are added.
    """

    axes: Mapping[str, Axis]
    columns: Mapping[str, Column]
    problems: Problems

    def tables(self, tree: Tree | None) -> Iterator[Table]:
        """Yield the tables."""
        for name, table in mapping(tree, "tables", "names to tables", self.problems).items():
            path = join("tables", name)
            if self._is_view(name, table, path, TABLE):
                yield from self._table(name, table, path)

    def figures(self, tree: Tree | None) -> Iterator[Figure]:
        """Yield the figures."""
        for name, figure in mapping(tree, "figures", "names to figures", self.problems).items():
            path = join("figures", name)
            if self._is_view(name, figure, path, FIGURE):
                yield from self._figure(name, figure, path)

    def _is_view(self, name: str, tree: Tree, path: str, keys: tuple[str, ...]) -> bool:
        if not _NAME.fullmatch(name):
            self.problems.add(tree.name_place, path, "a name is a-z, then a-z, 0-9, _ and -")
        mapping(tree, path, ", ".join(keys), self.problems)
        check_keys(tree, path, keys, self.problems)
        return isinstance(tree.value, dict)

    def _table(self, name: str, tree: Tree, path: str) -> Iterator[Table]:
        before = len(self.problems)
        rows = self._axes(tree, "rows", path)
        columns = self._axis(tree, "columns", path, optional=True)
        values = tuple(self._values(tree, path))
        if columns and columns in rows:
            what = "this axis names the rows already"
            tree.entries["columns"].refuse(self.problems, join(path, "columns"), what)
        where = self._where(tree, path)
        margin = self._statistic(tree.find("margin"), values, join(path, "margin"))
        table = Table(
            name,
            self._text(tree, "title", path) or name,
            rows,
            columns or None,
            values,
            where,
            margin if tree.find("margin") else None,
        )
        extra = {**self._compare(table, tree, path), **self._reference(table, tree, path)}
        if len(self.problems) == before:
            yield replace(table, **extra)

    def _figure(self, name: str, tree: Tree, path: str) -> Iterator[Figure]:
        before = len(self.problems)
        kinds = get_args(FigureKind)
        kind = tree.find("kind")
        if kind is None or kind.value not in kinds:
            near = did_you_mean(str(kind.value), kinds) if kind else ""
            what = f"should be {', '.join(kinds)}{near}"
            place = kind.place if kind else tree.name_place
            self.problems.add(place, join(path, "kind"), what)
        x = self._axis(tree, "x", path)
        series = self._axis(tree, "series", path, optional=True)
        values = tuple(self._values(tree, path))
        log = tree.find("log")
        if log is not None and not isinstance(log.value, bool):
            what = f"should be true or false, got {show(log.plain())}"
            log.refuse(self.problems, join(path, "log"), what)
        where = self._where(tree, path)
        title = self._text(tree, "title", path) or name
        if len(self.problems) == before and kind is not None:
            shown: Any = kind.value
            yield Figure(
                name,
                title,
                shown,
                x,
                series or None,
                values[0],
                where,
                bool(log and log.value),
            )

    def _text(self, tree: Tree, key: str, path: str) -> str:
        found = tree.find(key)
        if found is None:
            return ""
        if not isinstance(found.value, str):
            what = f"should be a text, got {show(found.plain())}"
            found.refuse(self.problems, join(path, key), what)
        return str(found.value)

    def _axis(self, tree: Tree, key: str, path: str, *, optional: bool = False) -> str:
        """Return the only axis that a key names, or "" for none."""
        names = self._axes(tree, key, path, optional=optional)
        if len(names) > 1:
            tree.entries[key].refuse(self.problems, join(path, key), "takes one axis")
        return names[0] if names else ""

    def _axes(self, tree: Tree, key: str, path: str, *, optional: bool = False) -> tuple[str, ...]:
        """Return the axes that a key names: one, or a list of them."""
        found = tree.find(key)
        if found is None:
            if not optional:
                what = f"missing; name an axis ({', '.join(self.axes)})"
                self.problems.add(tree.name_place, join(path, key), what)
            return ()
        names = []
        for item in found.items or (found,):
            if item.value in self.axes:
                names.append(str(item.value))
            else:
                known = f" (axes: {', '.join(self.axes) or 'none'})"
                near = did_you_mean(str(item.value), self.axes) or known
                item.refuse(
                    self.problems, join(path, key), f"no axis is called {show(item.plain())}{near}"
                )
        return tuple(names)

    def _values(self, tree: Tree, path: str) -> Iterator[Value]:
        """Yield the values of a view: one under `value`, or several under `values`."""
        single, several = tree.find("value"), tree.find("values")
        if (single is None) == (several is None):
            what = "write 'value: stream.field', or 'values: {label: stream.field}'"
            self.problems.add(tree.name_place, path, what)
        elif single is not None:
            yield from self._value("", single, tree, tree, path)
        elif several is not None:
            here = join(path, "values")
            for label, item in mapping(several, here, "labels to values", self.problems).items():
                inner = join(here, label)
                if isinstance(item.value, dict):
                    check_keys(item, inner, VALUE, self.problems)
                named = item.find("value") if isinstance(item.value, dict) else item
                if named is None:
                    self.problems.add(item.name_place, inner, "has no 'value: stream.field'")
                else:
                    yield from self._value(label, named, item, tree, inner)

    def _value(
        self, label: str, named: Tree, own: Tree, shared: Tree, path: str
    ) -> Iterator[Value]:
        """Yield a value whose unit, statistic and digits are its own, or those of the view."""
        column = self.columns.get(str(named.value))
        if column is None:
            near = did_you_mean(str(named.value), self.columns)
            known = near or f" (values: {', '.join(self.columns)})"
            what = f"no cell has the value {show(named.plain())}{known}"
            named.refuse(self.problems, join(path, "value") if own is named else path, what)
            return
        unit = own.find("unit") or shared.find("unit")
        spelling = column.unit.symbol
        if unit is not None and column.unit is not Dimensionless:
            try:
                column.unit.factor(str(unit.value))
                spelling = str(unit.value)
            except MessageError as error:
                unit.refuse(self.problems, join(path, "unit"), f"{column.name}: {error}")
        statistic = own.find("statistic") or shared.find("statistic")
        digits = own.find("digits") or shared.find("digits")
        if digits is not None and not (type(digits.value) is int and 0 <= digits.value <= 15):
            what = f"should be 0 to 15, got {show(digits.plain())}"
            digits.refuse(self.problems, join(path, "digits"), what)
            digits = None
        value = Value(label, column.name, column.unit, spelling, Statistic("mean"), 2)
        found = self._statistic(statistic, (value,), join(path, "statistic"))
        places = int(str(digits.value)) if digits else 0 if found.counts else 2
        yield Value(label, column.name, column.unit, spelling, found, places)

    def _statistic(self, tree: Tree | None, values: Iterable[Value], path: str) -> Statistic:
        if tree is None:
            return Statistic("mean")
        statistic = Statistic(str(tree.value))
        for value in values:
            if wrong := statistic.check(value.of):
                tree.refuse(self.problems, path, wrong)
                return Statistic("mean")
        return statistic

    def _where(self, tree: Tree, path: str) -> Where:
        found: dict[str, tuple[str, ...]] = {}
        here = join(path, "where")
        for name, given in mapping(
            tree.find("where"), here, "axes to labels", self.problems
        ).items():
            if name not in self.axes:
                near = did_you_mean(name, self.axes) or f" (axes: {', '.join(self.axes)})"
                self.problems.add(given.name_place, here, f"no axis is called '{name}'{near}")
                continue
            found[name] = tuple(
                label_of(item)
                for item in given.items or (given,)
                if self._is_label(item, name, join(here, name))
            )
        return found

    def _is_label(self, item: Tree, axis: str, path: str) -> bool:
        known, label = self.axes[axis].labels, label_of(item)
        if label in known:
            return True
        near = did_you_mean(label, known) or f" (it has {show(list(known))})"
        item.refuse(self.problems, path, f"the axis '{axis}' has no '{label}'{near}")
        return False

    def _compare(self, table: Table, tree: Tree, path: str) -> dict[str, Any]:
        given, here = tree.find("compare"), join(path, "compare")
        if given is None:
            return {}
        entries = mapping(given, here, "with and better", self.problems)
        check_keys(given, here, ("with", "better"), self.problems)
        better = entries.get("better")
        if better is not None and better.value not in ("lower", "higher"):
            what = f"should be lower or higher, got {show(better.plain())}"
            better.refuse(self.problems, join(here, "better"), what)
        against = entries.get("with")
        if against is None:
            self.problems.add(given.name_place, here, "has no 'with', the row to compare with")
            return {}
        labels = against.items or (against,)
        if len(labels) != len(table.rows):
            what = f"should name a row by {', '.join(table.rows)}, got {show(against.plain())}"
            against.refuse(self.problems, join(here, "with"), what)
            return {}
        known = [
            self._is_label(item, axis, join(here, "with"))
            for item, axis in zip(labels, table.rows, strict=True)
        ]
        if not all(known):
            return {}
        chosen = "higher" if better and better.value == "higher" else "lower"
        return {"against": tuple(map(label_of, labels)), "better": chosen}

    def _reference(self, table: Table, tree: Tree, path: str) -> dict[str, Any]:
        given, here = tree.find("reference"), join(path, "reference")
        if given is None:
            return {}
        mapping(given, here, "source and figures", self.problems)
        check_keys(given, here, ("source", "figures"), self.problems)
        levels: list[tuple[str, tuple[str, ...]]] = [
            (f"the axis '{axis}'", self.axes[axis].labels) for axis in table.rows
        ]
        if table.columns:
            margin = (table.margin.text,) if table.margin else ()
            columns = self.axes[table.columns].labels
            levels.append((f"the axis '{table.columns}'", (*columns, *margin)))
        if len(table.values) > 1:
            levels.append(("the table", tuple(value.label for value in table.values)))
        figures = given.find("figures")
        found = (
            {} if figures is None else dict(self._numbers(figures, levels, join(here, "figures")))
        )
        return {"reference": found, "source": self._text(given, "source", here)}

    def _numbers(
        self, tree: Tree, levels: list[tuple[str, tuple[str, ...]]], path: str
    ) -> Iterator[tuple[tuple[str, ...], float]]:
        """Yield (labels, figure) of nested mappings, a level per row axis, column and value."""
        if not levels:
            if type(tree.value) in (int, float):
                yield (), float(str(tree.value))
            elif tree.value is not None:
                what = f"should be a number, got {show(tree.plain())}"
                tree.refuse(self.problems, path, what)
            return
        owner, known = levels[0]
        for label, inner in mapping(tree, path, f"labels of {owner}", self.problems).items():
            if label not in known:
                near = did_you_mean(label, known) or f" (it has {show(list(known))})"
                self.problems.add(inner.name_place, path, f"{owner} has no '{label}'{near}")
                continue
            for labels, figure in self._numbers(inner, levels[1:], join(path, label)):
                yield (label, *labels), figure
