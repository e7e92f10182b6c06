"""What the commands share that look into running graphs."""

from __future__ import annotations

import functools
import os
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import click

from lodeflow.cli.message_types import declare_installed
from lodeflow.cli.output import STATUS
from lodeflow.errors import RunError
from lodeflow.messages.message import by_ros_name
from lodeflow.registry import load_object
from lodeflow.supervisor.looking import View, Where, graph_of, is_key, run, split_name
from lodeflow.transport.keys import DATA
from lodeflow.transport.onlooker import Onlooker, Sighting
from lodeflow.transport.viewing import StreamView

LOOK_EVERY = 0.25
"""Seconds between two looks whether a run that says nothing is still there."""


def where(function: Callable[..., Any]) -> Callable[..., Any]:
    """Add --connect and --zenoh-config; the command gets them as `where`."""

    @click.option(
        "--connect",
        multiple=True,
        metavar="ENDPOINT",
        help="Where a run on another host, or a Zenoh router, listens, such as tcp/robot:7450.",
    )
    @click.option(
        "--zenoh-config",
        type=click.Path(dir_okay=False, exists=True, path_type=Path),
        help="Zenoh configuration: certificates, user and password.",
    )
    @functools.wraps(function)
    def wrapped(*, connect: tuple[str, ...], zenoh_config: Path | None, **others: Any) -> Any:
        return function(where=Where(connect, zenoh_config), **others)

    return wrapped


class Watched:
    """Streams that are watched, over one session.

    Args:
        onlooker: the session.
        view: the run that they belong to; None for keys of other programs.
        keys: key expressions.
    """

    def __init__(self, onlooker: Onlooker, view: View | None, keys: Sequence[str]) -> None:
        self.onlooker, self.view = onlooker, view
        self.streams = {key: StreamView(key) for key in keys if "*" not in key}
        self.over = False
        for key in keys:
            onlooker.watch(key)

    def take(self, timeout: float) -> Iterator[tuple[StreamView, Sighting]]:
        """Yield the puts that have come, each with its stream, which has counted it."""
        found = self.onlooker.take(min(timeout, LOOK_EVERY))
        for sighting in found:
            stream = self.streams.get(sighting.key)
            if stream is None:
                stream = self.streams[sighting.key] = StreamView(sighting.key)
            if stream.see(sighting):
                yield stream, sighting
        if found:
            self.over = all(stream.ended for stream in self.streams.values())
        elif self.view is not None:
            self.over = self.over or self.view.is_over()

    def notes(self) -> list[str]:
        """Return what was not got, one line for each stream that there is something to say of."""
        lines = []
        for stream in self.streams.values():
            said = [
                f"missed {stream.missed} of {stream.missed + stream.puts} puts"
                * bool(stream.missed),
                f"its sender began anew {stream.begun_anew} times" * bool(stream.begun_anew),
                f"{stream.undecodable} puts are not what their type says"
                * bool(stream.undecodable),
                f"{stream.foreign} puts of strangers ignored" * bool(stream.foreign),
            ]
            if any(said):
                lines.append(f"{name_of(stream.key)}: {'; '.join(filter(None, said))}")
        return lines


@contextmanager
def watching(names: Sequence[str], where: Where) -> Iterator[Watched]:
    """Watch streams by their names or keys; without names, all of the run.

    Raises:
        RunError: no such run or stream, or names of several runs.
    """
    declare_installed()
    found = [split_name(name) for name in names]
    foreign = [name for name in names if is_key(name) and not name.startswith((DATA, "*"))]
    if foreign and where.connect:
        onlooker = Onlooker(where.connect, where.config)
        try:
            yield Watched(onlooker, None, [key for _, key in found])
        finally:
            onlooker.close()
        return
    if foreign:
        raise RunError(f"{foreign[0]} is no stream of lodeflow; say by --connect where it is put")
    graphs = {graph or graph_of(stream) for graph, stream in found} - {None}
    if len(graphs) > 1:
        raise RunError(f"one run at a time, not {' and '.join(sorted(map(str, graphs)))}")
    with run(where, next(iter(graphs), None)) as view:
        for group in view.silent:
            STATUS.print(f"group '{group}' does not answer", markup=False)
        if view.running is not None:
            _declare_types_of(view)
        keys: list[str] = []
        for name, (_, stream) in zip(names, found, strict=True):
            keys += [stream] if is_key(name) else view.keys(stream)
        yield Watched(view.onlooker, view, keys or [stream.key for stream in view.streams.values()])


def _declare_types_of(view: View) -> None:
    """Import the modules of plugins in files of this folder: they may declare message types."""
    for about in view.about.values():
        unknown = {stream["type"] for stream in about["streams"].values()} - by_ros_name.keys()
        for use in about["nodes"].values() if unknown else ():
            if ":" in use:
                with suppress(Exception):  # else they are shown as what they are: bytes
                    load_object(use)


def name_of(key: str) -> str:
    """Return the name of a stream in its graph: "node.port", or "node"; another key as it is."""
    chunks = key.split("/")
    if len(chunks) != 4 or chunks[0] != DATA:
        return key
    return chunks[2] if chunks[3] == "out" else f"{chunks[2]}.{chunks[3]}"


def say(lines: Sequence[str]) -> None:
    """Print lines to standard error."""
    for line in lines:
        STATUS.print(line, markup=False, soft_wrap=True)


def write(text: str) -> bool:
    """Print to standard output at once; return whether somebody still reads it."""
    try:
        sys.stdout.write(text)
        sys.stdout.flush()
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # for the flush at exit
        return False
    return True


def duration(seconds: float) -> str:
    """Return a duration as people say it."""
    if seconds < 60:
        return f"{seconds:.3g} s"
    minutes, rest = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours} h {minutes} min" if hours else f"{minutes} min {rest} s"


def rate(value: float) -> str:
    """Return messages per second for a table."""
    return f"{value:.4g} Hz" if value else ""
