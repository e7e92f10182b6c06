"""A closed MCAP file: its summary, and the records and chunks that the summary points at."""

from __future__ import annotations

import io
import os
import shlex
import struct
import zlib
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any, Self, TypeVar

import numpy as np
from mcap import records as mcap
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.stream_reader import StreamReader
from numpy.typing import NDArray

from lodeflow.errors import RecordingError, did_you_mean
from lodeflow.recording.mcap.records import INDEX_LAYOUT, MAGIC, PREFIX, Op
from lodeflow.recording.mcap.unpack import UnpackError, unpack

R = TypeVar("R")

_TAIL = struct.Struct("<BQQQI8s")  # footer: prefix, summary, summary offsets, CRC; magic


class McapFile:
    """Random access to a closed MCAP file. What it reads it checks: opcodes, lengths and CRCs.

    Attributes:
        path: the file.
        schemas: by id.
        channels: in the order of their ids.
        counts: messages of each channel id.
        chunks: index entries, in the order of the file.
        attachments: index entries, in the order of the file.
        metadata: index entries, in the order of the file.

    Raises:
        RecordingError: there is no such file, it is no MCAP, it was not closed, or it is damaged.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.schemas: dict[int, mcap.Schema] = {}
        self.channels: list[mcap.Channel] = []
        self.counts: dict[int, int] = {}
        self.chunks: list[mcap.ChunkIndex] = []
        self.attachments: list[mcap.AttachmentIndex] = []
        self.metadata: list[mcap.MetadataIndex] = []
        self._last: tuple[int, bytes] = (-1, b"")
        try:
            self._file = path.open("rb")
        except OSError as error:
            raise self.error(f"cannot be read: {error.strerror}") from error
        try:
            self._size = os.fstat(self._file.fileno()).st_size
            self._open()
        except BaseException:
            self._file.close()
            raise

    def close(self) -> None:
        """Close the file."""
        self._file.close()
        self._last = (-1, b"")

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def error(self, what: str) -> RecordingError:
        """Return the error to raise about this file."""
        return RecordingError(f"{self.path}: {what}")

    @property
    def _mend(self) -> str:
        return f"mend it with: lodeflow recover {shlex.quote(str(self.path))}"

    def record(self, op: Op, offset: int) -> bytes:
        """Return the body of the record at an offset.

        Raises:
            RecordingError: there is no whole record of that kind.
        """
        what = f"there should be a {op.name.lower().replace('_', ' ')} at byte {offset}"
        if offset + PREFIX.size > self._size:
            raise self.error(f"is cut off or damaged: {what}, beyond its end")
        found, length = PREFIX.unpack(self._bytes(offset, PREFIX.size))
        if found != op or offset + PREFIX.size + length > self._size:
            raise self.error(f"is damaged: {what}")
        return self._bytes(offset + PREFIX.size, length)

    def parsed(self, read: Callable[[ReadDataStream], R], body: bytes) -> R:
        """Return a record as the mcap package reads it.

        Raises:
            RecordingError: it is damaged.
        """
        try:
            return read(ReadDataStream(io.BytesIO(body)))
        except (McapError, struct.error, ValueError, OverflowError) as error:
            raise self.error(f"is damaged: {type(error).__name__}: {error}") from error

    def index(self, place: mcap.ChunkIndex, channel: int) -> NDArray[Any]:
        """Return log times and offsets of a channel's messages in a chunk, as INDEX_LAYOUT.

        Raises:
            RecordingError: the index is damaged.
        """
        if channel not in place.message_index_offsets:
            return np.empty(0, INDEX_LAYOUT)
        body = self.record(Op.MESSAGE_INDEX, place.message_index_offsets[channel])
        head = struct.pack("<HI", channel, len(body) - 6) if len(body) >= 6 else b""
        if body[:6] != head or (len(body) - 6) % INDEX_LAYOUT.itemsize:
            raise self.error(f"the message index of {where(place)} is damaged")
        return np.frombuffer(body, INDEX_LAYOUT, offset=6)

    def chunk(self, place: mcap.ChunkIndex) -> bytes:
        """Return the records in a chunk, decompressed; the last one is kept at hand.

        Raises:
            RecordingError: the chunk is damaged, or its compression is unknown.
        """
        at, raw = self._last
        if at != place.chunk_start_offset:
            self._last = (-1, b"")  # never two of them in memory
            raw = self._unpack(place)
            self._last = (place.chunk_start_offset, raw)
        return raw

    def read_metadata(self, name: str) -> dict[str, str]:
        """Return the first metadata of that name.

        Raises:
            RecordingError: there is none, or it is damaged.
        """
        place = self._named("metadata", name, self.metadata)
        body = self.record(Op.METADATA, place.offset)
        found: mcap.Metadata = self.parsed(mcap.Metadata.read, body)
        return found.metadata

    def read_attachment(self, name: str) -> bytes:
        """Return the content of the first attachment of that name.

        Raises:
            RecordingError: there is none, or it is damaged.
        """
        place = self._named("attachment", name, self.attachments)
        body = self.record(Op.ATTACHMENT, place.offset)
        if int.from_bytes(body[-4:], "little") not in (0, zlib.crc32(body[:-4])):
            raise self.error(f"the attachment '{name}' is damaged: its CRC differs")
        found: mcap.Attachment = self.parsed(mcap.Attachment.read, body)
        return found.data

    def _named(self, what: str, name: str, places: Sequence[Any]) -> Any:
        for place in places:
            if place.name == name:
                return place
        names = list(dict.fromkeys(place.name for place in places))
        raise self.error(
            f"no {what} '{name}'{did_you_mean(name, names)} "
            f"(there is: {', '.join(names) or 'nothing'})"
        )

    def check_complete(self, topic: str, channels: Iterable[int], found: int) -> None:
        """Compare how many messages the index led to with how many there are.

        Raises:
            RecordingError: they differ.
        """
        count = sum(self.counts.get(channel, 0) for channel in channels)
        if found != count:
            raise self.error(
                f"'{topic}' has {count} messages, but the index leads to {found}. Messages outside "
                f"of chunks, or in chunks without a message index, cannot be read; {self._mend}"
            )

    def _unpack(self, place: mcap.ChunkIndex) -> bytes:
        body = self.record(Op.CHUNK, place.chunk_start_offset)
        try:
            return unpack(body).raw
        except UnpackError as error:
            raise self.error(f"{where(place)} {error}") from error

    def _open(self) -> None:
        if not self._size:
            raise self.error("is empty")
        if self._bytes(0, min(self._size, len(MAGIC))) != MAGIC[: self._size]:
            raise self.error("is no MCAP file")
        tail = self._bytes(self._size - _TAIL.size, _TAIL.size) if self._size > _TAIL.size else b""
        if not tail.endswith(MAGIC):
            raise self.error(
                "was not closed: its end is missing. What wrote it was killed or still writes, or "
                f"this is half of a copy; {self._mend}"
            )
        op, length, start, _, crc, _ = _TAIL.unpack(tail)
        if op != Op.FOOTER or length != 20 or start > self._size - _TAIL.size:
            raise self.error("is damaged: its footer is wrong")
        if not start:
            raise self.error(f"has no summary; {self._mend}")
        summary = self._bytes(start, self._size - start)
        if crc and zlib.crc32(summary[: -len(MAGIC) - 4]) != crc:
            raise self.error("is damaged: the CRC of its summary differs")
        self._take(summary)

    def _take(self, summary: bytes) -> None:
        channels: dict[int, mcap.Channel] = {}
        statistics = None
        try:
            for record in StreamReader(io.BytesIO(summary), skip_magic=True).records:
                match record:
                    case mcap.Schema():
                        self.schemas[record.id] = record
                    case mcap.Channel():
                        channels[record.id] = record
                    case mcap.Statistics():
                        statistics = record
                    case mcap.ChunkIndex():
                        self.chunks.append(record)
                    case mcap.AttachmentIndex():
                        self.attachments.append(record)
                    case mcap.MetadataIndex():
                        self.metadata.append(record)
        except (McapError, struct.error, ValueError, OverflowError) as error:
            raise self.error(f"its summary is damaged: {type(error).__name__}: {error}") from error
        if statistics is None:
            raise self.error(f"its summary has no statistics; {self._mend}")
        self.counts = statistics.channel_message_counts
        schemas = {channel.schema_id for channel in channels.values()} - {0}
        if not (self.counts.keys() <= channels.keys() and schemas <= self.schemas.keys()):
            raise self.error(f"its summary lacks channels; {self._mend}")
        self.channels = sorted(channels.values(), key=lambda channel: channel.id)
        self.chunks.sort(key=lambda place: place.chunk_start_offset)

    def _bytes(self, offset: int, length: int) -> bytes:
        try:
            self._file.seek(offset)
            data = self._file.read(length)
        except (OSError, ValueError) as error:  # ValueError: it is closed
            why = error.strerror if isinstance(error, OSError) else str(error)
            raise self.error(f"cannot be read: {why}") from error
        if len(data) != length:
            raise self.error("was cut off while it was read")
        return data


def where(place: mcap.ChunkIndex) -> str:
    """Return a chunk's place in the file, in words."""
    return f"the chunk at byte {place.chunk_start_offset}"
