"""The records of an MCAP file as bytes.

Source: MCAP Format Specification, version 0 (https://mcap.dev/spec). All integers are little
endian; a string, an array or a map is led by its length in bytes as uint32.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Mapping
from enum import IntEnum
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

MAGIC = b"\x89MCAP0\r\n"


class Op(IntEnum):
    """The first byte of a record."""

    HEADER = 0x01
    FOOTER = 0x02
    SCHEMA = 0x03
    CHANNEL = 0x04
    MESSAGE = 0x05
    CHUNK = 0x06
    MESSAGE_INDEX = 0x07
    CHUNK_INDEX = 0x08
    ATTACHMENT = 0x09
    ATTACHMENT_INDEX = 0x0A
    STATISTICS = 0x0B
    METADATA = 0x0C
    METADATA_INDEX = 0x0D
    SUMMARY_OFFSET = 0x0E
    DATA_END = 0x0F


PREFIX = struct.Struct("<BQ")  # opcode, length of what follows


@lru_cache(maxsize=256)
def message_layout(size: int) -> np.dtype[Any]:
    """Return the packed layout of a message record with a payload of `size` bytes."""
    return np.dtype(
        [
            ("op", "u1"),
            ("length", "<u8"),
            ("channel", "<u2"),
            ("sequence", "<u4"),
            ("log_time", "<u8"),
            ("publish_time", "<u8"),
            ("data", "u1", (size,)),
        ]
    )


LOG_TIME_AT = 15
"""Offset of the log time in a message record."""

INDEX_LAYOUT = np.dtype([("log_time", "<u8"), ("offset", "<u8")])
"""One entry of a message index; the offset counts in the uncompressed chunk."""


def record(op: Op, *parts: bytes) -> bytes:
    """Return one whole record."""
    return b"".join((PREFIX.pack(op, sum(map(len, parts))), *parts))


def string(text: str) -> bytes:
    """Return a length-prefixed string."""
    return blob(text.encode())


def blob(data: bytes) -> bytes:
    """Return length-prefixed bytes."""
    return struct.pack("<I", len(data)) + data


def string_map(entries: Mapping[str, str]) -> bytes:
    """Return a map of strings to strings."""
    return blob(b"".join(string(key) + string(value) for key, value in entries.items()))


def id_map(entries: Mapping[int, int]) -> bytes:
    """Return a map of channel ids to counts or offsets."""
    return blob(b"".join(struct.pack("<HQ", *entry) for entry in entries.items()))


def header(profile: str, library: str) -> bytes:
    """Return the first record of a file."""
    return record(Op.HEADER, string(profile), string(library))


def schema(schema_id: int, name: str, encoding: str, data: bytes) -> bytes:
    """Return a schema; its id must not be 0."""
    number = struct.pack("<H", schema_id)
    return record(Op.SCHEMA, number, string(name), string(encoding), blob(data))


def channel(
    channel_id: int, schema_id: int, topic: str, encoding: str, metadata: Mapping[str, str]
) -> bytes:
    """Return a channel."""
    ids = struct.pack("<HH", channel_id, schema_id)
    return record(Op.CHANNEL, ids, string(topic), string(encoding), string_map(metadata))


def chunk(start: int, end: int, size: int, crc: int, compression: str, compressed: bytes) -> bytes:
    """Return a chunk; `start` and `end` are log times, size and crc are of the raw records."""
    head = struct.pack("<QQQI", start, end, size, crc) + string(compression)
    return record(Op.CHUNK, head, struct.pack("<Q", len(compressed)), compressed)


def message_index(channel_id: int, entries: NDArray[Any]) -> bytes:
    """Return the index of one channel in a chunk; `entries` have INDEX_LAYOUT."""
    head = struct.pack("<HI", channel_id, entries.nbytes)
    return record(Op.MESSAGE_INDEX, head, entries.tobytes())


def chunk_index(
    start: int,
    end: int,
    offset: int,
    length: int,
    index_offsets: Mapping[int, int],
    index_length: int,
    compression: str,
    compressed_size: int,
    size: int,
) -> bytes:
    """Return the index entry of a chunk, whose record has `length` bytes at `offset`."""
    return record(
        Op.CHUNK_INDEX,
        struct.pack("<QQQQ", start, end, offset, length),
        id_map(index_offsets),
        struct.pack("<Q", index_length),
        string(compression),
        struct.pack("<QQ", compressed_size, size),
    )


def attachment(t: int, name: str, media_type: str, data: bytes) -> bytes:
    """Return an attachment logged at `t`; its time of creation is left unknown (0)."""
    head = struct.pack("<QQ", t, 0) + string(name) + string(media_type)
    head += struct.pack("<Q", len(data))
    crc = zlib.crc32(data, zlib.crc32(head))
    return record(Op.ATTACHMENT, head, data, struct.pack("<I", crc))


def attachment_index(
    offset: int, length: int, t: int, size: int, name: str, media_type: str, *, created: int = 0
) -> bytes:
    """Return the index entry of an attachment."""
    numbers = struct.pack("<QQQQQ", offset, length, t, created, size)
    return record(Op.ATTACHMENT_INDEX, numbers, string(name), string(media_type))


def metadata(name: str, entries: Mapping[str, str]) -> bytes:
    """Return named pairs of strings."""
    return record(Op.METADATA, string(name), string_map(entries))


def metadata_index(offset: int, length: int, name: str) -> bytes:
    """Return the index entry of a metadata record."""
    return record(Op.METADATA_INDEX, struct.pack("<QQ", offset, length), string(name))


def statistics(
    groups: Mapping[Op, list[bytes]], start: int, end: int, message_counts: Mapping[int, int]
) -> bytes:
    """Return the statistics; `groups` are the other records of the summary, by opcode."""
    kinds = (Op.SCHEMA, Op.CHANNEL, Op.ATTACHMENT_INDEX, Op.METADATA_INDEX, Op.CHUNK_INDEX)
    counts = [len(groups[kind]) for kind in kinds]
    numbers = struct.pack("<QHIIIIQQ", sum(message_counts.values()), *counts, start, end)
    return record(Op.STATISTICS, numbers, id_map(message_counts))


def data_end(crc: int) -> bytes:
    """Return the end of the data section; `crc` is of all bytes before it."""
    return record(Op.DATA_END, struct.pack("<I", crc))


def tail(groups: Mapping[Op, list[bytes]], at: int) -> bytes:
    """Return summary, summary offsets, footer and closing magic.

    Args:
        groups: the records of the summary, by opcode, in the order to write them.
        at: where in the file the summary begins.
    """
    summary, offsets, position = [], [], at
    for op, records in groups.items():
        if records:
            group = b"".join(records)
            place = struct.pack("<BQQ", op, position, len(group))
            summary.append(group)
            offsets.append(record(Op.SUMMARY_OFFSET, place))
            position += len(group)
    # The CRC covers the footer up to itself.
    length = struct.calcsize("<QQI")
    body = b"".join((*summary, *offsets, PREFIX.pack(Op.FOOTER, length)))
    body += struct.pack("<QQ", at if summary else 0, position if offsets else 0)
    return body + struct.pack("<I", zlib.crc32(body)) + MAGIC
