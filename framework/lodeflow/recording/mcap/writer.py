"""Write MCAP as columns: a block of messages is one numpy assignment, whatever its length."""

from __future__ import annotations

import contextlib
import io
import itertools
import os
import zlib
from collections import deque
from collections.abc import Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path
from types import TracebackType
from typing import Literal, Self

import numpy as np
from numpy.typing import NDArray

from lodeflow.errors import RecordingError
from lodeflow.recording.mcap import records as encode
from lodeflow.recording.mcap.chunk import Chunk, Encode, Sealed
from lodeflow.recording.mcap.records import MAGIC, Op
from lodeflow.recording.mcap.unpack import SMALL_CHUNK

MOST_CHANNELS = (1 << 16) - 1
SEALERS = min(4, os.cpu_count() or 1)
"""Threads that compress; also the full chunks that may wait for them, which bounds the memory."""


class McapWriter:
    """Writes MCAP as columns: N fixed-size messages of one channel at once, no per-message Python.

    Full chunks are compressed in threads of the writer's own while the next one fills, and go to
    the operating system in their order, as soon as they are whole: a killed process loses the open
    chunk and what was being compressed, and nothing behind a `flush_chunk`. Schemas and channels
    stand outside the chunks for the same reason. Equal calls give equal bytes. For use by one
    thread at a time.

    Args:
        path: file to create; an existing file is never overwritten.
        profile: MCAP profile; rosbags and rosbag2 read only "ros2".
        library: what wrote the file, for the header.
        compression: of the chunks; "lz4" needs the package lz4, "" stores them as they are.
        chunk_bytes: size of a chunk before compression, 1 to 2**24 bytes; a larger message has
            a chunk of its own.

    Raises:
        RecordingError: the file exists or cannot be created, or an argument is out of range.
    """

    def __init__(
        self,
        path: str | Path,
        *,
        profile: str = "ros2",
        library: str = "lodeflow",
        compression: Literal["zstd", "lz4", ""] = "zstd",
        chunk_bytes: int = 1 << 20,
    ) -> None:
        self.path = Path(path)
        if not 1 <= chunk_bytes <= SMALL_CHUNK:
            raise self._error(f"chunk_bytes must be 1 to {SMALL_CHUNK}, not {chunk_bytes}")
        self._compression = compression
        self._chunk_bytes = chunk_bytes
        try:
            self._chunks = deque([Chunk(chunk_bytes, compression)])  # full ones, and one to fill
        except (ValueError, ImportError) as error:
            raise self._error(str(error)) from error
        self._sealers = ThreadPoolExecutor(SEALERS, "sealer")  # it starts threads when needed
        self._sealed: dict[Chunk, Future[Sealed]] = {}
        self._spare: list[Chunk] = []
        self._schemas: dict[tuple[str, str], int] = {}
        self._counts: dict[int, int] = {}  # messages so far, by channel
        self._written: dict[int, int] = {}  # those of them that are in the file
        self._first, self._last = 1 << 64, 0  # log times of all chunks in the file
        self._size = 0  # bytes in the file
        self._crc = 0  # of those bytes
        self._summary: dict[Op, list[bytes]] = {  # in the order of the summary section
            Op.SCHEMA: [],
            Op.CHANNEL: [],
            Op.STATISTICS: [],
            Op.CHUNK_INDEX: [],
            Op.ATTACHMENT_INDEX: [],
            Op.METADATA_INDEX: [],
        }
        self._ended = ""  # why the recording takes no more data
        try:
            self._file = io.FileIO(self.path, "x")
        except FileExistsError as error:
            raise self._error("exists; remove it or choose another name") from error
        except OSError as error:
            raise self._error(
                f"cannot be created: {error.strerror}; check that its folder exists and that you "
                "may write there"
            ) from error
        self._append(MAGIC + encode.header(profile, library))

    def metadata(self, name: str, entries: Mapping[str, str]) -> None:
        """Write named pairs of strings, at once.

        Raises:
            RecordingError: the recording is closed, or the file cannot be written.
        """
        self._require_open()
        record, offset = encode.metadata(name, entries), self._size
        self._append(record)
        index = encode.metadata_index(offset, len(record), name)
        self._summary[Op.METADATA_INDEX].append(index)

    def attachment(self, name: str, media_type: str, data: bytes, *, t: int = 0) -> None:
        """Write a file into the recording, at once.

        Args:
            name: file name.
            media_type: such as "text/yaml".
            data: content of the file.
            t: log time, ns, not negative.

        Raises:
            RecordingError: `t` is negative, the recording is closed, or it cannot be written.
        """
        self._require_open()
        if t < 0:
            raise self._error(f"attachment '{name}': {_negative(t)}")
        record, offset = encode.attachment(t, name, media_type, data), self._size
        self._append(record)
        index = encode.attachment_index(offset, len(record), t, len(data), name, media_type)
        self._summary[Op.ATTACHMENT_INDEX].append(index)

    def channel(
        self,
        topic: str,
        schema_name: str,
        schema_text: str,
        *,
        metadata: Mapping[str, str] | None = None,
    ) -> int:
        """Open a channel of CDR messages and return its id, for `write`.

        Args:
            topic: name of the stream.
            schema_name: ROS 2 type, such as "sensor_msgs/msg/Imu".
            schema_text: its `ros2msg` definition with all that it depends on; channels of equal
                name and text share one schema record.
            metadata: pairs of strings kept with the channel.

        Raises:
            RecordingError: there are 65535 channels already, the recording is closed, or it
                cannot be written.
        """
        self._require_open()
        if len(self._counts) == MOST_CHANNELS:
            raise self._error(f"channel '{topic}': MCAP has room for {MOST_CHANNELS} channels")
        key = (schema_name, schema_text)
        if key not in self._schemas:
            schema_id = len(self._schemas) + 1
            schema = encode.schema(schema_id, schema_name, "ros2msg", schema_text.encode())
            self._append(schema)
            self._summary[Op.SCHEMA].append(schema)
            self._schemas[key] = schema_id
        channel_id = len(self._counts) + 1
        channel = encode.channel(channel_id, self._schemas[key], topic, "cdr", metadata or {})
        self._append(channel)
        self._summary[Op.CHANNEL].append(channel)
        self._counts[channel_id] = self._written[channel_id] = 0
        return channel_id

    def write(self, channel: int, t: NDArray[np.int64], records: NDArray[np.uint8]) -> None:
        """Write N messages of one size to a channel.

        Args:
            channel: id from `channel`.
            t: log and publish times, shape (N,), int64, ns, not negative.
            records: encoded messages, shape (N, size), uint8; copied.

        Raises:
            RecordingError: an array of another shape or type, a negative stamp, an unknown
                channel, a closed recording, or a file that cannot be written. Of a write that
                is refused for its arguments, nothing is recorded.
        """
        if records.dtype != np.uint8 or records.ndim != 2 or len(records) != len(t):
            raise self._error(
                f"records must be uint8 of shape ({len(t)}, size), a row for each stamp, not "
                f"{records.dtype} {records.shape}"
            )
        self.write_encoded(
            channel, t, records.shape[1], lambda rows, out: np.copyto(out, records[rows])
        )

    def write_encoded(self, channel: int, t: NDArray[np.int64], size: int, encode: Encode) -> None:
        """Write N messages of one size to a channel, encoded where they go, and not copied.

        Args:
            channel: id from `channel`.
            t: log and publish times, shape (N,), int64, ns, not negative.
            size: bytes of each message.
            encode: called with a slice of the rows and where to write their bytes, shape
                (rows, size), uint8, contiguous rows that lie apart; once per chunk. What it
                raises is passed on, and those rows are not recorded.

        Raises:
            RecordingError: stamps of another shape or type, a negative stamp, an unknown channel,
                a closed recording, or a file that cannot be written.
        """
        self._require_open()
        if channel not in self._counts:
            raise self._error(f"no channel {channel}; open it with channel() first")
        if t.dtype != np.int64 or t.ndim != 1:
            raise self._error(f"stamps must be int64 of shape (N,), not {t.dtype} {t.shape}")
        if not len(t):
            return
        if t.min() < 0:
            row = int(np.argmax(t < 0))
            raise self._error(f"row {row}: {_negative(int(t[row]))}")
        done = 0
        while done < len(t):
            room = self._chunks[-1].room(size)
            if not room:
                self._next_chunk()
                self._write_full(SEALERS)
                continue
            rows = slice(done, min(done + room, len(t)))
            self._chunks[-1].fill(channel, self._counts[channel], t[rows], size, rows, encode)
            self._counts[channel] += rows.stop - done
            done = rows.stop

    def flush_chunk(self) -> None:
        """Close the open chunk, if there is one, and hand all to the operating system.

        Raises:
            RecordingError: the recording is closed, or the file cannot be written.
        """
        self._require_open()
        if self._chunks[-1]:
            self._next_chunk()
        self._write_full(0)

    def _next_chunk(self) -> None:
        spare = self._spare.pop() if self._spare else Chunk(self._chunk_bytes, self._compression)
        # This one step makes the open chunk a full one, so that Ctrl-C cannot come in between.
        self._chunks.append(spare)

    def _write_full(self, most: int) -> None:
        """Let full chunks be compressed, and write them; at most so many are then left."""
        if most:  # with all of them to wait for, the last one is no faster in another thread
            for chunk in itertools.islice(self._chunks, len(self._chunks) - 1):
                if chunk not in self._sealed:
                    self._sealed[chunk] = self._sealers.submit(chunk.seal)
        while (full := len(self._chunks) - 1) > 0:
            chunk = self._chunks[0]
            future = self._sealed.get(chunk)
            if full <= most and future is not None and not future.done():
                break
            self._append_sealed(chunk.seal() if future is None else future.result())
            self._chunks.popleft()
            self._sealed.pop(chunk, None)
            chunk.clear()
            self._spare.append(chunk)

    def _append_sealed(self, sealed: Sealed) -> None:
        offset = self._size
        index_at = end = offset + len(sealed.record)
        index_offsets = {}
        for channel, index in sealed.indexes.items():
            index_offsets[channel] = end
            end += len(index)
        self._append(sealed.record, *sealed.indexes.values())
        for channel, count in sealed.counts.items():
            self._written[channel] += count
        self._first, self._last = min(self._first, sealed.first), max(self._last, sealed.last)
        self._summary[Op.CHUNK_INDEX].append(
            encode.chunk_index(
                sealed.first,
                sealed.last,
                offset,
                len(sealed.record),
                index_offsets,
                end - index_at,
                self._compression,
                sealed.packed_size,
                sealed.raw_size,
            )
        )

    def close(self) -> None:
        """Write what is left, the summary and the footer; no-op if closed or failed before.

        Raises:
            RecordingError: the file cannot be written.
        """
        if self._ended:
            return
        self.flush_chunk()
        self._sealers.shutdown()
        self._append(self._end())
        self._ended = "it is closed"
        try:
            self._file.close()
        except OSError as error:
            raise self._error(f"may not be complete: {error.strerror}") from error

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self.close()

    def _end(self) -> bytes:
        """Return what closes the file as it is now."""
        first = self._first if self._summary[Op.CHUNK_INDEX] else 0
        statistics = encode.statistics(self._summary, first, self._last, self._written)
        groups = {**self._summary, Op.STATISTICS: [statistics]}
        data_end = encode.data_end(self._crc)
        return data_end + encode.tail(groups, self._size + len(data_end))

    def _append(self, *records: bytes) -> None:
        """Write records, all or none of them; an error ends the recording."""
        crc = self._crc
        try:
            for record in records:
                crc = zlib.crc32(record, crc)
                self._put(record)
            self._crc, self._size = crc, self._size + sum(map(len, records))
        except OSError as error:
            self._sealers.shutdown(wait=False, cancel_futures=True)
            self._give_up(error)
        except BaseException:  # Ctrl-C inside a record must not leave half of it
            self._rewind(self._size)
            raise

    def _put(self, record: bytes) -> None:
        rest = memoryview(record)
        while rest:
            rest = rest[self._file.write(rest) :]

    def _give_up(self, error: OSError) -> None:
        """End the recording after an error: closed, if there is room for that.

        There mostly is where a disk is full, for the chunk that did not fit leaves its room.

        Raises:
            RecordingError: always; says what is left.
        """
        self._ended = f"it stopped at an earlier error ({error.strerror})"
        closed = False
        with contextlib.suppress(OSError):  # the first error says it all
            self._rewind(self._size)
            if self._size:
                self._put(self._end())
                closed = True
        with contextlib.suppress(OSError):
            if not closed:
                self._rewind(self._size)
            self._file.close()
        what = "make room or record elsewhere"
        if not closed:
            what += ", and mend this file with 'lodeflow recover'"
        raise self._error(
            f"cannot be written: {error.strerror}. The recording ends here, after {self._size} "
            f"bytes of data{', closed and readable' if closed else ''}; {what}"
        ) from error

    def _rewind(self, size: int) -> None:
        self._file.truncate(size)
        self._file.seek(size)

    def _require_open(self) -> None:
        if self._ended:
            raise self._error(f"takes no more data: {self._ended}; record to a new file")

    def _error(self, what: str) -> RecordingError:
        return RecordingError(f"{self.path}: {what}")


def _negative(t: int) -> str:
    return f"the stamp {t} ns is negative, and MCAP has no such times; let event time start at 0"
