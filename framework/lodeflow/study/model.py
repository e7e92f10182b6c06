"""A study as its file describes it, and the cells that it is made of."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

from lodeflow.graph.layers import Option
from lodeflow.graph.model import Graph, Wire
from lodeflow.graph.tree import Scalar
from lodeflow.messages.units import Unit
from lodeflow.study.statistics import Statistic


@dataclass(frozen=True)
class Change:
    """What a point of an axis changes, or the study for all of its cells.

    Attributes:
        graph: another graph file.
        overlays: partial graph files.
        options: swaps, sets and args.
        recording: file whose streams are fed to the graph.
        start: nodes to compute from with a recording; none for all but sources.
    """

    graph: Path | None = None
    overlays: tuple[Path, ...] = ()
    options: tuple[Option, ...] = ()
    recording: Path | None = None
    start: tuple[str, ...] = ()

    def then(self, later: Change) -> Change:
        """Return both changes in one."""
        return Change(
            later.graph or self.graph,
            self.overlays + later.overlays,
            self.options + later.options,
            later.recording or self.recording,
            later.start or self.start,
        )


@dataclass(frozen=True)
class Point:
    """One value of an axis.

    Attributes:
        label: what tables show.
        value: what stands in the table of all cells: a number where the axis has numbers.
        change: what it does to the graph.
    """

    label: str
    value: Scalar
    change: Change


@dataclass(frozen=True)
class Axis:
    """One direction of the grid."""

    name: str
    points: tuple[Point, ...]

    @property
    def labels(self) -> tuple[str, ...]:
        """Labels of the points, in their order."""
        return tuple(point.label for point in self.points)


@dataclass(frozen=True)
class Column:
    """A number that cells have: a component of a score, or what the run cost.

    Attributes:
        name: "score.total_rmse"; "wall" and "data" are seconds of wall time and of event time.
        unit: its SI unit.
        integer: it is a whole number.
    """

    name: str
    unit: type[Unit]
    integer: bool = False

    @property
    def header(self) -> str:
        """Name and unit, as tables of recordings write them."""
        return f"{self.name} [{self.unit.symbol}]" if self.unit.symbol else self.name


@dataclass(frozen=True)
class Value:
    """A number that a table or a figure shows.

    Attributes:
        label: its name; "" where it is the only one.
        column: name of the column.
        of: the unit class of the column.
        unit: the spelling in which it is shown.
        statistic: over all cells that fall together.
        digits: after the point.
    """

    label: str
    column: str
    of: type[Unit]
    unit: str
    statistic: Statistic
    digits: int

    def compute(self, numbers: list[float]) -> float:
        """Return the statistic of numbers in SI units, in the unit that is shown."""
        found = self.statistic.of(numbers, self.of)
        plain = self.statistic.counts or self.statistic.shares
        return found if plain else found / self.of.factor(self.unit)

    def heading(self, *, over: bool) -> str:
        """Return what it is, with its unit, and with the statistic where it is over something."""
        if self.statistic.counts:
            return f"{self.column}, {self.statistic.text}"
        unit = "%" if self.statistic.shares else self.unit
        quantity = f"{self.column} [{unit}]" if unit else self.column
        return f"{quantity}, {self.statistic.text}" if over or self.statistic.shares else quantity


Where = Mapping[str, tuple[str, ...]]
"""The labels, by axis, of the cells that are looked at; an axis that is absent has all."""


@dataclass(frozen=True)
class Table:
    """A table over the cells.

    Attributes:
        name: of the table.
        title: what stands above it.
        rows: axes whose labels name the rows.
        columns: axis whose labels name the columns; None for one column per value.
        values: what is shown.
        where: which cells.
        margin: statistic over the columns, in a last column; None for none.
        against: label of the row that the others are paired with; "" for none.
        better: which of a pair wins.
        reference: published figures, by the labels of row, column and value.
        source: where they come from.
    """

    name: str
    title: str
    rows: tuple[str, ...]
    columns: str | None
    values: tuple[Value, ...]
    where: Where = field(default_factory=dict)
    margin: Statistic | None = None
    against: tuple[str, ...] = ()
    better: Literal["lower", "higher"] = "lower"
    reference: Mapping[tuple[str, ...], float] = field(default_factory=dict)
    source: str = ""


FigureKind = Literal["bars", "lines", "box"]


@dataclass(frozen=True)
class Figure:
    """A figure over the cells.

    Attributes:
        name: of the file.
        title: what stands above it.
        kind: bars and lines show the statistic, box shows how the cells spread.
        x: axis along x.
        series: axis that gives each label a colour; None for one.
        value: what is shown.
        where: which cells.
        log: the scale of y is logarithmic.
    """

    name: str
    title: str
    kind: FigureKind
    x: str
    series: str | None
    value: Value
    where: Where = field(default_factory=dict)
    log: bool = False


@dataclass(frozen=True, eq=False)
class Cell:
    """One run of a study.

    Attributes:
        point: its point on each axis.
        graph: the checked graph.
        change: all that makes it differ from the study's graph file.
        streams: whose last message is collected.
        key: names everything that decides its outcome.
    """

    point: Mapping[str, Point]
    graph: Graph
    change: Change
    streams: tuple[Wire, ...]
    key: str

    @property
    def name(self) -> str:
        """Return its place in the grid, as "filter=vqf trial=02"."""
        return " ".join(f"{axis}={point.label}" for axis, point in self.point.items()) or "all"


@dataclass(frozen=True)
class Study:
    """A checked study.

    Attributes:
        path: the file.
        name: of the study.
        files: the study file, graph files and overlays, to be kept with the results.
        axes: by name, in the order of the file; the last one varies fastest.
        cells: all of the grid.
        columns: by name, what cells have.
        tables: what is shown of them.
        figures: what is drawn of them.
        notes: what to tell the user although it is no mistake.
    """

    path: Path
    name: str
    files: tuple[Path, ...]
    axes: Mapping[str, Axis]
    cells: tuple[Cell, ...]
    columns: Mapping[str, Column]
    tables: tuple[Table, ...] = ()
    figures: tuple[Figure, ...] = ()
    notes: tuple[str, ...] = ()
