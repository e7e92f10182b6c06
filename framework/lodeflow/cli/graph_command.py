"""`lodeflow graph`."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from lodeflow.cli.looking_in import where
from lodeflow.cli.options import overrides
from lodeflow.clock import sleep
from lodeflow.graph import load_graph
from lodeflow.graph.drawing import draw
from lodeflow.supervisor.looking import Where, run
from lodeflow.supervisor.vitals import vitals


@click.command()
@click.argument("graph", required=False)
@overrides
@click.option("--format", "form", type=click.Choice(["text", "mermaid", "dot"]), default="text")
@click.option(
    "--live", is_flag=True, help="Draw a running graph, named GRAPH, with the rates of its streams."
)
@where
def command(
    graph: str | None, overrides: dict[str, Any], form: Any, live: bool, where: Where
) -> None:
    """Draw a graph: its nodes in order, their ports, message types, syncs and gates.

    GRAPH is a file, or with --live the name of a running graph, which may be left out where only
    one runs.
    """
    if live:
        if any(overrides.values()):
            raise click.UsageError("--live draws what runs; it takes no overrides")
        click.echo(_running(where, graph, form).rstrip())
        return
    if graph is None:
        raise click.UsageError("name a graph file, or give --live for a running graph")
    if where != Where():
        raise click.UsageError("--connect and --zenoh-config go with --live")
    click.echo(draw(load_graph(Path(graph), **overrides), form).rstrip())


def _running(where: Where, graph: str | None, form: str, seconds: float = 1.0) -> str:
    """Return the drawing of a running graph, with rates measured over so many seconds."""
    with run(where, graph) as view:
        before = view.ask("stats")
        sleep(seconds)
        rates = vitals(view.about, before, view.ask("stats")).rates
        notes = {name: f"{rate:.4g} Hz" for name, rate in rates.items()}
        group = next(iter(view.about))
        (answer,) = view.ask("drawing", group=group, format=form, notes=notes).values()
        return str(answer["drawing"])
