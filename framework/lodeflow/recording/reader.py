"""Recording: an MCAP file read by column, whoever wrote it."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from types import TracebackType
from typing import Any, NamedTuple, Self, TypeVar

import numpy as np

from lodeflow.errors import MessageError, RecordingError, did_you_mean
from lodeflow.messages.cdr import StreamConstants
from lodeflow.messages.message import Message
from lodeflow.recording.fit import decoder, kind_of, require_cdr, type_name
from lodeflow.recording.mcap.file import McapFile, where
from lodeflow.recording.mcap.raw import indexed, parts, places, topics
from lodeflow.recording.mcap.summary import ChunkPlace
from lodeflow.recording.stream import StreamDecoder

M = TypeVar("M", bound=Message)
T = TypeVar("T")


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
                type_name(self._file, channels),
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
        chunks = [place for place in self._file.chunks if place.places]
        if not chunks:
            return None
        first = min(place.first for place in chunks)
        return first, max(place.last for place in chunks)

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

    def kind(self, topic: str) -> type[Message]:
        """Return the declared message type that a topic can be read as.

        Raises:
            RecordingError: a topic is unknown, or there is no such type; says why.
        """
        return self._of_topic(self._known(topic), kind_of)

    def constants(self, topic: str, kind: type[Message]) -> StreamConstants | None:
        """Return the frame_id of a topic, and the values of members that its type does not declare.

        They are those of the first message; None without messages.

        Raises:
            RecordingError: as `blocks`.
        """
        stream = self._decoder(topic, kind)
        for place in self._file.chunks:
            _, entries, channels = indexed(self._file, place, stream.channels)
            if len(entries):
                try:
                    raw = self._file.chunk(place)
                    starts, sizes = places(raw, entries[:1], channels[:1])
                    return stream.constants(raw, int(starts[0]), int(sizes[0]))
                except MessageError as error:
                    raise self._damaged(topic, place, error) from error
        return None

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

    def raw(self, topic: str) -> Iterator[tuple[int, bytes]]:
        """Yield the log time, ns, and payload of each message of a topic; none if it is unknown.

        Raises:
            RecordingError: the file is damaged.
        """
        channels = [channel.id for channel in self._channels.get(topic, ())]
        for found in parts(self._file, {topic: channels}) if channels else ():
            rows = found[topic].rows(self._file, topic)
            for index, t in enumerate(rows.t.tolist()):
                yield t, rows.payload(index)

    def _blocks(
        self, streams: Mapping[str, StreamDecoder], start: int | None, end: int | None
    ) -> Iterator[dict[str, Message]]:
        try:
            for place in self._file.chunks:
                if start is not None and place.last < start:
                    continue
                if end is not None and place.first >= end:
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
        place: ChunkPlace,
        topic: str,
        stream: StreamDecoder,
        start: int | None,
        end: int | None,
    ) -> Message | None:
        here = place.index_offsets()
        if not any(channel in here for channel in stream.channels):
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
            raise self._damaged(topic, place, error) from error

    def _damaged(self, topic: str, place: ChunkPlace, error: MessageError) -> RecordingError:
        return self._file.error(f"'{topic}' in {where(place)}: {error}")

    def _known(self, topic: str) -> str:
        if topic not in self.topics:
            listed = ", ".join(f"{name} ({found.type})" for name, found in self.topics.items())
            raise self._file.error(
                f"no topic '{topic}'{did_you_mean(topic, self.topics)} (topics: {listed or 'none'})"
            )
        return topic

    def _decoder(self, topic: str, kind: type[Message]) -> StreamDecoder:
        self._of_topic(self._known(topic), require_cdr)
        found = self.topics[topic].type
        if found != kind.ros:
            fits = [name for name, other in self.topics.items() if other.type == kind.ros]
            raise self._file.error(
                f"'{topic}' holds {found or 'messages without a type'}, not {kind.ros} "
                f"({kind.__name__}); topics with that: {', '.join(fits) or 'none'}"
            )
        return self._of_topic(topic, decoder, kind)

    def _of_topic(self, topic: str, ask: Callable[..., T], *arguments: Any) -> T:
        """Return what is to be known of a topic; say of which one if it cannot be."""
        try:
            return ask(self._file, self._channels[topic], *arguments)
        except MessageError as error:
            raise self._file.error(f"'{topic}' {error}") from error
