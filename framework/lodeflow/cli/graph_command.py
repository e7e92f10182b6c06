"""`lodeflow graph`."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from lodeflow.cli.options import GRAPH, overrides
from lodeflow.graph import draw, load_graph


@click.command()
@GRAPH
@overrides
@click.option("--format", "form", type=click.Choice(["text", "mermaid", "dot"]), default="text")
def command(graph: Path, overrides: dict[str, Any], form: Any) -> None:
    """Draw a graph: its nodes in order, their ports, message types, syncs and gates."""
    click.echo(draw(load_graph(graph, **overrides), form).rstrip())
