"""`lodeflow compare`."""

from __future__ import annotations

from pathlib import Path

import click
from rich.text import Text

from lodeflow.cli.message_types import declare_installed
from lodeflow.cli.options import JSON
from lodeflow.cli.output import RESULT, print_json, table
from lodeflow.errors import MessageError
from lodeflow.recording.columns import stream_of
from lodeflow.recording.compare import compare
from lodeflow.recording.comparison import Comparison, StreamComparison


@click.command()
@click.argument("a", metavar="A", type=click.Path(dir_okay=False, path_type=Path))
@click.argument("b", metavar="B", type=click.Path(dir_okay=False, path_type=Path))
@click.option(
    "--tolerance",
    "accepted",
    multiple=True,
    metavar="X|STREAM.FIELD=X",
    help="Accept differences up to X in every float field, or in one (X may have a unit).",
)
@JSON
def command(a: Path, b: Path, accepted: tuple[str, ...], as_json: bool) -> int:
    """Compare two recordings. Exit 0 if they are the same, 1 if not.

    The same means: each data stream has the same schema and the same sequence of stamps and
    payloads, to the byte. Order between streams, chunks, provenance and logs do not count.
    Message numbers count from 0.
    """
    general: float | None = None
    single: dict[str, float | str] = {}
    for text in accepted:
        name, equals, value = text.partition("=")
        if equals:
            single[name] = value
            continue
        try:
            general = float(text)
        except ValueError:
            raise click.UsageError(
                f"--tolerance {text}: give a number, or STREAM.FIELD=X with X in the field's unit"
            ) from None
    declare_installed()
    try:
        found = compare(a, b, tolerance=general, tolerances=single)
    except MessageError as error:
        raise click.UsageError(str(error)) from error
    if as_json:
        print_json(found.as_dict())
    else:
        show(found)
    return 0 if found.same else 1


def show(found: Comparison) -> None:
    """Print a table of the streams, what differs in each, and what may explain it."""
    rows = table("stream", ">in A", ">in B", "")
    for topic, stream in found.streams.items():
        a, b = (
            str(count) if kind or count else "-"
            for kind, count in zip(stream.types, stream.counts, strict=True)
        )
        rows.add_row(*map(Text, (stream_of(topic), a, b, stream.verdict)))
    RESULT.print(rows)
    for topic, stream in found.streams.items():
        if not stream.same or stream.largest:
            RESULT.print()
            for line in details(stream_of(topic), stream):
                RESULT.print(line, soft_wrap=True, markup=False)
    RESULT.print()
    for note in found.notes:
        RESULT.print(note, soft_wrap=True, markup=False)
    differing = sum(not stream.same for stream in found.streams.values())
    if differing:
        RESULT.print(f"not the same: {differing} of {len(found.streams)} streams differ")
    elif any(stream.unequal for stream in found.streams.values()):
        RESULT.print("the same within the tolerance")
    else:
        RESULT.print("the same")


def details(name: str, stream: StreamComparison) -> list[str]:
    """Return how two streams differ, as lines."""
    if stream.problem:
        kinds = " and ".join(stream.types) if all(stream.types) else "".join(stream.types)
        return [f"{name}: {stream.problem} ({kinds})"]
    lines = []
    if stream.first is not None:
        lines.append(f"{name}: first difference: {stream.first}")
    counts = []
    if stream.unequal:
        counts.append(f"{stream.unequal} of {stream.shared} shared messages are not equal")
    if stream.beyond != stream.unequal:
        counts.append(f"{stream.beyond} of them beyond the tolerance")
    counts += [f"{n} only in {side}" for n, side in zip(stream.lone, "AB", strict=True) if n]
    if stream.paired == "number":
        counts.append("paired by number, for log times do not strictly increase")
    lines.append(f"{name}: {', '.join(counts)}")
    lines += [
        f"{name}: largest difference of {field}: {largest}"
        for field, largest in stream.largest.items()
        if largest.value or largest.unknown
    ]
    return lines
