"""What commands print: results to standard output, everything else to standard error."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import click
from rich.console import Console, RenderableType
from rich.live import Live
from rich.measure import Measurement
from rich.table import Table

from lodeflow.messages.message import Message
from lodeflow.messages.units import Radian, RadPerSecond, Unit

RESULT = Console(highlight=False, markup=False)
STATUS = Console(stderr=True, highlight=False, markup=False)


def print_json(value: Any) -> None:
    """Print one JSON object on standard output."""
    click.echo(json.dumps(value, indent=2, ensure_ascii=False, allow_nan=False, default=str))


def table(*columns: str) -> Table:
    """Return an empty table; columns whose name begins with ">" are right-aligned."""
    made = Table(box=None, pad_edge=False, header_style="bold")
    for column in columns:
        made.add_column(
            column.removeprefix(">"), justify="right" if column.startswith(">") else "left"
        )
    return made


def print_whole(shown: Table) -> None:
    """Print a table at the width that it needs, however narrow the terminal is."""
    wide = RESULT.options.update(max_width=100_000)
    width = max(RESULT.width, Measurement.get(RESULT, wide, shown).maximum)
    Console(width=width, highlight=False, markup=False).print(shown)


def shown_unit(unit: type[Unit]) -> tuple[float, str]:
    """Return the unit in which people are shown a quantity, as its factor and symbol."""
    spelling = {Radian: "deg", RadPerSecond: "deg/s"}.get(unit, unit.symbol)
    return 1 / unit.factor(spelling), spelling


@contextmanager
def show_again() -> Iterator[Callable[[RenderableType], None]]:
    """Yield what prints a table anew: over the one before on a terminal, else below it."""
    if not RESULT.is_terminal:
        yield RESULT.print
        return
    with Live(console=RESULT, auto_refresh=False, vertical_overflow="visible") as live:
        yield lambda shown: live.update(shown, refresh=True)


def score_lines(name: str, score: Message) -> list[tuple[str, str]]:
    """Return a score as (what, value) rows, in the units that people read."""
    rows = []
    for field, value in zip(score.fields, score.values(), strict=True):
        if shown := field.unit.shown:
            space = "" if shown == "°" else " "
            text = f"{value / field.unit.factor(shown):.3f}{space}{shown}"
        elif field.integer:
            text = str(value)
        else:
            text = f"{value:.6g} {field.unit.symbol}".rstrip()
        rows.append((f"{name}: {field.name.replace('_', ' ')}", text))
    return rows
