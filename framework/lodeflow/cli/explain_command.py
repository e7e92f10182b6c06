"""`lodeflow explain`."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from lodeflow.cli.options import GRAPH, overrides
from lodeflow.graph.explanation import explain


@click.command()
@GRAPH
@click.argument("target", metavar="NODE.PARAM")
@overrides
def command(graph: Path, target: str, overrides: dict[str, Any]) -> None:
    """Say where a parameter of a graph gets its value, and what it means."""
    click.echo(explain(graph, target, **overrides).rstrip())
