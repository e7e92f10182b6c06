"""`lodeflow hz`."""

from __future__ import annotations

import itertools
import statistics
from dataclasses import dataclass
from typing import Any

import click
from rich.table import Table

from lodeflow.cli.looking_in import Watched, name_of, rate, say, watching, where
from lodeflow.cli.options import JSON
from lodeflow.cli.output import print_json, show_again, table
from lodeflow.clock import monotonic
from lodeflow.supervisor.looking import Where
from lodeflow.transport.onlooker import Sighting
from lodeflow.transport.viewing import StreamView


@dataclass(frozen=True)
class Pulse:
    """How the puts of a stream came within a while.

    Attributes:
        messages: how many messages.
        rate: of their coming, Hz; None where too few came.
        stamp_rate: by their stamps, Hz of event time; likewise.
        jitter: standard deviation of the time between two puts, s.
        longest: longest time between two puts, s.
        missed: puts that did not come.
        foreign: puts of strangers, or that are not what they should be.
    """

    messages: int
    rate: float | None
    stamp_rate: float | None
    jitter: float | None
    longest: float | None
    missed: int
    foreign: int


@click.command()
@click.argument("names", nargs=-1, metavar="[[GRAPH/]NODE[.PORT]|KEY]...")
@click.option(
    "--window",
    type=click.FloatRange(min=0.1),
    default=2.0,
    show_default=True,
    metavar="S",
    help="Seconds to measure over.",
)
@click.option("--once", is_flag=True, help="Measure one window, and end.")
@JSON
@where
def command(names: tuple[str, ...], window: float, once: bool, as_json: bool, where: Where) -> int:
    """Measure the rate, jitter and gaps of streams as they come here; of all without a name.

    The jitter is the standard deviation of the time between two puts. What this host is too slow
    to take is missed here, and nowhere else.
    """
    with watching(names, where) as watched, show_again() as show:
        while True:
            seconds, pulses = measure(watched, window)
            if as_json:
                graph = None if watched.view is None else watched.view.graph
                streams = {name: vars(pulse) for name, pulse in pulses.items()}
                print_json({"graph": graph, "seconds": seconds, "streams": streams})
            else:
                show(as_table(pulses))
            if once or as_json:
                return 0
            if watched.over:
                say(["the run has ended"])
                return 0


def measure(watched: Watched, window: float) -> tuple[float, dict[str, Pulse]]:
    """Watch streams for so many seconds; return the time it was, and how each came."""
    begun = monotonic()
    before = {stream.key: _ignored(stream) for stream in watched.streams.values()}
    came: dict[str, list[Sighting]] = {key: [] for key in watched.streams}
    while (left := begun + window - monotonic()) > 0 and not watched.over:
        for stream, sighting in watched.take(left):
            came.setdefault(stream.key, []).append(sighting)
    pulses = {}
    for key, stream in watched.streams.items():
        missed, foreign = before.get(key, (0, 0))
        now_missed, now_foreign = _ignored(stream)
        pulses[name_of(key)] = pulse(came.get(key, []), now_missed - missed, now_foreign - foreign)
    return monotonic() - begun, pulses


def pulse(came: list[Sighting], missed: int, foreign: int) -> Pulse:
    """Return how some puts of one stream came."""
    frames = [sighting.frame for sighting in came]
    counts = [1 if frame is None else frame.rows for frame in frames]
    steps = [b.at - a.at for a, b in itertools.pairwise(came)]
    stamped = [frame for frame in frames if frame is not None]
    span = sum(steps)
    event = (stamped[-1].bound - 1 - stamped[0].first) / 1e9 if stamped else 0.0
    return Pulse(
        sum(counts),
        sum(counts[1:]) / span if span > 0 else None,
        (sum(counts) - 1) / event if event > 0 and not missed else None,
        statistics.pstdev(steps) if len(steps) > 1 else None,
        max(steps, default=None),
        missed,
        foreign,
    )


def _ignored(stream: StreamView) -> tuple[int, int]:
    return stream.missed, stream.foreign + stream.undecodable


def as_table(pulses: dict[str, Pulse]) -> Table:
    """Return the table of a window."""
    rows = table(
        "stream", ">messages", ">rate", ">by stamps", ">jitter", ">longest", ">missed", ">foreign"
    )
    for name, it in pulses.items():
        rows.add_row(
            name,
            str(it.messages),
            rate(it.rate or 0.0),
            rate(it.stamp_rate or 0.0),
            _milliseconds(it.jitter),
            _milliseconds(it.longest),
            str(it.missed or ""),
            str(it.foreign or ""),
        )
    return rows


def _milliseconds(value: Any) -> str:
    return "" if value is None else f"{value * 1e3:.3g} ms"
