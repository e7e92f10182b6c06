"""The summary at the end of an MCAP file: what is in it, and where.

No CRC need guard it, so it is not believed: chunks and their indexes lie apart from each other and
inside of the file, so that who follows them reads no byte twice.
"""

from __future__ import annotations

import io
import struct
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, NamedTuple, Self, TypeVar

from mcap import records as mcap
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError

from lodeflow.recording.mcap.records import PREFIX, Op

R = TypeVar("R")

DEFECTS = (McapError, struct.error, ValueError, OverflowError)
"""What the mcap package raises when it reads a damaged record."""

_HEAD = struct.Struct("<QQQQI")  # first and last log time, place, length, length of a map
_PLACE = struct.Struct("<HQ")
_INDEXES = struct.Struct("<Q")


class SummaryError(Exception):
    """A summary is damaged; the text goes on from "its summary "."""


class ChunkPlace(NamedTuple):
    """Index entry of a chunk; long files have many.

    Attributes:
        start: where the chunk record begins.
        end: where it ends; its message indexes follow.
        index_end: where they end.
        first: earliest log time, ns.
        last: latest log time, ns.
        places: where the message index of each channel is, as in the file.
    """

    start: int
    end: int
    index_end: int
    first: int
    last: int
    places: bytes

    @classmethod
    def read(cls, body: bytes) -> Self:
        """Return what a chunk index record says."""
        first, last, start, length, size = _HEAD.unpack_from(body)
        at = _HEAD.size + size
        (indexes,) = _INDEXES.unpack_from(body, at)
        end = start + length
        places = body[_HEAD.size : at]
        if len(places) % _PLACE.size:
            raise ValueError("the map of its indexes is cut off")
        return cls(start, end, end + indexes, first, last, places)

    def index_offsets(self) -> dict[int, int]:
        """Return where in the file the message index of each channel is."""
        return dict(_PLACE.iter_unpack(self.places))


@dataclass
class Summary:
    """What the summary of a file says.

    Attributes:
        schemas: by id.
        channels: in the order of their ids.
        counts: messages of each channel id.
        chunks: in the order of the file.
        attachments: index entries, in the order of the file.
        metadata: index entries, in the order of the file.
    """

    schemas: dict[int, mcap.Schema] = field(default_factory=dict)
    channels: list[mcap.Channel] = field(default_factory=list)
    counts: dict[int, int] | None = None
    chunks: list[ChunkPlace] = field(default_factory=list)
    attachments: list[mcap.AttachmentIndex] = field(default_factory=list)
    metadata: list[mcap.MetadataIndex] = field(default_factory=list)


def parsed(read: Callable[[ReadDataStream], R], body: bytes) -> R:
    """Return a record as the mcap package reads it; it may raise what is in DEFECTS."""
    return read(ReadDataStream(io.BytesIO(body)))


def read_summary(data: bytes, start: int) -> Summary:
    """Return what a summary says.

    Args:
        data: its records.
        start: where in the file it begins.

    Raises:
        SummaryError: it is damaged.
    """
    found, channels = Summary(), dict[int, mcap.Channel]()
    at = 0
    while at < len(data):
        if at + PREFIX.size > len(data):
            raise SummaryError("is damaged: a record is cut off")
        op, length = PREFIX.unpack_from(data, at)
        begin, at = at + PREFIX.size, at + PREFIX.size + length
        if at > len(data):
            raise SummaryError("is damaged: a record is longer than it")
        try:
            _take(found, channels, op, data[begin:at])
        except DEFECTS as error:
            raise SummaryError(f"is damaged: {type(error).__name__}: {error}") from error
    found.channels = sorted(channels.values(), key=lambda channel: channel.id)
    found.chunks.sort()
    reached = 0
    for place in found.chunks:
        if place.start < reached or place.index_end > start:
            raise SummaryError(
                f"is damaged: the chunk at byte {place.start} lies over another or the summary"
            )
        reached = place.index_end
    return found


def _take(found: Summary, channels: dict[int, mcap.Channel], op: int, body: bytes) -> None:
    entry: Any
    match op:
        case Op.SCHEMA:
            entry = parsed(mcap.Schema.read, body)
            found.schemas[entry.id] = entry
        case Op.CHANNEL:
            entry = parsed(mcap.Channel.read, body)
            channels[entry.id] = entry
        case Op.STATISTICS:
            found.counts = parsed(mcap.Statistics.read, body).channel_message_counts
        case Op.CHUNK_INDEX:
            found.chunks.append(ChunkPlace.read(body))
        case Op.ATTACHMENT_INDEX:
            found.attachments.append(parsed(mcap.AttachmentIndex.read, body))
        case Op.METADATA_INDEX:
            found.metadata.append(parsed(mcap.MetadataIndex.read, body))
