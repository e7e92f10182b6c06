"""Study files to checked studies: every cell's graph is checked before the first one runs."""

from __future__ import annotations

import itertools
import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from lodeflow.errors import GraphError, LodeflowError, did_you_mean
from lodeflow.graph.load import load_graph_with, read_file
from lodeflow.graph.model import Graph, Wire
from lodeflow.graph.problems import Origin, Problems, join, show
from lodeflow.graph.reading import is_file, missing, title
from lodeflow.graph.tree import Tree, parse
from lodeflow.messages.message import Message
from lodeflow.messages.units import Second
from lodeflow.messages.vocabulary import Score
from lodeflow.recording.columns import components
from lodeflow.recording.reader import Recording
from lodeflow.recording.replay import replaying, without_effect
from lodeflow.study.axes import MOST_POINTS, Axes
from lodeflow.study.changes import CHANGES, Changes, expand
from lodeflow.study.key import key_of
from lodeflow.study.model import Axis, Cell, Change, Column, Point, Study
from lodeflow.study.views import Views

FORMAT = 1
"""The version of the file format that this code reads."""
KEYS = ("lodeflow_study", "name", *CHANGES, "axes", "scores", "tables", "figures")


def load_study(path: str | Path, environment: Mapping[str, str] = os.environ) -> Study:
    """Return the checked study of a file.

    Args:
        path: the study file; paths in it start from its folder.
        environment: what ${NAME} in capitals stands for.

    Raises:
        GraphError: with all problems of the study, and of the graphs of its cells.
        RecordingError: a recording that cells replay cannot be read.
    """
    path, problems = Path(path), Problems()
    origin = Origin(str(path), 0, ())
    text = read_file(path, origin, problems)
    tree = None if text is None else parse(text, origin, problems)
    if tree is None or not is_file(tree, "study", "lodeflow_study", FORMAT, KEYS, problems):
        raise problems.error()
    tree = expand(tree, environment, problems)
    name = title(tree, KEYS, problems)
    changes = Changes(path.parent, problems)
    base = changes.change(tree, "")
    axes = Axes(changes).read(tree.find("axes"))
    if tree.find("graph") is None:
        missing(tree, "graph", "the graph file that the cells run", KEYS, problems)
        raise problems.error()
    wrong = list(problems.error().problems)
    grid = _Grid(base, axes)
    if grid.size > MOST_POINTS:
        wrong.append(f"{path}: axes: {grid.size} cells; a study has at most {MOST_POINTS}")
        raise GraphError(wrong)
    wrong += grid.clashes()
    cells = _cells(grid, wrong) if base.graph else []
    columns: dict[str, Column] = {}
    views = Problems()
    if cells:
        cells, columns = _collected(cells, tree.find("scores"), views)
    found = Views(axes, columns, views)
    tables = tuple(found.tables(tree.find("tables"))) if cells else ()
    figures = tuple(found.figures(tree.find("figures"))) if cells else ()
    wrong += views.error().problems
    if wrong:
        raise GraphError(_once(wrong))
    notes = tuple(dict.fromkeys(note for cell in cells for note in cell.graph.notes))
    files = grid.files(path)
    return Study(path, name, files, axes, tuple(cells), columns, tables, figures, notes)


def _once(problems: Sequence[str]) -> list[str]:
    """Return what many cells say of one value once."""
    by_place: dict[str, str] = {}
    for problem in problems:
        by_place.setdefault(": ".join(problem.split(": ", 2)[:2]), problem)
    return list(by_place.values())


class _Grid:
    """The product of the axes over a base."""

    def __init__(self, base: Change, axes: Mapping[str, Axis]) -> None:
        self.base, self.axes = base, axes

    @property
    def size(self) -> int:
        """Number of cells."""
        size = 1
        for axis in self.axes.values():
            size *= len(axis.points)
        return size

    def cells(self) -> Iterator[tuple[dict[str, Point], Change]]:
        """Yield (point on each axis, change of the graph)."""
        for points in itertools.product(*[axis.points for axis in self.axes.values()]):
            change = self.base
            for point in points:
                change = change.then(point.change)
            yield dict(zip(self.axes, points, strict=True)), change

    def files(self, path: Path) -> tuple[Path, ...]:
        """Return the study file, and all graph files and overlays."""
        changes = [self.base, *(p.change for a in self.axes.values() for p in a.points)]
        named = [file for c in changes for file in ((c.graph,) if c.graph else ()) + c.overlays]
        return tuple(dict.fromkeys([path, *named]))

    def clashes(self) -> Sequence[str]:
        """Return where two axes change the same thing: one of them would have no effect."""
        problems = Problems()
        owners: dict[tuple[str, str], str] = {}
        for axis in self.axes.values():
            for point in axis.points:
                for option in point.change.options:
                    owner = owners.setdefault((option.kind, option.target), axis.name)
                    if owner != axis.name:
                        what = f"the axis '{owner}' gives a value to '{option.target}' as well"
                        problems.add(option.place, join("axes", axis.name), what)
        return problems.error().problems


def _cells(grid: _Grid, wrong: list[str]) -> list[Cell]:
    """Return the cells that check, and add what is wrong with the others."""
    found = []
    for point, change in grid.cells():
        try:
            found.append(_cell(point, change))
        except GraphError as error:
            wrong += error.problems
    return found


def _cell(point: Mapping[str, Point], change: Change) -> Cell:
    """Return a checked cell, whose graph is that of the replay if it is one."""
    path = change.graph
    if path is None:
        raise LodeflowError("a cell has no graph")
    graph = load_graph_with(path, change.overlays, change.options)
    if change.recording is None:
        return Cell(point, graph, change, (), "")
    with Recording(change.recording) as recording:
        replay = replaying(graph, recording, start=change.start, complete=False)
    options = [o for o in change.options if o.kind in ("set", "swap")]
    wrong = without_effect(replay, [(str(o.place), o.target.partition(".")[0]) for o in options])
    if wrong:
        raise GraphError(wrong)
    return Cell(point, replace(replay.graph, notes=graph.notes), change, (), "")


def _collected(
    cells: Sequence[Cell], tree: Tree | None, problems: Problems
) -> tuple[list[Cell], dict[str, Column]]:
    """Return the cells with the streams that are collected and their keys, and all columns."""
    columns = {name: Column(name, Second) for name in ("wall", "data")}
    wanted = _wanted(cells, tree, problems)
    finished = []
    for cell in cells:
        streams = []
        for wire in cell.graph.streams():
            kind = _port_type(cell.graph, wire)
            if wire in wanted if wanted is not None else issubclass(kind, Score):
                streams.append(wire)
                for column in columns_of(wire, kind):
                    columns.setdefault(column.name, column)
        finished.append(replace(cell, streams=tuple(streams)))
    if not len(problems):
        finished = [replace(cell, key=key_of(cell)) for cell in finished]
    return finished, columns


def _wanted(cells: Sequence[Cell], tree: Tree | None, problems: Problems) -> set[Wire] | None:
    """Return the streams that `scores` names; None for all scores."""
    if tree is None or tree.value is None:
        return None
    known = {str(wire): wire for cell in cells for wire in cell.graph.streams()}
    found = set()
    for item in tree.items or (tree,):
        if item.value in known:
            found.add(known[str(item.value)])
        else:
            near = did_you_mean(str(item.value), known) or f" (streams: {', '.join(known)})"
            item.refuse(problems, "scores", f"no stream is called {show(item.plain())}{near}")
    return found


def _port_type(graph: Graph, wire: Wire) -> type[Message]:
    ports = graph.nodes[wire.node].plugin.spec.outputs
    return next(port.type for port in ports if port.name == wire.port)


def columns_of(wire: Wire, kind: type[Message]) -> list[Column]:
    """Return a column per component of a stream's messages."""
    stream = str(wire)
    return [
        Column(f"{stream}.{name}", field.unit, field.integer)
        for field in kind.fields
        for name in components(field)
    ]
