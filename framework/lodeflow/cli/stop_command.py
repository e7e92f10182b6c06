"""`lodeflow stop`."""

from __future__ import annotations

import os
import signal
from contextlib import suppress

import click

from lodeflow.cli.looking_in import say, where
from lodeflow.clock import monotonic, sleep
from lodeflow.errors import RunError
from lodeflow.supervisor.interrupt import GRACE
from lodeflow.supervisor.looking import View, Where, run

PATIENCE = 5.0
"""Seconds that a run has to end."""


@click.command()
@click.argument("graph", required=False)
@where
def command(graph: str | None, where: Where) -> int:
    """End a running graph as Ctrl-C does: what is on its way is finished, its recording closed."""
    with run(where, graph) as view:
        view.ask("stop")
        begun, interrupted = monotonic(), False
        while not _is_over(view):
            waited = monotonic() - begun
            if waited > PATIENCE:
                raise RunError(
                    f"'{view.graph}' has been asked to stop, and has not in {waited:.0f} s"
                )
            if waited > GRACE and view.pid is not None and not interrupted:
                interrupted = True  # a node does not come back: it is interrupted where it is
                with suppress(ProcessLookupError):
                    os.kill(view.pid, signal.SIGTERM)
            sleep(0.02)
    say([f"stopped '{view.graph}'"])
    return 0


def _is_over(view: View) -> bool:
    if view.running is not None:
        return view.is_over()
    return not view.onlooker.ask("about", graph=view.graph, timeout=0.5)
