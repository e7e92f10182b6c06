"""Recording: an MCAP file read by column, whoever wrote it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from types import TracebackType
from typing import Any, NamedTuple, Self, TypeVar

import numpy as np
from mcap import records as mcap

from lodeflow.errors import MessageError, did_you_mean
from lodeflow.messages.message import Message
from lodeflow.recording.mcap.file import McapFile, where
from lodeflow.recording.mcap.raw import indexed, topics
from lodeflow.recording.stream import StreamDecoder, same_members

M = TypeVar("M", bound=Message)


class Topic(NamedTuple):
    """What a recording holds of one topic: the ROS 2 name of its type, and how many messages."""

    type: str
    messages: int


class Recording:
    """A closed MCAP file of ROS 2 messages, open for reading by column; a context manager.

    One chunk at a time is in memory. Stamps are those inside the messages (`header.stamp`), which
    strictly increase in each stream; log times, equal to them in files of lodeflow, only select.
    For use by one thread at a time.

    Args:
        path: the file.

    Attributes:
        path: the file.
        topics: type and message count of each topic, in the order in which they were opened.

    Raises:
        RecordingError: there is no such file, it is no MCAP, it was not closed, or it is damaged.
    """

    def __init__(self, path: str | Path) -> None:
        self.path = Path(path)
        self._file = McapFile(self.path)
        self._channels = topics(self._file)
        self.topics: Mapping[str, Topic] = {
            topic: Topic(
                " | ".join(dict.fromkeys(self._schema(channel).name for channel in channels)),
                sum(self._file.counts.get(channel.id, 0) for channel in channels),
            )
            for topic, channels in self._channels.items()
        }

    def close(self) -> None:
        """Close the file."""
        self._file.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self.close()

    @property
    def span(self) -> tuple[int, int] | None:
        """First and last log time, ns; None if there are no messages."""
        chunks = [place for place in self._file.chunks if place.message_index_offsets]
        if not chunks:
            return None
        first = min(place.message_start_time for place in chunks)
        return first, max(place.message_end_time for place in chunks)

    def metadata(self, name: str) -> dict[str, str]:
        """Return the first metadata of that name.

        Raises:
            RecordingError: there is none, or the file is damaged.
        """
        return self._file.read_metadata(name)

    def attachment(self, name: str) -> bytes:
        """Return the content of the first attachment of that name.

        Raises:
            RecordingError: there is none, or the file is damaged.
        """
        return self._file.read_attachment(name)

    def blocks(
        self,
        wanted: Mapping[str, type[Message]],
        start: int | None = None,
        end: int | None = None,
    ) -> Iterator[dict[str, Message]]:
        """Yield for each chunk, in the order of the file, the block of each wanted topic in it.

        At the end a warning counts the messages whose frame_id, or members that the type does
        not declare, differ from those of the topic's first message.

        Args:
            wanted: message type of each topic.
            start: earliest log time, ns.
            end: log time before which to end, ns.

        Raises:
            RecordingError: a topic is unknown or of another type; later, that the file is
                damaged, or that a topic's messages are not in the order of their stamps.
        """
        streams = {topic: self._decoder(topic, kind) for topic, kind in wanted.items()}
        return self._blocks(streams, start, end)

    def stream(
        self, topic: str, kind: type[M], start: int | None = None, end: int | None = None
    ) -> Iterator[M]:
        """Yield the blocks of one topic; see `blocks`. Several can be read side by side."""
        found: Iterator[dict[str, Any]] = self.blocks({topic: kind}, start, end)
        return (blocks[topic] for blocks in found)

    def _blocks(
        self, streams: Mapping[str, StreamDecoder], start: int | None, end: int | None
    ) -> Iterator[dict[str, Message]]:
        try:
            for place in self._file.chunks:
                if start is not None and place.message_end_time < start:
                    continue
                if end is not None and place.message_start_time >= end:
                    continue
                found = {
                    topic: block
                    for topic, stream in streams.items()
                    if (block := self._block(place, topic, stream, start, end)) is not None
                }
                if found:
                    yield found
            if start is None and end is None:
                for topic, stream in streams.items():
                    self._file.check_complete(topic, stream.channels, stream.count)
        finally:
            for topic, stream in streams.items():
                stream.warn(f"{self.path}: '{topic}'")

    def _block(
        self,
        place: mcap.ChunkIndex,
        topic: str,
        stream: StreamDecoder,
        start: int | None,
        end: int | None,
    ) -> Message | None:
        if not any(channel in place.message_index_offsets for channel in stream.channels):
            return None
        _, entries, channels = indexed(self._file, place, stream.channels)
        t = entries["log_time"]
        first = 0 if start is None else int(np.searchsorted(t, np.uint64(max(start, 0))))
        last = len(t) if end is None else int(np.searchsorted(t, np.uint64(max(end, 0))))
        if first >= last:
            return None
        try:
            return stream.decode(self._file.chunk(place), entries[first:last], channels[first:last])
        except MessageError as error:
            raise self._file.error(f"'{topic}' in {where(place)}: {error}") from error

    def _decoder(self, topic: str, kind: type[Message]) -> StreamDecoder:
        if topic not in self.topics:
            listed = ", ".join(f"{name} ({found.type})" for name, found in self.topics.items())
            raise self._file.error(
                f"no topic '{topic}'{did_you_mean(topic, self.topics)} (topics: {listed or 'none'})"
            )
        found = self.topics[topic].type
        if found != kind.ros:
            fits = [name for name, other in self.topics.items() if other.type == kind.ros]
            raise self._file.error(
                f"'{topic}' holds {found or 'messages without a type'}, not {kind.ros} "
                f"({kind.__name__}); topics with that: {', '.join(fits) or 'none'}"
            )
        for channel in self._channels[topic]:
            schema = self._schema(channel)
            if channel.message_encoding != "cdr":
                raise self._file.error(
                    f"'{topic}' is encoded as '{channel.message_encoding}'; only 'cdr' (ROS 2) "
                    "can be read"
                )
            if schema.encoding == "ros2msg" and not same_members(schema.data, kind):
                raise self._file.error(
                    f"'{topic}': {kind.ros} has other members in this file than in lodeflow now"
                )
        return StreamDecoder(kind, [channel.id for channel in self._channels[topic]])

    def _schema(self, channel: mcap.Channel) -> mcap.Schema:
        without = mcap.Schema(id=0, data=b"", encoding="", name="")
        return self._file.schemas.get(channel.schema_id, without)
