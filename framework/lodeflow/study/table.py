"""Tables over the cells of a study: what falls together becomes one number."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass

from lodeflow.study.model import Cell, Table, Value, Where
from lodeflow.study.statistics import Statistic
from lodeflow.study.store import Results

ABSENT = "-"
Labels = tuple[str, ...]


@dataclass(frozen=True)
class Entry:
    """One number of a table.

    Attributes:
        number: in the unit that is shown; None where no cell has one, NaN where one of them is.
        used: cells that gave it.
        expected: cells that should have.
        reference: what was published.
        digits: after the point.
    """

    number: float | None
    used: int = 1
    expected: int = 1
    reference: float | None = None
    digits: int = 2

    @property
    def text(self) -> str:
        """The number, the published one in parentheses, and how many cells lack, if any."""
        found = ABSENT if self.number is None else _figure(self.number, self.digits)
        if self.reference is not None:
            found += f" ({_figure(self.reference, self.digits)})"
        if self.used < self.expected and self.number is not None:
            found += f" [{self.used} of {self.expected}]"
        return found


@dataclass(frozen=True)
class Filled:
    """A table with its numbers.

    Attributes:
        table: what it shows.
        headers: of the columns; those of the row labels come first.
        rows: labels of each row, and its entries.
        wins: text of the last column, per row; empty without a comparison.
        caption: what the numbers are.
    """

    table: Table
    headers: tuple[str, ...]
    rows: tuple[tuple[Labels, tuple[Entry, ...]], ...]
    wins: tuple[str, ...]
    caption: str

    def texts(self) -> Iterator[tuple[str, ...]]:
        """Yield the rows as texts."""
        for at, (labels, entries) in enumerate(self.rows):
            yield (*labels, *[e.text for e in entries], *self.wins[at : at + 1])

    def markdown(self) -> str:
        """Return the table as markdown."""
        first = len(self.table.rows)
        rule = ["---"] * first + ["---:"] * (len(self.headers) - first)
        lines = [self.headers, rule, *self.texts()]
        body = "\n".join(f"| {' | '.join(map(_escaped, line))} |" for line in lines)
        return f"## {self.table.title}\n\n{body}\n\n{self.caption}\n"

    def as_dict(self) -> dict[str, object]:
        """Return the table as plain data, null for what is absent or NaN."""
        first = len(self.table.rows)
        names = self.headers[first : len(self.headers) - bool(self.wins)]
        return {
            "title": self.table.title,
            "caption": self.caption,
            "rows": [
                dict(zip(self.table.rows, labels, strict=True))
                | {
                    "values": {
                        name: _plain(entry.number)
                        for name, entry in zip(names, entries, strict=True)
                    },
                    "reference": {
                        name: entry.reference
                        for name, entry in zip(names, entries, strict=True)
                        if entry.reference is not None
                    },
                }
                | ({"wins": self.wins[at]} if self.wins else {})
                for at, (labels, entries) in enumerate(self.rows)
            ],
        }


def fill(table: Table, results: Results) -> Filled:
    """Return a table with the numbers of the cells."""
    cells = Selection(results, table.where)
    columns: list[Labels] = [()]
    if table.columns:
        columns = [(label,) for label in cells.labels(table.columns)]
    row_labels = list(itertools.product(*[cells.labels(axis) for axis in table.rows]))
    rows, wins = [], []
    for labels in row_labels:
        at = dict(zip(table.rows, labels, strict=True))
        entries = []
        for column in columns:
            place = {**at, **({table.columns: column[0]} if table.columns else {})}
            entries += [
                _entry(cells, place, value, table.reference.get(_key(table, labels, column, value)))
                for value in table.values
            ]
        if table.margin and table.columns:
            entries += _margins(table, labels, entries)
        rows.append((labels, tuple(entries)))
        if table.against:
            wins.append(_wins(table, cells, at))
    margin = [(table.margin.text,)] if table.margin and table.columns else []
    over = cells.left_over((*table.rows, *((table.columns,) if table.columns else ())))
    headers = [
        " ".join(filter(None, (*column, value.label))) or value.heading(over=bool(over))
        for column in (*columns, *margin)
        for value in table.values
    ]
    if table.against:
        headers.append(f"{table.better} than {' '.join(table.against)}")
    caption = _caption(table, over)
    return Filled(table, (*table.rows, *headers), tuple(rows), tuple(wins), caption)


class Selection:
    """The cells that a view looks at."""

    def __init__(self, results: Results, where: Where) -> None:
        self.results, self.where = results, where
        self.cells = [
            cell
            for cell in results.study.cells
            if all(cell.point[axis].label in labels for axis, labels in where.items())
        ]

    def labels(self, axis: str) -> Sequence[str]:
        """Return the labels of an axis that are looked at, in the order of `where`, if given."""
        return self.where.get(axis) or self.results.study.axes[axis].labels

    def left_over(self, shown: Labels) -> list[str]:
        """Return the axes, with the number of their labels, that statistics go over."""
        axes = [axis for axis in self.results.study.axes if axis not in shown]
        return [f"{axis} ({n})" for axis in axes if (n := len(self.labels(axis))) > 1]

    def at(self, place: Mapping[str, str]) -> Iterator[Cell]:
        """Yield the cells at a place in the grid."""
        wanted = place.items()
        for cell in self.cells:
            if all(cell.point[axis].label == label for axis, label in wanted):
                yield cell

    def number(self, cell: Cell, value: Value) -> float | None:
        """Return what a cell has, in SI units; NaN where its score is, None if it has none."""
        outcome = self.results.of(cell)
        if outcome is None or outcome.error or value.column not in outcome.numbers:
            return None
        found = outcome.numbers[value.column]
        return math.nan if found is None else float(found)

    def numbers(self, cells: Iterable[Cell], value: Value) -> list[float]:
        """Return what cells have, in SI units."""
        found = [self.number(cell, value) for cell in cells]
        return [number for number in found if number is not None]


def _key(table: Table, labels: Labels, column: Labels, value: Value) -> Labels:
    return (*labels, *column, *((value.label,) if len(table.values) > 1 else ()))


def _entry(
    cells: Selection, place: Mapping[str, str], value: Value, reference: float | None
) -> Entry:
    found = list(cells.at(place))
    numbers = cells.numbers(found, value)
    number = value.compute(numbers) if numbers else None
    return Entry(number, len(numbers), len(found), reference, value.digits)


def _margins(table: Table, labels: Labels, entries: Sequence[Entry]) -> Iterator[Entry]:
    """Yield a statistic over the columns, for each value."""
    count = len(table.values)
    statistic = table.margin or Statistic("mean")
    for at, value in enumerate(table.values):
        over = entries[at::count]
        numbers = [entry.number for entry in over if entry.number is not None]
        factor = value.of.factor(value.unit)
        found = statistic.of([n * factor for n in numbers], value.of) if numbers else None
        if found is not None and not (statistic.counts or statistic.shares):
            found /= factor
        key = _key(table, labels, (statistic.text,), value)
        used, expected = sum(e.used for e in over), sum(e.expected for e in over)
        yield Entry(found, used, expected, table.reference.get(key), value.digits)


def _wins(table: Table, cells: Selection, at: Mapping[str, str]) -> str:
    """Return in how many pairs, equal on all other axes, a row beats the one it is compared to."""
    if tuple(at.values()) == table.against:
        return ""
    value = table.values[0]
    other = dict(zip(table.rows, table.against, strict=True))
    rivals = {_rest(cell, table.rows): cells.number(cell, value) for cell in cells.at(other)}
    pairs = [
        (mine, theirs)
        for cell in cells.at(at)
        if (mine := cells.number(cell, value)) is not None
        and (theirs := rivals.get(_rest(cell, table.rows))) is not None
    ]
    won = sum((m > t) if table.better == "higher" else (m < t) for m, t in pairs)
    return f"{won} of {len(pairs)}"


def _rest(cell: Cell, rows: Labels) -> Labels:
    return tuple(point.label for axis, point in cell.point.items() if axis not in rows)


def _caption(table: Table, over: Sequence[str]) -> str:
    """Return what the numbers are, over what, and what stands in parentheses."""
    shown = [
        f"{value.label}: {heading}" if value.label else heading
        for value in table.values
        for heading in [value.heading(over=bool(over))]
    ]
    text = "; ".join(shown) + (f", over {' and '.join(over)}" if over else "")
    if table.reference:
        text += f"; in parentheses: {table.source or 'published'}"
    return text + "."


def _figure(number: float, digits: int) -> str:
    return "nan" if math.isnan(number) else f"{number:.{digits}f}"


def _plain(number: float | None) -> float | None:
    return number if number is not None and math.isfinite(number) else None


def _escaped(text: str) -> str:
    return text.replace("|", "\\|")
