"""The results folder: what is finished, and the table of all cells."""

from __future__ import annotations

import csv
import fcntl
import importlib
import json
import os
import shutil
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from lodeflow.errors import RunError
from lodeflow.recording.provenance import host, versions
from lodeflow.study.key import code_of
from lodeflow.study.model import Cell, Column, Study
from lodeflow.study.worker import Outcome

FINISHED = "finished.jsonl"
"""One line per finished cell, written as it ends."""
CELLS = "cells"


@dataclass
class Results:
    """A study and what came of its cells, by key."""

    study: Study
    outcomes: dict[str, Outcome] = field(default_factory=dict)

    def of(self, cell: Cell) -> Outcome | None:
        """Return what came of a cell; None if it was not run."""
        return self.outcomes.get(cell.key)

    @property
    def failed(self) -> list[tuple[Cell, Outcome]]:
        """Cells that failed."""
        pairs = [(cell, self.of(cell)) for cell in self.study.cells]
        return [(cell, outcome) for cell, outcome in pairs if outcome and outcome.error]

    def rows(self) -> Iterator[list[Any]]:
        """Yield a row per cell: its place in the grid, its numbers in SI units, its error."""
        for cell in self.study.cells:
            outcome = self.of(cell) or Outcome({}, "not run")
            values = [point.value for point in cell.point.values()]
            numbers = [outcome.numbers.get(name) for name in self.study.columns]
            yield [*values, *numbers, outcome.error]

    def headers(self) -> list[str]:
        """Return the names of the columns of `rows`."""
        columns = [column.header for column in self.study.columns.values()]
        return [*self.study.axes, *columns, "error"]


Keep = Callable[[Cell, Outcome], None]
"""Keeps a finished cell, at once."""


@contextmanager
def writing(folder: Path) -> Iterator[None]:
    """Make a folder, and tell what cannot be written there.

    Raises:
        RunError: with the file and the reason.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
        yield
    except OSError as error:
        what = f"{error.filename or folder}: cannot be written: {error.strerror}"
        raise RunError(what) from error


@contextmanager
def finished(folder: Path, *, fresh: bool) -> Iterator[tuple[dict[str, Outcome], Keep]]:
    """Open what is finished, for one study at a time.

    Args:
        folder: is there.
        fresh: forget what is finished.

    Yields:
        The outcome of each finished cell by its key, and what keeps a further one.

    Raises:
        RunError: another process writes to the folder.
    """
    with (folder / FINISHED).open("a+", encoding="utf-8") as file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            raise RunError(f"{folder}: another 'lodeflow study' is writing here") from None
        if fresh:
            file.truncate(0)
        file.seek(0)
        text = file.read()
        if text and not text.endswith("\n"):  # a line that was cut off by a kill
            file.write("\n")

        def keep(cell: Cell, outcome: Outcome) -> None:
            line = {
                "key": cell.key,
                "cell": {axis: point.label for axis, point in cell.point.items()},
                "numbers": outcome.numbers,
                "logs": outcome.logs,
            }
            file.write(json.dumps(line, ensure_ascii=False, allow_nan=False) + "\n")
            file.flush()
            os.fsync(file.fileno())

        yield dict(_read(text)), keep


def _read(text: str) -> Iterator[tuple[str, Outcome]]:
    for line in text.splitlines():
        try:
            found = json.loads(line)
            yield found["key"], Outcome(found["numbers"], "", tuple(found["logs"]))
        except (ValueError, KeyError, TypeError):
            continue  # cut off by a kill: that cell is run again


def write(results: Results, folder: Path, command: Sequence[str], started: str) -> list[Path]:
    """Write the table of all cells, the files of the study and its provenance; return the files."""
    study = results.study
    written = [_csv(results, folder / f"{CELLS}.csv")]
    if parquet := _parquet(results, folder / f"{CELLS}.parquet"):
        written.append(parquet)
    (folder / "study").mkdir(exist_ok=True)
    names = [file.name for file in study.files]
    for number, file in enumerate(study.files):
        name = file.name if names.count(file.name) == 1 else f"{number}-{file.name}"
        kept = folder / "study" / name
        shutil.copyfile(file, kept)
        written.append(kept)
    about = folder / "provenance.json"
    text = json.dumps(provenance(study, command, started), indent=2, ensure_ascii=False)
    about.write_text(text + "\n", encoding="utf-8")
    return [*written, about]


def provenance(study: Study, command: Sequence[str], started: str) -> dict[str, Any]:
    """Return what, beside the files of the study, decides its results."""
    modules = {node.plugin.__module__ for cell in study.cells for node in cell.graph.nodes.values()}
    packages = set().union(*[code_of(module)[1] for module in modules])
    return {
        "study": study.name,
        "command": list(command),
        "started": started,
        **host(),
        "versions": versions(packages),
        "axes": {name: list(axis.labels) for name, axis in study.axes.items()},
        "args": _args(study),
        "notes": list(study.notes),
    }


def _args(study: Study) -> dict[str, list[Any]]:
    """Return the values that each arg of the graphs takes, seeds among them."""
    found: dict[str, list[Any]] = {}
    for cell in study.cells:
        for name, value in cell.graph.args.items():
            values = found.setdefault(name, [])
            if value not in values:
                values.append(value)
    return found


def _csv(results: Results, path: Path) -> Path:
    with path.open("w", encoding="utf-8", newline="") as file:
        rows = csv.writer(file, lineterminator="\n")
        rows.writerow(results.headers())
        rows.writerows(results.rows())
    return path


def _parquet(results: Results, path: Path) -> Path | None:
    """Write the table as Parquet; None without the package for it."""
    try:
        pa: Any = importlib.import_module("pyarrow")
        pq: Any = importlib.import_module("pyarrow.parquet")
    except ImportError:
        return None
    headers, rows = results.headers(), list(results.rows())
    kinds = _kinds(results.study.columns)
    columns = {}
    for at, header in enumerate(headers):
        cells = [row[at] for row in rows]
        kind = kinds.get(header)
        if kind is None and any(isinstance(cell, str) for cell in cells):
            cells = [None if cell is None else str(cell) for cell in cells]
        columns[header] = pa.array(cells, type=getattr(pa, kind)() if kind else None)
    pq.write_table(pa.table(columns), path)
    return path


def _kinds(columns: Mapping[str, Column]) -> dict[str, str]:
    return {c.header: "int64" if c.integer else "float64" for c in columns.values()}
