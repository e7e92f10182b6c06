"""`lodeflow info`."""

from __future__ import annotations

import json
from pathlib import Path

import click
from rich.table import Table
from rich.text import Text

from lodeflow.cli.message_types import declare_installed
from lodeflow.cli.options import JSON
from lodeflow.cli.output import RESULT, print_json, table
from lodeflow.errors import RecordingError
from lodeflow.recording.columns import stream_of
from lodeflow.recording.events import EVENT_TOPICS
from lodeflow.recording.info import Info, info
from lodeflow.sync import END, NEVER


@click.command()
@click.argument("rec", metavar="REC", type=click.Path(dir_okay=False, path_type=Path))
@click.option("--graph", "only_graph", is_flag=True, help="Print the attached graph, and no more.")
@JSON
def command(rec: Path, only_graph: bool, as_json: bool) -> None:
    """Say what is in a recording: streams, rates, gaps, losses, provenance, the attached graph.

    A gap is a step longer than three times the median step of the stream.
    """
    declare_installed()
    found = info(rec)
    if only_graph:
        if found.graph is None:
            raise RecordingError(f"{rec}: no graph is attached")
        click.echo(found.graph, nl=not found.graph.endswith("\n"))
    elif as_json:
        print_json(found.as_dict())
    else:
        show(found)


def show(found: Info) -> None:
    """Print a table of the streams, and what else is known."""
    RESULT.print(streams(found))
    RESULT.print()
    for line in lines(found):
        RESULT.print(line, soft_wrap=True, markup=False)


def streams(found: Info) -> Table:
    """Return the table of the streams."""
    rows = table("stream", "type", ">count", ">first (s)", ">last (s)", ">rate", ">gaps")
    for topic, stream in found.streams.items():
        ends = [
            "" if stamp is None else f"{stamp / 1e9:.6f}" for stamp in (stream.first, stream.last)
        ]
        rate = "" if stream.rate is None else f"{stream.rate:.4g} Hz"
        gaps = f"{stream.gaps} ({stream.gap_time / 1e9:.4g} s)" if stream.gaps else ""
        if stream.unordered:
            gaps = f"{gaps} {stream.unordered} not forward".lstrip()
        kind = stream.type.rpartition("/")[2]  # in full it is too wide for a terminal
        if stream.encoding != "cdr":
            kind = f"{kind} ({stream.encoding or 'no encoding'})"
        cells = (stream_of(topic), kind, str(stream.count), *ends, rate, gaps)
        rows.add_row(*map(Text, cells))
    return rows


def lines(found: Info) -> list[str]:
    """Return what is known beside the streams."""
    said = []
    if found.losses is None and not found.provenance:
        said.append("losses: unknown, for it is not the recording of a run")
    elif found.losses is None:
        said.append("losses: unknown, for the run did not write its summary")
    elif found.losses:
        said += [
            f"LOST at {node}: {count} ({why})"
            for node, reasons in found.losses.items()
            for why, count in reasons.items()
        ]
    elif not found.missing:
        said.append("losses: none")
    said += [
        f"MISSING at {gap.reader}, owed by {gap.sender}: '{gap.stream}'"
        f"{' from the start' if gap.begin == NEVER else f' from {gap.begin / 1e9:.6f} s'}"
        f"{' to the end' if gap.end == END else f' to {gap.end / 1e9:.6f} s'}"
        for gap in found.missing
    ]
    if found.recovery is not None:
        said.append(f"mended from {found.recovery.get('source')}")
    for name, value in found.provenance.items():
        said.append(f"{name}: {value if isinstance(value, str) else json.dumps(value)}")
    said += [
        f"listed only: '{stream_of(topic)}' {stream.unread}"
        for topic, stream in found.streams.items()
        if stream.unread and topic not in EVENT_TOPICS
    ]
    others = [name for name in found.attachments if name != "graph.yaml"]
    said += [f"attached: {name} ({found.attachments[name]} bytes)" for name in others]
    graph = "yes ('lodeflow info --graph' prints it)" if found.graph is not None else "no"
    said.append(f"attached graph: {graph}")
    return said
