"""`lodeflow check`."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from lodeflow.cli.options import overrides
from lodeflow.errors import GraphError
from lodeflow.graph import load_graph
from lodeflow.study.kind import is_study


@click.command()
@click.argument("graphs", nargs=-1, required=True, type=click.Path(dir_okay=False, path_type=Path))
@overrides
def command(graphs: tuple[Path, ...], overrides: dict[str, Any]) -> int:
    """Check graph and study files: all errors, each with its place. Exit 1 if there are any."""
    problems = 0
    for path in graphs:
        try:
            if is_study(path):
                from lodeflow.study.load import load_study  # takes long, and graphs need it not

                study = load_study(path)
                click.echo(f"{path}: {len(study.cells)} cells, good")
                continue
            graph = load_graph(path, **overrides)
        except GraphError as error:
            click.echo(str(error), err=True)
            problems += len(error.problems)
        else:
            for note in graph.notes:
                click.echo(note, err=True)
            click.echo(f"{path}: {len(graph.nodes)} nodes, good")
    return 1 if problems else 0
