"""Streams of recordings as whole columns, found by what a tool declares that it reads."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from lodeflow.errors import RecordingError, did_you_mean
from lodeflow.messages.message import Message
from lodeflow.node import InputPort
from lodeflow.recording.columns import stream_of, topic_of
from lodeflow.recording.reader import Recording

GAP = 3_600_000_000_000
"""Nanoseconds between two recordings where the second does not follow the first by itself."""


@dataclass(frozen=True)
class Whole:
    """What was read of some recordings.

    Attributes:
        blocks: of each port all rows, or None for an optional port without a stream.
        used: for each recording, the topic of each port, and how many messages it gave.
    """

    blocks: Mapping[str, Message | None]
    used: Sequence[Mapping[str, tuple[str, int]]]


def read_whole(
    paths: Sequence[Path], ports: Sequence[InputPort], chosen: Mapping[str, str]
) -> Whole:
    """Return the streams that ports name, each as one block over all recordings.

    A port takes the only stream of its type, or the one chosen for it.

    Args:
        paths: recordings, in the order in which their rows come.
        ports: names and types, and whether they may be empty.
        chosen: stream of a port, named as in a graph or by its topic; "" leaves the port empty.

    Raises:
        RecordingError: a stream is missing, or several would do; a recording cannot be read.
    """
    names = [port.name for port in ports]
    for name in chosen:
        if name not in names:
            near = did_you_mean(name, names)
            raise RecordingError(f"reads no '{name}'{near} (it reads {', '.join(names)})")
    parts: dict[str, list[Message]] = {port.name: [] for port in ports}
    used: list[dict[str, tuple[str, int]]] = []
    end: int | None = None
    for path in paths:
        with Recording(path) as recording:
            topics = {port.name: _topic(recording, port, chosen) for port in ports}
            blocks = {
                port.name: port.type.concat(list(recording.stream(topic, port.type)))
                for port in ports
                if (topic := topics[port.name]) is not None
            }
        if used and blocks.keys() != used[0].keys():
            (name, *_) = sorted(blocks.keys() ^ used[0].keys())
            there, lacking = (path, paths[0]) if name in blocks else (paths[0], path)
            raise RecordingError(
                f"{there} has a stream for '{name}', and {lacking} has none; take recordings of "
                f"the same streams, or leave it out with --stream {name}="
            )
        filled = [block for block in blocks.values() if len(block)]
        start = min((int(block.t[0]) for block in filled), default=0)
        shift = 0 if end is None or start > end else end + GAP - start
        for name, block in blocks.items():
            parts[name].append(block.replace(t=block.t + shift))
        last = max((int(block.t[-1]) + shift for block in filled), default=0)
        end = last if end is None else max(end, last)
        used.append({name: (str(topics[name]), len(block)) for name, block in blocks.items()})
    found: dict[str, Any] = {
        port.name: port.type.concat(parts[port.name]) if parts[port.name] else None
        for port in ports
    }
    return Whole(found, used)


def _topic(recording: Recording, port: InputPort, chosen: Mapping[str, str]) -> str | None:
    """Return the topic that a port reads; None leaves it empty."""
    name, kind = port.name, port.type
    if (wanted := chosen.get(name)) is not None:
        if not wanted and port.optional:
            return None
        topic = topic_of(wanted)
        recording.stream(topic, kind)  # says what is wrong with it
        return topic
    fitting = [topic for topic, found in recording.topics.items() if found.type == kind.ros]
    filled = [topic for topic in fitting if recording.topics[topic].messages] or fitting
    if len(filled) == 1:
        return filled[0]
    if not filled and port.optional:
        return None
    if not filled:
        listed = ", ".join(
            f"{stream_of(t)} ({found.type})" for t, found in recording.topics.items()
        )
        raise RecordingError(
            f"{recording.path}: no stream of {kind.__name__} for '{name}' (streams: "
            f"{listed or 'none'})"
        )
    choice = " or ".join(f"--stream {name}={stream_of(topic)}" for topic in filled)
    raise RecordingError(
        f"{recording.path}: {len(filled)} streams of {kind.__name__} for '{name}'; write {choice}"
    )
