"""The records of an MCAP file one after the other, whatever has happened to it."""

from __future__ import annotations

import os
import struct
from collections.abc import Iterator
from typing import BinaryIO, NamedTuple

import numpy as np

from lodeflow.recording.mcap.raw import numbers_at
from lodeflow.recording.mcap.records import MAGIC, PREFIX, Op

_SHAPES: dict[int, tuple[int | str, ...]] = {
    # Bytes of fixed size; "I" and "Q": data led by its length as uint32 or uint64.
    Op.HEADER: ("I", "I"),
    Op.FOOTER: (20,),
    Op.SCHEMA: (2, "I", "I", "I"),
    Op.CHANNEL: (4, "I", "I", "I"),
    Op.CHUNK: (28, "I", "Q"),
    Op.MESSAGE_INDEX: (2, "I"),
    Op.CHUNK_INDEX: (32, "I", 8, "I", 16),
    Op.ATTACHMENT: (16, "I", "I", "Q", 4),
    Op.ATTACHMENT_INDEX: (40, "I", "I"),
    Op.STATISTICS: (42, "I"),
    Op.METADATA: ("I", "I"),
    Op.METADATA_INDEX: (16, "I"),
    Op.SUMMARY_OFFSET: (17,),
    Op.DATA_END: (4,),
}
_SMALLEST_MESSAGE = 22
_SMALLEST_WINDOW, _WINDOW = 1 << 12, 1 << 20
_LENGTHS = {"I": struct.Struct("<I"), "Q": struct.Struct("<Q")}


class Item(NamedTuple):
    """A record, or bytes that are none.

    Attributes:
        op: its opcode; None for bytes that are no record.
        start: where it starts in the file.
        end: where it ends.
    """

    op: Op | None
    start: int
    end: int


class Scan:
    """Iterates over what stands in a file behind its magic bytes.

    Where records do not follow each other, the next one is searched for: all of a record's
    lengths must fit each other, so that other data is hardly ever taken for one. Each byte is in
    exactly one item; the closing magic bytes are in none.

    Args:
        file: the file, open for reading; its position is not moved.
    """

    def __init__(self, file: BinaryIO) -> None:
        self._number = file.fileno()
        self.size = os.fstat(self._number).st_size

    def __iter__(self) -> Iterator[Item]:
        at = len(MAGIC)
        while at < self.size:
            item = self._item(at)
            if item is None:
                item = Item(None, at, self._next(at))
            elif item.op == Op.HEADER and at > len(MAGIC):  # another file begins
                item = Item(None, at, self.size)
            yield item
            at = item.end
            if item.op == Op.FOOTER and self.read(at, len(MAGIC)) == MAGIC:
                at += len(MAGIC)
                if at < self.size:
                    yield Item(None, at, self.size)
                return

    def read(self, start: int, length: int) -> bytes:
        """Return bytes of the file, fewer at its end."""
        return os.pread(self._number, length, start)

    def body(self, item: Item) -> bytes:
        """Return a record without its prefix."""
        start = item.start + PREFIX.size
        return self.read(start, item.end - start)

    def _item(self, at: int, *, messages: bool = True) -> Item | None:
        """Return the record at a place, None if there is no whole one."""
        prefix = self.read(at, PREFIX.size)
        if len(prefix) < PREFIX.size:
            return None
        op, length = PREFIX.unpack(prefix)
        end = at + PREFIX.size + length
        if end > self.size:
            return None
        if op == Op.MESSAGE:
            good = messages and length >= _SMALLEST_MESSAGE
        else:
            good = op in _SHAPES and self._fits(_SHAPES[op], at + PREFIX.size, end)
        return Item(Op(op), at, end) if good else None

    def _fits(self, shape: tuple[int | str, ...], at: int, end: int) -> bool:
        for part in shape:
            if isinstance(part, int):
                at += part
            else:
                length = _LENGTHS[part]
                data = self.read(at, length.size)
                if len(data) < length.size:
                    return False
                at += length.size + int(length.unpack(data)[0])
            if at > end:
                return False
        return at == end

    def _next(self, at: int) -> int:
        """Return where the next record begins, behind a place without one."""
        prefix = self.read(at, PREFIX.size)
        if len(prefix) == PREFIX.size:  # only its opcode or a length inside it may be wrong
            end = at + PREFIX.size + int(PREFIX.unpack(prefix)[1])
            if end < self.size and self._item(end) is not None:
                return end
        # No search for messages: anything that is long enough could be one.
        ops = np.zeros(256, dtype=bool)
        ops[list(_SHAPES)] = True
        start, size = at + 1, _SMALLEST_WINDOW  # the next one is mostly near
        while start < self.size:
            window = self.read(start, size + PREFIX.size - 1)
            lengths = numbers_at(window, 1, "<u8")
            room = np.uint64(max(0, self.size - start))
            found = ops[np.frombuffer(window, np.uint8)[: len(lengths)]] & (lengths < room)
            near: list[int] = np.flatnonzero(found).tolist()
            for place in near:
                if self._item(start + place, messages=False) is not None:
                    return start + place
            start, size = start + size, min(2 * size, _WINDOW)
        return self.size
