"""`lodeflow recover`."""

from __future__ import annotations

from pathlib import Path

import click
from rich.text import Text

from lodeflow.cli.options import JSON
from lodeflow.cli.output import RESULT, print_json, table
from lodeflow.recording.columns import stream_of
from lodeflow.recording.recover import recover
from lodeflow.recording.recovery import Recovery


@click.command()
@click.argument("rec", metavar="REC", type=click.Path(dir_okay=False, path_type=Path))
@click.argument(
    "out", metavar="[OUT]", required=False, type=click.Path(dir_okay=False, path_type=Path)
)
@JSON
def command(rec: Path, out: Path | None, as_json: bool) -> None:
    """Mend a recording that was killed, cut off or damaged, into a new file OUT.

    OUT is REC's name with .recovered.mcap unless it is given; REC stays as it is. What is whole is
    kept, and what is lost is counted. A recording without damage is told so, and nothing written.
    """
    found = recover(rec, out)
    if as_json:
        print_json(found.as_dict())
    else:
        show(found)


def show(found: Recovery) -> None:
    """Print what was kept, and what was lost."""
    if found.out is None:
        RESULT.print(f"{found.source} is whole; nothing was written", soft_wrap=True, markup=False)
        return
    rows = table("stream", ">kept", ">up to t (s)", ">known lost")
    for topic in dict.fromkeys([*found.kept, *found.lost]):
        lost = found.lost.get(topic, 0)
        until = f"{found.until[topic] / 1e9:.6f}" if topic in found.until else ""
        cells = (stream_of(topic), str(found.kept.get(topic, 0)), until, str(lost or ""))
        rows.add_row(*map(Text, cells))
    RESULT.print(rows)
    RESULT.print()
    for line in lines(found):
        RESULT.print(line, soft_wrap=True, markup=False)
    RESULT.print(f"mended to {found.out}", soft_wrap=True, markup=False)


def lines(found: Recovery) -> list[str]:
    """Return what was lost, and up to when there is data."""
    said = [f"at byte {d.start}: {d.size} bytes lost: {d.what}" for d in found.damage]
    if found.tail and not found.complete:
        said.append(f"at the end: {found.tail} bytes lost: no record that is whole")
    elif found.tail:
        said.append(f"at the end: {found.tail} bytes left out: behind the data, and no index")
    if not said and found.complete:
        said.append("no bytes lost: only its index was missing or incomplete")
    elif not said:
        said.append("no bytes of the file lost; what a killed run had still in memory is not in it")
    if found.reached is None or found.begun is None:
        said.append("no messages were in what is whole")
    else:
        span = (found.reached - found.begun) / 1e9
        said.append(f"data up to t={found.reached / 1e9:.9g} s ({span:.6g} s of data)")
    return said
