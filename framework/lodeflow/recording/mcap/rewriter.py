"""Write an MCAP file out of the records of another: chunks as they are, index and summary anew."""

from __future__ import annotations

import zlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any, BinaryIO

import zstandard
from mcap import records as mcap
from numpy.typing import NDArray

from lodeflow.errors import RecordingError
from lodeflow.recording.mcap import records as encode
from lodeflow.recording.mcap.records import MAGIC, PREFIX, Op


class McapRewriter:
    """Takes records in the order in which they shall stand in the file.

    Args:
        path: file to create; an existing file is never overwritten. None counts, and writes
            nothing.

    Raises:
        RecordingError: the file exists or cannot be created; from all methods: written.
    """

    def __init__(self, path: Path | None) -> None:
        self.path = path
        self.counts: dict[int, int] = {}
        self.until: dict[int, int] = {}
        self.first, self.last = 1 << 64, -1
        self._schemas: set[int] = set()
        self._size = 0
        self._crc = 0
        self._summary: dict[Op, list[bytes]] = {  # in the order of the summary section
            Op.SCHEMA: [],
            Op.CHANNEL: [],
            Op.STATISTICS: [],
            Op.CHUNK_INDEX: [],
            Op.ATTACHMENT_INDEX: [],
            Op.METADATA_INDEX: [],
        }
        self._file: BinaryIO | None = None
        if path is not None:
            try:
                self._file = path.open("xb")
            except FileExistsError as error:
                raise self._error("exists; remove it or choose another name") from error
            except OSError as error:
                raise self._error(f"cannot be created: {error.strerror}") from error
        self._append(MAGIC)

    def header(self, profile: str, library: str) -> None:
        """Write the header; it must come first."""
        self._append(encode.header(profile, library))

    def schema(self, schema: mcap.Schema, *, in_chunk: bool = False) -> None:
        """Write a schema if there is none of its id; `in_chunk`: a chunk has it already."""
        if schema.id in self._schemas:
            return
        self._schemas.add(schema.id)
        record = encode.schema(schema.id, schema.name, schema.encoding, schema.data)
        self._summary[Op.SCHEMA].append(record)
        if not in_chunk:
            self._append(record)

    def channel(self, channel: mcap.Channel, *, in_chunk: bool = False) -> None:
        """Write a channel if there is none of its id; `in_chunk`: a chunk has it already."""
        if channel.id in self.counts:
            return
        self.counts[channel.id] = 0
        record = encode.channel(
            channel.id,
            channel.schema_id,
            channel.topic,
            channel.message_encoding,
            channel.metadata,
        )
        self._summary[Op.CHANNEL].append(record)
        if not in_chunk:
            self._append(record)

    def metadata(self, name: str, entries: Mapping[str, str]) -> None:
        """Write metadata."""
        record, offset = encode.metadata(name, entries), self._size
        self._append(record)
        index = encode.metadata_index(offset, len(record), name)
        self._summary[Op.METADATA_INDEX].append(index)

    def attachment(self, body: bytes, found: mcap.Attachment) -> None:
        """Write an attachment as it is."""
        offset, size = self._size, PREFIX.size + len(body)
        self._append(PREFIX.pack(Op.ATTACHMENT, len(body)), body)
        index = encode.attachment_index(
            offset,
            size,
            found.log_time,
            len(found.data),
            found.name,
            found.media_type,
            created=found.create_time,
        )
        self._summary[Op.ATTACHMENT_INDEX].append(index)

    def chunk(
        self,
        raw: bytes,
        indexes: Mapping[int, NDArray[Any]],
        packed: tuple[str, bytes | memoryview] | None = None,
    ) -> None:
        """Write a chunk and its indexes.

        Args:
            raw: its records.
            indexes: INDEX_LAYOUT of each channel that has messages in it.
            packed: name of a compression, and the records compressed; None compresses them now.
        """
        times = [index["log_time"] for index in indexes.values()]
        first = min((int(t.min()) for t in times), default=0)
        last = max((int(t.max()) for t in times), default=0)
        if packed is None:
            packed = ("zstd", zstandard.ZstdCompressor(level=1).compress(raw))
        compression, data = packed
        crc = zlib.crc32(raw)
        record = encode.chunk(first, last, len(raw), crc, compression, bytes(data))
        offset, records, places = self._size, [record], {}
        end = offset + len(record)
        for channel, index in indexes.items():
            records.append(encode.message_index(channel, index))
            places[channel] = end
            end += len(records[-1])
            self.counts[channel] += len(index)
            until = int(index["log_time"].max())
            self.until[channel] = max(until, self.until.get(channel, until))
        if indexes:
            self.first, self.last = min(self.first, first), max(self.last, last)
        self._append(*records)
        self._summary[Op.CHUNK_INDEX].append(
            encode.chunk_index(
                first,
                last,
                offset,
                len(record),
                places,
                end - offset - len(record),
                compression,
                len(data),
                len(raw),
            )
        )

    def close(self) -> None:
        """Write index, statistics and end."""
        first, last = (self.first, self.last) if self.last >= 0 else (0, 0)
        groups = dict(self._summary)
        groups[Op.STATISTICS] = [encode.statistics(self._summary, first, last, self.counts)]
        data_end = encode.data_end(self._crc)
        self._append(data_end, encode.tail(groups, self._size + len(data_end)))
        if self._file is not None:
            try:
                self._file.close()
            except OSError as error:
                raise self._error(f"cannot be written: {error.strerror}") from error

    def discard(self) -> None:
        """Remove what was written."""
        if self._file is not None and self.path is not None:
            self._file.close()
            self.path.unlink(missing_ok=True)

    def _append(self, *records: bytes) -> None:
        for record in records:
            self._size += len(record)
            if self._file is None:
                continue
            self._crc = zlib.crc32(record, self._crc)
            try:
                self._file.write(record)
            except OSError as error:
                raise self._error(f"cannot be written: {error.strerror}; make room") from error

    def _error(self, what: str) -> RecordingError:
        return RecordingError(f"{self.path}: {what}")
