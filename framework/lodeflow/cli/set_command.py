"""`lodeflow set`."""

from __future__ import annotations

import click

from lodeflow.cli.changing import change
from lodeflow.cli.looking_in import where
from lodeflow.cli.options import JSON
from lodeflow.supervisor.looking import Where


@click.command()
@click.argument("changes", nargs=-1, required=True, metavar="NODE.PARAM=V...")
@click.option("--graph", metavar="NAME", help="Which running graph, if there are several.")
@where
@JSON
def command(changes: tuple[str, ...], graph: str | None, where: Where, as_json: bool) -> int:
    """Set parameters of a running graph.

    They are checked as in the graph file; a wrong one is refused, and nothing changes. All are in
    force from one event time on: rows from then on go to fresh nodes. The recording has the
    change, and a replay repeats it.
    """
    return change(where, graph, changes, (), as_json=as_json)
