"""Messages as they stand in a file: places in a chunk, and payloads without their meaning."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple, Self

import numpy as np
from mcap import records as mcap
from numpy.typing import NDArray

from lodeflow.errors import MessageError
from lodeflow.recording.mcap.file import McapFile, where
from lodeflow.recording.mcap.records import PREFIX, Op, message_layout
from lodeflow.recording.mcap.summary import ChunkPlace

_HEAD = message_layout(0)
_DATA_AT = _HEAD.itemsize


def numbers_at(raw: bytes | memoryview, offset: int, kind: str) -> NDArray[Any]:
    """Return the numbers that begin `offset` bytes behind each byte, unaligned and not copied."""
    size = np.dtype(kind).itemsize
    return np.ndarray(max(0, len(raw) - offset - size + 1), kind, raw, offset, strides=(1,))


def step_of(starts: NDArray[np.int64]) -> int | None:
    """Return by how many bytes places lie apart, if all by as many; None if not."""
    if len(starts) == 1:
        return 0
    step = int(starts[1] - starts[0])
    return step if step > 0 and (np.diff(starts) == step).all() else None


def picked(
    raw: bytes | memoryview, starts: NDArray[np.int64], offset: int, kind: Any
) -> NDArray[Any]:
    """Return the values that begin `offset` bytes behind each place; a view if evenly spaced.

    Args:
        raw: bytes in which all of them lie.
        starts: (N,) places, N > 0.
        offset: bytes from each place to its value.
        kind: numpy type of a value.
    """
    step = step_of(starts)
    if step is None:
        return numbers_at(raw, offset, kind)[starts]
    return np.ndarray(len(starts), kind, raw, int(starts[0]) + offset, strides=(step,))


def places(
    raw: bytes, entries: NDArray[Any], channels: NDArray[Any] | int
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return where the payloads of some messages start in a chunk, and their sizes.

    No CRC guards a message index: its offsets are not followed out of the chunk.

    Args:
        raw: the records of the chunk.
        entries: (N,) INDEX_LAYOUT, N > 0.
        channels: the channel id of each, or of all.

    Raises:
        MessageError: an entry does not lead to a message of that channel and log time.
    """
    if entries["offset"].max() > len(raw) - _DATA_AT:
        raise MessageError("the message index is damaged, or a message is cut off")
    starts = entries["offset"].astype(np.int64)
    heads = picked(raw, starts, 0, _HEAD)
    lengths = heads["length"]
    good = (heads["op"] == Op.MESSAGE).all()
    good = good and (heads["channel"] == channels).all()
    good = good and (heads["log_time"] == entries["log_time"]).all()
    good = good and (lengths <= len(raw) - PREFIX.size - entries["offset"]).all()
    good = good and (lengths >= _DATA_AT - PREFIX.size).all()
    if not good or _overlap(starts, starts + lengths.astype(np.int64) + PREFIX.size):
        raise MessageError("the message index is damaged")
    return starts + _DATA_AT, lengths.astype(np.int64) - (_DATA_AT - PREFIX.size)


def _overlap(starts: NDArray[np.int64], ends: NDArray[np.int64]) -> bool:
    """Whether messages lie over each other; an index may lead to one of them any number of times.

    What is gathered is then never more than the chunk.
    """
    if (starts[1:] >= ends[:-1]).all():
        return False
    order = np.argsort(starts)
    return bool((starts[order][1:] < ends[order][:-1]).any())


class Rows(NamedTuple):
    """Messages of one topic, in their order, without their meaning.

    Attributes:
        t: (N,) int64, log times, ns.
        data: bytes that hold the payloads; those of equal size stand side by side.
        starts: (N,) where in `data` each payload starts.
        sizes: (N,) their sizes.
    """

    t: NDArray[np.int64]
    data: bytes
    starts: NDArray[np.int64]
    sizes: NDArray[np.int64]

    @classmethod
    def gather(
        cls,
        t: NDArray[Any],
        raw: bytes,
        starts: NDArray[np.int64],
        sizes: NDArray[np.int64],
    ) -> Self:
        """Copy payloads out of a chunk."""
        first = int(sizes[0])
        if first and (sizes == first).all():
            data = picked(raw, starts, 0, f"V{first}").tobytes()
        else:
            pairs = zip(starts.tolist(), sizes.tolist(), strict=True)
            data = b"".join([raw[start : start + size] for start, size in pairs])
        return cls(t.astype(np.int64), data, np.cumsum(sizes) - sizes, sizes)

    @classmethod
    def join(cls, parts: Sequence[Self]) -> Self:
        """Return the rows of `parts`, of which there must be one, in order."""
        if len(parts) == 1:
            return parts[0]
        sizes = np.concatenate([part.sizes for part in parts])
        t = np.concatenate([part.t for part in parts])
        return cls(t, b"".join(part.data for part in parts), np.cumsum(sizes) - sizes, sizes)

    def cut(self, start: int, end: int) -> Self:
        """Return the rows from `start` up to `end`."""
        if start == 0 and end == len(self.t):
            return self
        sizes = self.sizes[start:end]
        first = int(self.starts[start]) if start < len(self.starts) else len(self.data)
        data = self.data[first : first + int(sizes.sum())]
        return type(self)(self.t[start:end], data, self.starts[start:end] - first, sizes)

    def matrix(self) -> NDArray[np.uint8] | None:
        """Return the payloads as (N, size) if all have one size, else None."""
        if not len(self.sizes) or not (self.sizes == self.sizes[0]).all():
            return None
        return np.frombuffer(self.data, np.uint8).reshape(len(self.t), int(self.sizes[0]))

    def payload(self, row: int) -> bytes:
        """Return one payload."""
        start = int(self.starts[row])
        return self.data[start : start + int(self.sizes[row])]


class RawPart(NamedTuple):
    """The messages of one topic in one chunk, not yet unpacked.

    Attributes:
        place: the chunk.
        entries: (N,) INDEX_LAYOUT, ordered by log time.
        channels: (N,) their channel ids.
    """

    place: ChunkPlace
    entries: NDArray[Any]
    channels: NDArray[Any]

    def rows(self, file: McapFile, topic: str) -> Rows:
        """Return the messages.

        Raises:
            RecordingError: the chunk or its index is damaged.
        """
        raw = file.chunk(self.place)
        try:
            starts, sizes = places(raw, self.entries, self.channels)
        except MessageError as error:
            raise file.error(f"'{topic}' in {where(self.place)}: {error}") from error
        return Rows.gather(self.entries["log_time"], raw, starts, sizes)


def indexed(file: McapFile, place: ChunkPlace, channels: Sequence[int]) -> RawPart:
    """Return where the messages of some channels stand in a chunk.

    Raises:
        RecordingError: an index is damaged.
    """
    indexes = [file.index(place, channel) for channel in channels]
    entries = np.concatenate(indexes)
    ids = np.repeat(np.array(channels, dtype=np.int64), [len(index) for index in indexes])
    t = entries["log_time"]
    if (t[1:] < t[:-1]).any():
        order = np.argsort(t, kind="stable")
        entries, ids = entries[order], ids[order]
    return RawPart(place, entries, ids)


def parts(file: McapFile, wanted: Mapping[str, Sequence[int]]) -> Iterator[dict[str, RawPart]]:
    """Yield for each chunk, in the order of the file, where the messages of some topics stand.

    Args:
        file: the file.
        wanted: channel ids of each topic.

    Raises:
        RecordingError: an index is damaged, or does not lead to all messages.
    """
    counts = dict.fromkeys(wanted, 0)
    for place in file.chunks:
        found, indexes = {}, place.index_offsets()
        for topic, channels in wanted.items():
            here = [channel for channel in channels if channel in indexes]
            if here and len((part := indexed(file, place, here)).entries):
                found[topic] = part
                counts[topic] += len(part.entries)
        if found:
            yield found
    for topic, channels in wanted.items():
        file.check_complete(topic, channels, counts[topic])


def topics(file: McapFile) -> dict[str, list[mcap.Channel]]:
    """Return the channels of each topic."""
    found: dict[str, list[mcap.Channel]] = {}
    for channel in file.channels:
        found.setdefault(channel.topic, []).append(channel)
    return found
