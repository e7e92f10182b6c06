"""What is in a recording, from its summary and its indexes: no message is unpacked."""

from __future__ import annotations

import json
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lodeflow.errors import MessageError
from lodeflow.recording.events import GAP, RecordedGap
from lodeflow.recording.fit import Channels, encoding, kind_of, type_name
from lodeflow.recording.mcap.file import McapFile
from lodeflow.recording.mcap.raw import parts, topics
from lodeflow.sync import END, NEVER

LONG = 3.0
"""A step longer than this many median steps is a gap; told to a thousandth."""
_PER_E = 1000  # bins for a factor e: steps in one bin differ by a thousandth


@dataclass
class StreamInfo:
    """One stream.

    Attributes:
        type: name of its type, in ROS 2 files the ROS 2 name.
        count: messages.
        encoding: of the messages; "cdr" in ROS 2 files.
        unread: why no message type of lodeflow reads it; "" if one does.
        first: stamp of the first, ns; None without messages.
        last: stamp of the last, ns; None without messages.
        gaps: steps longer than three times the median step.
        gap_time: how long these steps are, ns in total.
        unordered: steps that are not forward.
    """

    type: str
    count: int
    encoding: str = "cdr"
    unread: str = ""
    first: int | None = None
    last: int | None = None
    gaps: int = 0
    gap_time: int = 0
    unordered: int = 0

    @property
    def rate(self) -> float | None:
        """Mean rate in Hz; None for fewer than two messages."""
        if self.count < 2 or self.first is None or self.last is None or self.last <= self.first:
            return None
        return (self.count - 1) / ((self.last - self.first) / 1e9)


@dataclass
class Info:
    """A recording.

    Attributes:
        path: the file.
        streams: by topic.
        provenance: how it was made, texts that hold JSON parsed.
        losses: messages that sources dropped, {node: {why: count}}; None if nothing says so,
            because the run did not come to its end.
        missing: what did not reach a group or the recorder, after a crash or an interruption.
        recovery: the report of `recover`, if it was mended.
        attachments: names and sizes in bytes of the files in it.
        graph: the attached graph, as text; None if there is none.
    """

    path: Path
    streams: dict[str, StreamInfo] = field(default_factory=dict)
    provenance: dict[str, Any] = field(default_factory=dict)
    losses: dict[str, dict[str, int]] | None = None
    missing: list[RecordedGap] = field(default_factory=list)
    recovery: dict[str, Any] | None = None
    attachments: dict[str, int] = field(default_factory=dict)
    graph: str | None = None

    def as_dict(self) -> dict[str, Any]:
        """Return plain data fit for JSON."""
        return {
            "path": str(self.path),
            "streams": {
                topic: {**vars(stream), "rate": stream.rate}
                for topic, stream in self.streams.items()
            },
            "provenance": self.provenance,
            "losses": self.losses,
            "missing": [
                gap._asdict()
                | {
                    "begin": None if gap.begin == NEVER else gap.begin,
                    "end": None if gap.end == END else gap.end,
                }
                for gap in self.missing
            ],
            "recovery": self.recovery,
            "attachments": self.attachments,
            "graph": self.graph is not None,
        }


def info(path: str | Path) -> Info:
    """Return what is in a recording.

    Raises:
        RecordingError: it cannot be read, was not closed, or is damaged.
    """
    with McapFile(Path(path)) as file:
        found = Info(Path(path))
        found.attachments = {place.name: place.data_size for place in file.attachments}
        if "graph.yaml" in found.attachments:
            found.graph = file.read_attachment("graph.yaml").decode("utf-8", "replace")
        found.provenance = {
            name: _json(text) for name, text in _metadata(file, "lodeflow.provenance").items()
        }
        summary = _json(_metadata(file, "lodeflow.summary").get("summary", ""))
        if isinstance(summary, dict) and isinstance(nodes := summary.get("nodes"), dict):
            found.losses = {
                str(name): node["lost"]
                for name, node in nodes.items()
                if isinstance(node, dict) and node.get("lost")
            }
        recovery = _json(_metadata(file, "lodeflow.recovery").get("report", ""))
        found.recovery = recovery if isinstance(recovery, dict) else None
        channels = topics(file)
        wanted = {topic: [channel.id for channel in found] for topic, found in channels.items()}
        steps = {topic: _Steps() for topic in wanted}
        for chunk in parts(file, wanted):
            for topic, part in chunk.items():
                steps[topic].add(part.entries["log_time"].astype(np.int64))
        for topic in wanted:
            found.streams[topic] = _stream(file, channels[topic])
            steps[topic].report(found.streams[topic])
        found.missing = _missing(file, wanted.get(GAP.topic, []))
    return found


def _missing(file: McapFile, channels: list[int]) -> list[RecordedGap]:
    found = []
    for part in parts(file, {GAP.topic: channels}) if channels else ():
        rows = part[GAP.topic].rows(file, GAP.topic)
        found += [RecordedGap.of(GAP.decode(rows.payload(i))) for i in range(len(rows.t))]
    return found


def _stream(file: McapFile, channels: Channels) -> StreamInfo:
    count = sum(file.counts.get(channel.id, 0) for channel in channels)
    stream = StreamInfo(type_name(file, channels), count, encoding(channels))
    try:
        kind_of(file, channels)
    except MessageError as error:
        stream.unread = str(error)
    return stream


def _metadata(file: McapFile, name: str) -> dict[str, str]:
    if all(place.name != name for place in file.metadata):
        return {}
    return file.read_metadata(name)


def _json(text: str) -> Any:
    """Return what a text says if it is a JSON list or object, else the text."""
    if not text.startswith(("{", "[")):
        return text
    try:
        return json.loads(text)
    except (ValueError, RecursionError):
        return text


class _Steps:
    """Steps between stamps, counted in bins, so that memory does not grow with the stream."""

    def __init__(self) -> None:
        self.first: int | None = None
        self._last = 0
        self._unordered = 0
        self._bins: dict[int, tuple[int, int]] = {}  # steps in a bin, and their sum

    def add(self, t: NDArray[np.int64]) -> None:
        """Take the next stamps, of which there must be one."""
        steps = np.diff(t) if self.first is None else np.diff(t, prepend=self._last)
        if self.first is None:
            self.first = int(t[0])
        self._last = int(t[-1])
        forward = steps[steps > 0]
        self._unordered += len(steps) - len(forward)
        bins, which = np.unique((np.log(forward) * _PER_E).astype(int), return_inverse=True)
        counts = np.bincount(which, minlength=len(bins))
        sums = np.zeros(len(bins), dtype=np.int64)
        np.add.at(sums, which, forward)
        for bin_, count, total in zip(bins.tolist(), counts.tolist(), sums.tolist(), strict=True):
            known = self._bins.get(bin_, (0, 0))
            self._bins[bin_] = known[0] + count, known[1] + total

    def report(self, stream: StreamInfo) -> None:
        """Write down what was found."""
        if self.first is None:
            return
        stream.first, stream.last = self.first, self._last
        stream.unordered = self._unordered
        left = (sum(count for count, _ in self._bins.values()) + 1) // 2
        median: float | None = None
        for _, (count, total) in sorted(self._bins.items()):
            left -= count
            if median is None and left <= 0:
                median = total / count
            elif median is not None and total > LONG * median * count:
                stream.gaps += count
                stream.gap_time += total
