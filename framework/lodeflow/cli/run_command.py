"""`lodeflow run`."""

from __future__ import annotations

import sys
from contextlib import AbstractContextManager, nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from lodeflow.cli.logs import log_to_stderr
from lodeflow.cli.options import GRAPH, JSON, overrides
from lodeflow.graph import load_graph
from lodeflow.graph.partition import split, unsplit
from lodeflow.supervisor.run import run
from lodeflow.supervisor.seen import Look
from lodeflow.supervisor.summary import Summary
from lodeflow.supervisor.supervise import supervise

if TYPE_CHECKING:
    from lodeflow.cli.report import Progress


@click.command()
@GRAPH
@overrides
@click.option("--record", metavar="PATH", help="Record to PATH instead of the graph's own place.")
@click.option("--no-record", is_flag=True, help="Record nothing.")
@click.option("--realtime", is_flag=True, help="Pace the data by its stamps.")
@click.option(
    "--duration",
    type=click.FloatRange(min=0, min_open=True),
    metavar="S",
    help="Seconds of event time to run for.",
)
@click.option(
    "--processes",
    type=click.Choice(["graph", "split", "one"]),
    default="graph",
    help="Processes: those of the graph file, one per node, or one. [default: graph]",
)
@click.option(
    "--only", multiple=True, metavar="GROUP", help="Run this group here; others run elsewhere."
)
@click.option(
    "--listen",
    multiple=True,
    metavar="[GROUP=]ENDPOINT",
    help="Where groups of other hosts link to, such as tcp/0.0.0.0:7447.",
)
@click.option(
    "--connect", multiple=True, metavar="ENDPOINT", help="Where a group of another host listens."
)
@click.option(
    "--zenoh-listen",
    multiple=True,
    metavar="[GROUP=]ENDPOINT",
    help="Where other programs can look in from other hosts, such as tcp/0.0.0.0:7450.",
)
@click.option(
    "--zenoh-connect",
    multiple=True,
    metavar="ENDPOINT",
    help="Where other programs, or a Zenoh router, listen.",
)
@click.option(
    "--zenoh-config",
    type=click.Path(dir_okay=False, exists=True, path_type=Path),
    help="Zenoh configuration: certificates, users, access control.",
)
@JSON
def command(
    graph: Path,
    overrides: dict[str, Any],
    record: str | None,
    no_record: bool,
    realtime: bool,
    duration: float | None,
    processes: str,
    only: tuple[str, ...],
    listen: tuple[str, ...],
    connect: tuple[str, ...],
    zenoh_listen: tuple[str, ...],
    zenoh_connect: tuple[str, ...],
    zenoh_config: Path | None,
    as_json: bool,
) -> int:
    """Run a graph to the end of its data, record it, and say what came of it.

    As fast as the data allows, unless --realtime paces it or a source is a live device. Ctrl-C
    ends the sources; what is on its way is finished and the recording is closed.
    """
    if record is not None and no_record:
        raise click.UsageError("--record and --no-record exclude each other")
    loaded = load_graph(graph, **overrides)
    for note in loaded.notes:
        click.echo(note, err=True)
    if processes == "split":
        loaded = split(loaded)
    elif processes == "one":
        loaded = unsplit(loaded)
    if loaded.processes:
        with _progress(forks=True) as progress:
            summary = supervise(
                loaded,
                only=[name for names in only for name in names.split(",")],
                listen=_endpoints(listen, only),
                connect=connect,
                open_to=_endpoints(zenoh_listen, only),
                outside=zenoh_connect,
                config=zenoh_config,
                record="" if no_record else record,
                speed=1.0 if realtime else None,
                duration=duration,
                command=sys.argv[1:],
                say=progress.say if progress else _say,
                progress=progress,
            )
        return _report(summary, as_json)
    if only or listen or connect:
        raise click.UsageError("--only, --listen and --connect need a graph with processes")
    for endpoint in zenoh_listen:
        if "=" in endpoint:
            raise click.UsageError(f"--zenoh-listen {endpoint}: this graph has no groups")
    log_to_stderr()
    with _progress() as progress:
        summary = run(
            loaded,
            record="" if no_record else record,
            speed=1.0 if realtime else None,
            duration=duration,
            progress=progress or (lambda counters, t: None),
            command=sys.argv[1:],
            look=Look(zenoh_listen, zenoh_connect, zenoh_config),
        )
    return _report(summary, as_json)


def _endpoints(listen: tuple[str, ...], only: tuple[str, ...]) -> dict[str, list[str]]:
    """Return the endpoints of each group: GROUP=ENDPOINT, or ENDPOINT where only one runs."""
    found: dict[str, list[str]] = {}
    for text in listen:
        group, equals, endpoint = text.partition("=")
        if not equals:
            if len(only) != 1 or "," in only[0]:
                raise click.UsageError(
                    f"{text}: several groups run here; say whose it is: GROUP={text}"
                )
            group, endpoint = only[0], text
        found.setdefault(group, []).append(endpoint)
    return found


# A run begins sooner without what draws tables: it is imported once there is something to show.


def _progress(*, forks: bool = False) -> AbstractContextManager[Progress | None]:
    """Return what shows on a terminal how far the run is; None elsewhere."""
    if not sys.stderr.isatty():
        return nullcontext()
    from lodeflow.cli.report import Progress

    return Progress(forks=forks)


def _say(group: str, line: str) -> None:
    click.echo(f"[{group}] {line}", err=True)


def _report(summary: Summary, as_json: bool) -> int:
    from lodeflow.cli.report import report

    return report(summary, as_json=as_json)
