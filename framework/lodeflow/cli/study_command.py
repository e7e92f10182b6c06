"""`lodeflow study`."""

from __future__ import annotations

import datetime
import os
import sys
from pathlib import Path
from typing import Any

import click
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn
from rich.text import Text

from lodeflow.cli.options import JSON
from lodeflow.cli.output import RESULT, STATUS, print_json, print_whole, table
from lodeflow.clock import monotonic, wall_time
from lodeflow.study.figures import draw, matplotlib
from lodeflow.study.load import load_study
from lodeflow.study.model import Cell
from lodeflow.study.runner import run_cells
from lodeflow.study.store import Keep, Results, finished, write, writing
from lodeflow.study.table import Filled, fill
from lodeflow.study.worker import Outcome

MOST_SHOWN = 10
"""Failures and warnings that are printed; the table of cells has all of them."""


@click.command()
@click.argument("study", metavar="STUDY", type=click.Path(dir_okay=False, path_type=Path))
@click.option(
    "--jobs",
    type=click.IntRange(min=1),
    metavar="N",
    help="Cells that run at a time. [default: the number of processors]",
)
@click.option(
    "--to",
    "folder",
    type=click.Path(file_okay=False, path_type=Path),
    metavar="FOLDER",
    help="Results go here. [default: recordings/studies/NAME]",
)
@click.option("--fresh", is_flag=True, help="Run finished cells again.")
@click.option("--no-figures", is_flag=True, help="Draw no figures.")
@JSON
def command(
    study: Path, jobs: int | None, folder: Path | None, fresh: bool, no_figures: bool, as_json: bool
) -> int:
    """Run a graph over a grid of changes, and collect the scores into tables and figures.

    A cell that is finished is not run again, unless something that decides its outcome has
    changed: its graph, its parameters, the code of its plugins, or its data. A cell that fails
    does not stop the others. Ctrl-C keeps what is finished.
    """
    begun = datetime.datetime.fromtimestamp(wall_time() / 1e9, tz=datetime.UTC)
    started = monotonic()
    loaded = load_study(study)
    if loaded.figures and not no_figures:
        matplotlib()  # before hours of work
    folder = folder or Path("recordings", "studies", loaded.name)
    with writing(folder), finished(folder, fresh=fresh) as (known, keep):
        results = Results(loaded)
        results.outcomes.update(
            {cell.key: known[cell.key] for cell in loaded.cells if cell.key in known}
        )
        todo = list({c.key: c for c in loaded.cells if c.key not in results.outcomes}.values())
        try:
            _run(loaded.name, todo, results, jobs or _processors(), keep)
        except KeyboardInterrupt:
            left = sum(cell.key not in results.outcomes for cell in loaded.cells)
            STATUS.print(
                f"stopped; {len(loaded.cells) - left} of {len(loaded.cells)} cells are done, "
                "the same command goes on with the others",
                soft_wrap=True,
            )
            return 130
        tables = [fill(table, results) for table in loaded.tables]
        files = write(results, folder, sys.argv[1:], begun.isoformat())
        if tables:
            text = f"# {loaded.name}\n\n" + "\n".join(t.markdown() for t in tables)
            (folder / "tables.md").write_text(text, encoding="utf-8")
            files.append(folder / "tables.md")
        for figure in () if no_figures else loaded.figures:
            files += draw(figure, results, folder)
    counts = {
        "cells": len(loaded.cells),
        "run": len(todo),
        "failed": len(results.failed),
        "seconds": monotonic() - started,
    }
    if as_json:
        print_json(_as_dict(results, tables, folder, files, counts))
    else:
        _show(results, tables, folder, counts)
    _tell(results)
    return 1 if results.failed else 0


def _processors() -> int:
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def _run(name: str, todo: list[Cell], results: Results, jobs: int, keep: Keep) -> None:
    """Run what is not finished, with a bar on a terminal."""
    if not todo:
        return
    bar = Progress(
        TextColumn(name),
        BarColumn(),
        MofNCompleteColumn(),
        TimeRemainingColumn(),
        TextColumn("{task.fields[failed]}", style="red"),
        console=STATUS,
        transient=True,
        disable=not STATUS.is_terminal,
    )
    failed = 0
    with bar:
        task = bar.add_task("", total=len(todo), failed="")

        def done(cell: Cell, outcome: Outcome) -> None:
            nonlocal failed
            results.outcomes[cell.key] = outcome
            if outcome.error:
                failed += 1
            else:
                keep(cell, outcome)
            bar.update(task, advance=1, failed=f"{failed} failed" if failed else "")

        run_cells(todo, jobs, done)


def _show(results: Results, tables: list[Filled], folder: Path, counts: dict[str, Any]) -> None:
    for filled in tables:
        first = len(filled.table.rows)
        shown = table(
            *[name if at < first else f">{name}" for at, name in enumerate(filled.headers)]
        )
        for row in filled.texts():
            shown.add_row(*map(Text, row))
        RESULT.print(Text(filled.table.title, style="bold"))
        print_whole(shown)
        RESULT.print(Text(filled.caption, style="dim"), soft_wrap=True)
        RESULT.print()
    reused = counts["cells"] - counts["run"]
    line = f"{counts['cells']} cells: {counts['run']} run"
    line += f", {reused} finished before" if reused else ""
    line += f", {counts['failed']} failed" if counts["failed"] else ""
    RESULT.print(f"{line}, in {counts['seconds']:.1f} s")
    RESULT.print(f"results in {folder}", soft_wrap=True)


def _tell(results: Results) -> None:
    """Print what failed, and what nodes warned of, to standard error."""
    for cell, outcome in results.failed[:MOST_SHOWN]:
        STATUS.print(Text(f"{cell.name}: {outcome.error}", style="red"), soft_wrap=True)
    if len(results.failed) > MOST_SHOWN:
        STATUS.print(f"... and {len(results.failed) - MOST_SHOWN} more failed", style="red")
    warned = [(cell, log) for cell in results.study.cells if (found := results.of(cell))
              for log in found.logs]  # fmt: skip
    for cell, log in warned[:MOST_SHOWN]:
        STATUS.print(f"{cell.name}: {log}", soft_wrap=True)
    if len(warned) > MOST_SHOWN:
        STATUS.print(f"... and {len(warned) - MOST_SHOWN} more warnings")


def _as_dict(
    results: Results,
    tables: list[Filled],
    folder: Path,
    files: list[Path],
    counts: dict[str, Any],
) -> dict[str, Any]:
    headers = results.headers()
    return {
        "study": results.study.name,
        "folder": str(folder),
        "files": [str(file) for file in files],
        **counts,
        "failures": {cell.name: outcome.error for cell, outcome in results.failed},
        "tables": {filled.table.name: filled.as_dict() for filled in tables},
        "rows": [dict(zip(headers, row, strict=True)) for row in results.rows()],
    }
