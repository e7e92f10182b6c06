"""The lines of a figure, read by column in one pass over each recording."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from lodeflow.errors import RecordingError
from lodeflow.plotting.decimation import Series, Spans, Stamps, Values
from lodeflow.plotting.request import Line, Panel
from lodeflow.recording.reader import Recording

NANOSECONDS = 1_000_000_000


@dataclass(frozen=True)
class Read:
    """What is drawn, and its axis of time.

    Attributes:
        points: stamps since the origin, ns, and values of each line, thinned.
        start: left edge, ns since the origin.
        end: right edge, ns since the origin.
        common: whether all recordings count from the same moment, and not each from its own start.
        origin: stamp at 0, ns, if all have one origin.
    """

    points: Mapping[Line, tuple[Stamps, Values]]
    start: int
    end: int
    common: bool
    origin: int


def read(
    recordings: Sequence[Recording],
    panels: Sequence[Panel],
    start: float | None = None,
    end: float | None = None,
) -> Read:
    """Return the lines of some panels; in memory they are as long as a figure is wide.

    Time counts from the first message of the recordings; where they do not overlap in time, from
    the first message of each, so that runs of different days lie over each other.

    Args:
        recordings: open for reading.
        panels: what to read.
        start: where to begin, s since the origin.
        end: where to end, s since the origin.

    Raises:
        RecordingError: a recording is damaged, or there is nothing to draw in that time.
    """
    spans = [_span(recording) for recording in recordings]
    common = max(first for first, _ in spans) <= min(last for _, last in spans)
    origins = [min(first for first, _ in spans) if common else first for first, _ in spans]
    lengths = [last - origin + 1 for (_, last), origin in zip(spans, origins, strict=True)]
    left = 0 if start is None else _ns(start)
    right = max(left + 1, max(lengths) if end is None else _ns(end))
    lines = [line for panel in panels for line in panel.lines]
    kept = {
        line: Spans() if line.quantity.modes else Series(left, right)
        for line in dict.fromkeys(lines)
    }
    for index, (recording, origin) in enumerate(zip(recordings, origins, strict=True)):
        first = None if start is None else origin + left
        last = None if end is None else origin + right
        for held, since in (
            (False, first),
            (True, None),
        ):  # a mode may hold on from any time before
            some = [e for e in kept if e.recording == index and bool(e.quantity.modes) == held]
            for blocks in recording.blocks({e.topic: e.kind for e in some}, since, last):
                for line in some:
                    if (block := blocks.get(line.topic)) is not None:
                        kept[line].add(block.t - origin, line.quantity.take(block))
    if not any(series.count for series in kept.values()):
        paths = ", ".join(str(recording.path) for recording in recordings)
        raise RecordingError(
            f"{paths}: nothing to draw from {left / NANOSECONDS:g} to {right / NANOSECONDS:g} s; "
            f"there are {max(lengths) / NANOSECONDS:g} s of data"
        )
    points = {line: series.points() for line, series in kept.items()}
    return Read(points, left, right, common, origins[0])


def _ns(value: float) -> int:
    return round(value * NANOSECONDS)


def _span(recording: Recording) -> tuple[int, int]:
    """Return the first and last log time of a recording.

    Raises:
        RecordingError: it is empty.
    """
    if recording.span is None:
        raise RecordingError(f"{recording.path}: nothing to draw, it has no messages")
    return recording.span


def modes_held(t: Stamps, values: Values, end: int) -> list[tuple[int, int, int]]:
    """Return a mode's spans as (value, from, to), ns; the last one is held to `end`."""
    edges = np.append(t, max(end, int(t[-1]) if len(t) else end))
    return list(zip(values.astype(int).tolist(), t.tolist(), edges[1:].tolist(), strict=True))
