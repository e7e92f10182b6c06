"""`lodeflow plot`."""

from __future__ import annotations

import contextlib
from collections.abc import Sequence
from pathlib import Path

import click

from lodeflow.cli.message_types import declare_installed
from lodeflow.cli.output import RESULT, STATUS
from lodeflow.plotting.figure import draw, format_of, show, write
from lodeflow.plotting.read import read
from lodeflow.plotting.request import Request
from lodeflow.plotting.style import load
from lodeflow.recording.reader import Recording


@click.command()
@click.argument("what", metavar="REC... [STREAM[.FIELD]]...", nargs=-1, required=True)
@click.option(
    "--to",
    type=click.Path(dir_okay=False, path_type=Path),
    metavar="FILE",
    help="Write a .png, .svg or .pdf; without it, open a window.",
)
@click.option("--from", "start", type=float, metavar="S", help="Begin at S seconds.")
@click.option("--until", "end", type=float, metavar="S", help="End at S seconds.")
@click.option("--euler", is_flag=True, help="Show quaternions as heading, pitch and roll.")
@click.option("--si", is_flag=True, help="Show rad and tesla, not degrees and µT.")
def command(
    what: tuple[str, ...],
    to: Path | None,
    start: float | None,
    end: float | None,
    euler: bool,
    si: bool,
) -> None:
    """Plot time series of one recording, or of several over each other.

    What ends in .mcap, or is a file, is a recording. The other arguments name what to
    plot: STREAM (as in the graph, or its topic) for all its fields, STREAM.FIELD for one, or
    STREAM.FIELD.x for a component. A stream of attitudes also has .heading, .pitch and
    .roll. Without names, an overview is drawn.

    Equal fields share a panel. Modes are shaded spans. Angles are shown in degrees.
    Times are seconds since the first message.
    """
    paths, names = split(what)
    if start is not None and end is not None and not start < end:
        raise click.UsageError(f"--from {start:g} must lie before --until {end:g}")
    if to is not None:
        format_of(to)
    load()  # before long reading
    declare_installed()
    with contextlib.ExitStack() as stack:
        recordings = [stack.enter_context(Recording(path)) for path in paths]
        request = Request(recordings, si=si, euler=euler)
        panels = request.panels(names) if names else request.overview()
        found = read(recordings, panels, start, end)
    for note in request.notes:
        STATUS.print(note, soft_wrap=True)
    called = told_apart(paths)
    if to is None:
        show(panels, found, called)
        return
    write(draw(panels, found, called), to)
    RESULT.print(str(to), soft_wrap=True)


def split(what: Sequence[str]) -> tuple[list[Path], list[str]]:
    """Return the recordings among some arguments, each once, and the names.

    Raises:
        UsageError: there is no recording among them.
    """
    paths = [Path(text) for text in what if text.endswith(".mcap") or Path(text).is_file()]
    names = [text for text in what if Path(text) not in paths]
    if not paths:
        raise click.UsageError(f"no recording among {', '.join(what)}; name a file (.mcap)")
    return list(dict.fromkeys(paths)), names


def told_apart(paths: Sequence[Path]) -> list[str]:
    """Return the shortest names of files that differ: without suffix, with folders if needed."""
    for depth in range(1, max(len(path.parts) for path in paths) + 1):
        names = ["/".join(path.with_suffix("").parts[-depth:]) for path in paths]
        if len(set(names)) == len(names):
            return names
    return [str(path) for path in paths]
