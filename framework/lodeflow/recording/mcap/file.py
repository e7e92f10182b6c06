"""A closed MCAP file: its summary, and the records and chunks that the summary points at."""

from __future__ import annotations

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
from numpy.typing import NDArray

from lodeflow.errors import RecordingError, did_you_mean
from lodeflow.recording.mcap.records import INDEX_LAYOUT, MAGIC, PREFIX, Op
from lodeflow.recording.mcap.summary import (
    DEFECTS,
    ChunkPlace,
    SummaryError,
    parsed,
    read_summary,
)
from lodeflow.recording.mcap.unpack import UnpackError, largest_chunk, unpack

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
        self.chunks: list[ChunkPlace] = []
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

    def record(self, op: Op, offset: int, limit: int | None = None) -> bytes:
        """Return the body of the record at an offset, that ends up to a limit.

        Raises:
            RecordingError: there is no whole record of that kind.
        """
        what = f"there should be a {op.name.lower().replace('_', ' ')} at byte {offset}"
        if offset + PREFIX.size > self._size:
            raise self.error(f"is cut off or damaged: {what}, beyond its end")
        found, length = PREFIX.unpack(self._bytes(offset, PREFIX.size))
        if found != op or offset + PREFIX.size + length > (limit or self._size):
            raise self.error(f"is damaged: {what}")
        return self._bytes(offset + PREFIX.size, length)

    def parsed(self, read: Callable[[ReadDataStream], R], body: bytes) -> R:
        """Return a record as the mcap package reads it.

        Raises:
            RecordingError: it is damaged.
        """
        try:
            return parsed(read, body)
        except DEFECTS as error:
            raise self.error(f"is damaged: {type(error).__name__}: {error}") from error

    def index(self, place: ChunkPlace, channel: int) -> NDArray[Any]:
        """Return log times and offsets of a channel's messages in a chunk, as INDEX_LAYOUT.

        Raises:
            RecordingError: the index is damaged.
        """
        offset = place.index_offsets().get(channel)
        if offset is None:
            return np.empty(0, INDEX_LAYOUT)
        damaged = f"the message index of {where(place)} is damaged"
        if not place.end <= offset < place.index_end:
            raise self.error(damaged)
        body = self.record(Op.MESSAGE_INDEX, offset, place.index_end)
        head = struct.pack("<HI", channel, len(body) - 6) if len(body) >= 6 else b""
        if body[:6] != head or (len(body) - 6) % INDEX_LAYOUT.itemsize:
            raise self.error(damaged)
        return np.frombuffer(body, INDEX_LAYOUT, offset=6)

    def chunk(self, place: ChunkPlace) -> bytes:
        """Return the records in a chunk, decompressed; the last one is kept at hand.

        Raises:
            RecordingError: the chunk is damaged, or its compression is unknown.
        """
        at, raw = self._last
        if at != place.start:
            self._last = (-1, b"")  # never two of them in memory
            raw = self._unpack(place)
            self._last = (place.start, raw)
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

    def _unpack(self, place: ChunkPlace) -> bytes:
        body = self.record(Op.CHUNK, place.start)
        try:
            return unpack(body, largest_chunk(self._size)).raw
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
        self._take(summary[: -_TAIL.size], start)

    def _take(self, summary: bytes, start: int) -> None:
        try:
            found = read_summary(summary, start)
        except SummaryError as error:
            raise self.error(f"its summary {error}") from error
        if found.counts is None:
            raise self.error(f"its summary has no statistics; {self._mend}")
        channels = {channel.id for channel in found.channels}
        schemas = {channel.schema_id for channel in found.channels} - {0}
        if not (found.counts.keys() <= channels and schemas <= found.schemas.keys()):
            raise self.error(f"its summary lacks channels; {self._mend}")
        self.schemas, self.channels, self.counts = found.schemas, found.channels, found.counts
        self.chunks, self.attachments = found.chunks, found.attachments
        self.metadata = found.metadata

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


def where(place: ChunkPlace) -> str:
    """Return a chunk's place in the file, in words."""
    return f"the chunk at byte {place.start}"
