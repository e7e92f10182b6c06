"""`lodeflow ls`."""

from __future__ import annotations

import datetime
from typing import Any

import click

from lodeflow.cli.looking_in import duration, rate, say, where
from lodeflow.cli.options import JSON
from lodeflow.cli.output import RESULT, print_json, table
from lodeflow.clock import wall_time
from lodeflow.supervisor import rundir
from lodeflow.supervisor.looking import View, Where, close, runs


@click.command()
@click.argument("graph", required=False)
@click.option("-l", "--long", is_flag=True, help="Streams too, with their types and rates.")
@click.option("--endpoints", is_flag=True, help="Print where any Zenoh program can look in.")
@JSON
@where
def command(graph: str | None, long: bool, endpoints: bool, as_json: bool, where: Where) -> int:
    """List the running graphs; with a name or -l, their streams.

    The rate of a stream is that of its stamps since the start, as in the summary of a run.
    """
    if endpoints:
        found = [run for run in rundir.running() if graph in (None, run.graph)]
        click.echo("\n".join(endpoint for run in found for endpoint in run.endpoints))
        return 0
    if graph is None and not long and not where.connect:
        running = [_brief(run) for run in rundir.running()]
        if as_json:
            print_json(running)
        elif not running:
            say(["no graph is running here"])
        else:
            _show(running)
        return 0
    views = runs(where, graph)
    try:
        if not long and graph is None:
            brief = [_told(view) for view in views]
            print_json(brief) if as_json else _show(brief)
            return 0
        full = [{**_told(view), "streams": _streams(view), "silent": view.silent} for view in views]
    finally:
        close(views)
    if as_json:
        print_json(full)
        return 0
    for one in full:
        _show([one])
        _show_streams(one)
    return 0


def _brief(run: rundir.Running) -> dict[str, Any]:
    """Return what the run directory says of a run."""
    begun = datetime.datetime.fromisoformat(run.started).timestamp()
    return {
        "graph": run.graph,
        "pid": run.pid,
        "seconds": wall_time() / 1e9 - begun,
        "processes": {g: list(n) for g, n in zip(run.groups, run.nodes, strict=True)},
        "endpoints": run.endpoints,
    }


def _told(view: View) -> dict[str, Any]:
    """Return what is known of a run from here."""
    if view.running is not None:
        return _brief(view.running)
    told = list(view.about.values())
    return {
        "graph": view.graph,
        "pid": None,
        "seconds": max(about["seconds"] for about in told),
        "processes": {about["group"]: list(about["nodes"]) for about in told},
        "endpoints": [],
    }


def _streams(view: View) -> list[dict[str, Any]]:
    stats = view.ask("stats")
    spans = [(told["first"], told["last"]) for told in stats.values() if told["first"] is not None]
    span = (max(b for _, b in spans) - min(a for a, _ in spans)) / 1e9 if spans else 0.0
    rates = {
        name: (count - 1) / span
        for told in stats.values()
        for node in told["nodes"].values()
        for name, count in node["sent"].items()
        if count > 1 and span > 0
    }
    return [
        {
            "name": stream.name,
            "type": stream.type,
            "process": stream.group,
            "rate": rates.get(stream.name),
            "key": stream.key,
        }
        for stream in view.streams.values()
    ]


def _show(found: list[dict[str, Any]]) -> None:
    rows = table("graph", ">pid", ">nodes", ">running", "processes")
    for one in found:
        nodes = sum(map(len, one["processes"].values()))
        rows.add_row(
            one["graph"],
            str(one["pid"] or ""),
            str(nodes),
            duration(one["seconds"]),
            ", ".join(one["processes"]),
        )
    RESULT.print(rows)


def _show_streams(one: dict[str, Any]) -> None:
    RESULT.print()
    rows = table("stream", "type", ">rate", "process")
    for stream in one["streams"]:
        rows.add_row(stream["name"], stream["type"], rate(stream["rate"] or 0.0), stream["process"])
    RESULT.print(rows)
    say([f"group '{group}' does not answer" for group in one["silent"]])
    RESULT.print()
