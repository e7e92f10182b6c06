"""What commands print: results to standard output, everything else to standard error."""

from __future__ import annotations

import json
import logging
from typing import Any

import click
from rich.console import Console
from rich.table import Table

from lodeflow.messages.message import Message

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


def log_to_stderr() -> None:
    """Show what nodes log."""
    handler = logging.StreamHandler()
    handler.setFormatter(logging.Formatter("%(name)s: %(levelname)s: %(message)s"))
    logger = logging.getLogger("lodeflow")
    logger.addHandler(handler)
    logger.setLevel(logging.INFO)
