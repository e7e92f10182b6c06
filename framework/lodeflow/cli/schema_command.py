"""`lodeflow schema`."""

from __future__ import annotations

import json

import click

from lodeflow.graph.json_schema import schema


@click.command()
def command() -> None:
    """Print a JSON Schema of graph files, made from the installed plugins, for editors."""
    click.echo(json.dumps(schema(), indent=2, ensure_ascii=False))
