"""`lodeflow run`."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import click
from rich.console import Group
from rich.live import Live
from rich.text import Text

from lodeflow.cli.options import GRAPH, JSON, overrides
from lodeflow.cli.output import RESULT, STATUS, log_to_stderr, print_json, score_lines, table
from lodeflow.clock import monotonic
from lodeflow.graph import load_graph
from lodeflow.graph.partition import split, unsplit
from lodeflow.runtime.plan import Plan
from lodeflow.supervisor.run import run
from lodeflow.supervisor.seen import Look
from lodeflow.supervisor.summary import Summary
from lodeflow.supervisor.supervise import supervise


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
        STATUS.print(note, soft_wrap=True)
    if processes == "split":
        loaded = split(loaded)
    elif processes == "one":
        loaded = unsplit(loaded)
    if loaded.processes:
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
            say=_say,
        )
        return report(summary, as_json=as_json)
    if only or listen or connect:
        raise click.UsageError("--only, --listen and --connect need a graph with processes")
    for endpoint in zenoh_listen:
        if "=" in endpoint:
            raise click.UsageError(f"--zenoh-listen {endpoint}: this graph has no groups")
    log_to_stderr()
    with Progress() as progress:
        summary = run(
            loaded,
            record="" if no_record else record,
            speed=1.0 if realtime else None,
            duration=duration,
            progress=progress,
            command=sys.argv[1:],
            look=Look(zenoh_listen, zenoh_connect, zenoh_config),
        )
    return report(summary, as_json=as_json)


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


def _say(group: str, line: str) -> None:
    STATUS.print(Text(f"[{group}] {line}"), soft_wrap=True)


def report(summary: Summary, *, as_json: bool = False) -> int:
    """Print a summary, the error that ended the run to standard error; return the exit code."""
    if as_json:
        print_json(summary.as_dict())
    else:
        show(summary)
    if summary.error is not None:
        STATUS.print(Text(f"lodeflow: {summary.error}", style="red"), soft_wrap=True)
    return summary.exit_code


def show(summary: Summary) -> None:
    """Print a summary: samples per stream, losses, scores, the recording's path."""
    streams = table("stream", ">samples", ">rate", "")
    for name, counters in summary.counters.items():
        for port, count in counters.sent.items():
            stream = name if port == "out" else f"{name}.{port}"
            rate = f"{(count - 1) / summary.span:.4g} Hz" if summary.span > 0 < count - 1 else ""
            streams.add_row(stream, str(count), rate, "")
    RESULT.print(streams)
    notes = []
    for name, counters in summary.counters.items():
        if counters.unmatched:
            notes.append(f"{name}: {counters.unmatched} rows without partner")
        if counters.gated:
            notes.append(f"{name}: {counters.gated} rows held back by a gate")
        notes += [f"{name}: LOST {count} ({why})" for why, count in counters.lost.items()]
    for note in notes:
        RESULT.print(note, style="yellow" if "LOST" in note else None)
    if summary.scores:
        RESULT.print()
        scores = table("score", ">value")
        for name, score in summary.scores.items():
            for row in score_lines(name, score):
                scores.add_row(*row)
        RESULT.print(scores)
    RESULT.print()
    speed = f", {_figures(summary.span / summary.wall)} times real time" if summary.wall else ""
    RESULT.print(f"{summary.span:.6g} s of data in {summary.wall:.2f} s{speed}")
    if summary.stopped:
        RESULT.print("stopped before the end of the data")
    if summary.recording is not None:
        RESULT.print(f"recorded to {summary.recording}", soft_wrap=True)


def _figures(ratio: float) -> str:
    return f"{ratio:.0f}" if ratio >= 10 else f"{ratio:.2g}"


class Progress:
    """Rates and event time on a terminal, while the run goes on; nothing elsewhere."""

    def __init__(self) -> None:
        self._live = Live(console=STATUS, transient=True, auto_refresh=False)
        self._shown = False
        self._before: tuple[float, int] = (monotonic(), 0)

    def __enter__(self) -> Progress:
        if STATUS.is_terminal:
            self._live.start()
            self._shown = True
        return self

    def __exit__(self, *_: object) -> None:
        if self._shown:
            self._live.stop()

    def __call__(self, plan: Plan, t: int) -> None:
        if not self._shown:
            return
        now, total = monotonic(), 0
        rows = table("node", ">stepped", ">sent", ">lost")
        for name, node in plan.nodes.items():
            counters = node.counters
            sent = sum(counters.sent.values())
            total += sent
            lost = sum(counters.lost.values())
            rows.add_row(name, str(counters.stepped), str(sent), str(lost or ""))
        then, before = self._before
        rate = (total - before) / max(now - then, 1e-9)
        line = f"t = {t / 1e9:.3f} s, {rate:,.0f} messages/s"
        self._before = (now, total)
        self._live.update(Group(rows, line), refresh=True)
