"""`lodeflow top`."""

from __future__ import annotations

import click
from rich.console import Group, RenderableType

from lodeflow.cli.looking_in import rate, say, where
from lodeflow.cli.options import JSON
from lodeflow.cli.output import print_json, show_again, table
from lodeflow.clock import monotonic, sleep
from lodeflow.errors import RunError
from lodeflow.supervisor.looking import View, Where, run
from lodeflow.supervisor.vitals import Vitals, vitals


@click.command()
@click.argument("graph", required=False)
@click.option(
    "--interval",
    type=click.FloatRange(min=0.1, max=4.0),
    default=1.0,
    show_default=True,
    metavar="S",
    help="Seconds between two looks.",
)
@click.option("--once", is_flag=True, help="Look twice, show what was between, and end.")
@JSON
@where
def command(graph: str | None, interval: float, once: bool, as_json: bool, where: Where) -> int:
    """Show what a running graph does: rates, latencies, queues, losses, CPU and memory.

    A latency is measured from the source to a stream that nobody reads, or to the input of a
    node without outputs, where the run keeps the pace of its stamps.
    """
    with run(where, graph) as view, show_again() as show:
        before = view.ask("stats", window=interval)
        while True:
            looked = monotonic()
            sleep(interval)
            after = view.ask("stats", timeout=max(interval, 0.5), window=interval + 0.5)
            if not after:
                if view.is_over():
                    say([f"'{view.graph}' has ended"])
                    return 0
                raise RunError(f"'{view.graph}' does not answer any more")
            found = vitals(view.about, before, after)
            if as_json:
                print_json({"graph": view.graph, **found.as_dict()})
            else:
                show(as_tables(view, found, monotonic() - looked))
            if once or as_json:
                return 0
            before = {**before, **after}


def as_tables(view: View, found: Vitals, seconds: float) -> RenderableType:
    """Return what is shown of a while."""
    parts: list[RenderableType] = [
        f"{view.graph}: t = {found.reached / 1e9:.3f} s",
        "",
        _nodes(found),
        "",
        _processes(found),
    ]
    if found.paths:
        parts += ["", _paths(found)]
    parts += [f"group '{group}' does not answer" for group in found.silent]
    return Group(*parts)


def _nodes(found: Vitals) -> RenderableType:
    rows = table("node", ">steps", "stream", ">rate", ">waiting", ">unmatched", ">gated", ">lost")
    for name, node in found.nodes.items():
        lost = ", ".join(f"{count} {why}" for why, count in node.lost.items())
        counts = [str(n or "") for n in (node.waiting, node.unmatched, node.gated)]
        streams = list(node.sent.items()) or [("", 0.0)]
        (first, sent), *others = streams
        rows.add_row(name, rate(node.stepped), first, rate(sent), *counts, lost)
        for stream, sent in others:
            rows.add_row("", "", stream, rate(sent), "", "", "", "")
    return rows


def _processes(found: Vitals) -> RenderableType:
    rows = table("process", ">pid", ">CPU", ">memory", ">to send", ">to do", ">lost", ">foreign")
    for name, it in found.processes.items():
        rows.add_row(
            name,
            str(it.pid),
            f"{it.cpu:.1%}",
            f"{it.memory / 2**20:.0f} MiB",
            str(it.waiting or ""),
            str(it.arrived or ""),
            ", ".join(f"{count} {what}" for what, count in it.lost.items()),
            str(it.foreign or ""),
        )
    return rows


def _paths(found: Vitals) -> RenderableType:
    rows = table("from", "to", ">latency p50", ">p99", ">messages")
    for path in found.paths:
        rows.add_row(path.source, path.end, _latency(path.p50), _latency(path.p99), str(path.count))
    return rows


def _latency(value: float | None) -> str:
    if value is None:
        return ""
    return f"{value * 1e6:.0f} µs" if abs(value) < 1e-3 else f"{value * 1e3:.3g} ms"
