"""The source that plays the sensors of a recording."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, ClassVar, NamedTuple

import numpy as np

from lodeflow.clock import Clock
from lodeflow.messages.cdr import StreamConstants
from lodeflow.messages.message import Message
from lodeflow.messages.vocabulary import AttitudeTruth, Imu, MagneticField
from lodeflow.node import Source
from lodeflow.params import Params as BaseParams
from lodeflow.recording.reader import Recording


class Sensors(NamedTuple):
    """The ports of RecordedSensors."""

    imu: Imu | None
    mag: MagneticField | None
    truth: AttitudeTruth | None


class RecordedSensors(Source):
    """Inertial and magnetic measurements of a recording, with the reference attitude."""

    example: ClassVar = {"file": "recordings/walk.mcap", "imu": "/device/imu", "mag": "/device/mag"}

    class Params(BaseParams):
        """Which file, and which topics of it."""

        file: Path
        """MCAP recording; a relative path starts at the current folder."""
        imu: str | None
        """Topic with sensor_msgs/msg/Imu; null leaves the port silent."""
        mag: str | None
        """Topic with sensor_msgs/msg/MagneticField; null leaves the port silent."""
        truth: str | None = None
        """Topic with lodeflow_msgs/msg/AttitudeTruth; null leaves the port silent."""

    def read(self, clock: Clock) -> Iterator[Sensors]:
        """Yield the measurements, aligned in time."""
        with Recording(self.params.file) as recording:
            streams: dict[str, Iterator[Message]] = {
                port: recording.stream(topic, kind)
                for port, (topic, kind) in self._topics().items()
            }
            silent = dict.fromkeys(Sensors._fields)
            for blocks in aligned(streams):
                yield Sensors(**{**silent, **blocks})

    def constants(self) -> Mapping[str, StreamConstants]:
        """Return what the first message of each topic has."""
        return recorded_constants(self.params.file, self._topics())

    def _topics(self) -> dict[str, tuple[str, type[Message]]]:
        return {
            port.name: (topic, port.type)
            for port in self.spec.outputs
            if (topic := getattr(self.params, port.name)) is not None
        }


def recorded_constants(
    path: Path, topics: Mapping[str, tuple[str, type[Message]]]
) -> dict[str, StreamConstants]:
    """Return what does not change within some streams of a recording, by port.

    Args:
        path: the recording.
        topics: topic and type of each port.

    Raises:
        RecordingError: the file or a topic cannot be read.
    """
    with Recording(path) as recording:
        found = {port: recording.constants(*topic) for port, topic in topics.items()}
    return {port: constants for port, constants in found.items() if constants is not None}


def aligned(streams: Mapping[str, Iterator[Message]]) -> Iterator[dict[str, Any]]:
    """Yield blocks of several streams so that each yield has all up to its last stamp.

    One block of each stream is held at a time. A stream that has ended holds nobody back.

    Args:
        streams: blocks with rows, in the order of their stamps.
    """
    waiting: dict[str, Message] = {}
    streams = dict(streams)
    while True:
        for name in [name for name in streams if name not in waiting]:
            block = next(streams[name], None)
            if block is None:
                del streams[name]
            else:
                waiting[name] = block
        if not waiting:
            return
        # Each stream has all of its rows up to its last one here, so all have theirs up to this.
        reached = min(block.t[-1] for block in waiting.values())
        ready = {}
        for name, block in list(waiting.items()):
            rows = int(np.searchsorted(block.t, reached, side="right"))
            if rows:
                ready[name] = block[:rows]
            if rows == len(block):
                del waiting[name]
            else:
                waiting[name] = block[rows:]
        yield ready
