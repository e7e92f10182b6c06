"""One stream out of MCAP chunks: the gather of its records, and their columns."""

from __future__ import annotations

import logging
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lodeflow.errors import MessageError
from lodeflow.messages.cdr import (
    HEADER,
    LONGEST_FRAME,
    TEXT_AT,
    Layout,
    StreamConstants,
    layout_of,
    read_constants,
)
from lodeflow.messages.message import Message
from lodeflow.messages.ros import PRIMITIVES, definition, leaves
from lodeflow.recording.mcap.raw import picked, places
from lodeflow.recording.ros2msg.translation import Translation
from lodeflow.sync import NEVER

_HEADER = int.from_bytes(HEADER, "little")
_FRAME = "frame_id"
MOST_LAYOUTS = 64
"""Lengths of frame_id whose layouts are kept at hand."""

log = logging.getLogger(__name__)


class StreamDecoder:
    """Decodes the messages of one topic, chunk after chunk.

    Where a record ends and its members stand depends on the length of frame_id alone, so that
    records of one length of frame_id are one gather and one block. Records that a file defines
    with other members are first translated into such.

    Args:
        kind: type of the messages.
        channels: ids of the channels of the topic.
        translation: how their records become those of the type; None if they are.

    Attributes:
        kind: type of the messages.
        channels: ids of the channels of the topic.
        count: messages decoded.
    """

    def __init__(
        self, kind: type[Message], channels: list[int], translation: Translation | None = None
    ) -> None:
        self.kind = kind
        self.channels = channels
        self.count = 0
        self._translation = translation
        self._last = NEVER
        self._layouts: dict[tuple[int, int], tuple[Layout, np.dtype[Any]]] = {}
        self._first: NDArray[Any] | None = None  # the constants of the first record
        self._first_key = (0, 0)
        self._frames = 0  # messages whose frame_id is not that of the first
        self._values = 0  # messages whose other constants are not those of the first

    def decode(self, raw: bytes, entries: NDArray[Any], channels: NDArray[Any]) -> Message:
        """Return the messages at some places of a chunk as one block, in the order of stamps.

        Args:
            raw: the records of the chunk.
            entries: (N,) INDEX_LAYOUT, N > 0.
            channels: (N,) the channel id of each.

        Raises:
            MessageError: the index or a message is damaged; a stamp repeats, or goes back
                behind the chunks before.
        """
        block = self.block(raw, *places(raw, entries, channels))
        self.count += len(block)
        return self._ordered(block)

    def block(self, raw: bytes, starts: NDArray[np.int64], sizes: NDArray[np.int64]) -> Message:
        """Return the messages with some payloads as one block, in their order.

        Args:
            raw: bytes that hold the payloads.
            starts: (N,) where they start, N > 0.
            sizes: (N,) their sizes.

        Raises:
            MessageError: a payload is none of this type.
        """
        raw, starts, sizes = self._translated(raw, starts, sizes)
        if sizes.min() < TEXT_AT + 4:
            raise MessageError("a message is cut off")
        texts = picked(raw, starts, TEXT_AT, "<u4")
        if (sizes == sizes[0]).all() and (texts == texts[0]).all():
            return self._columns(raw, starts, (int(sizes[0]), int(texts[0])))
        return self._mixed(raw, starts, np.stack([sizes, texts], axis=1))

    def constants(self, raw: bytes, start: int, size: int) -> StreamConstants:
        """Return the frame_id of one payload, and the members that the type does not declare.

        Raises:
            MessageError: the payload is none of this type.
        """
        place = np.array([start]), np.array([size])
        raw, starts, sizes = self._translated(raw, *place)
        record = raw[starts[0] : starts[0] + sizes[0]]
        self._lay_out(record, int.from_bytes(record[TEXT_AT : TEXT_AT + 4], "little"))
        return read_constants(self.kind, record)

    def _translated(
        self, raw: bytes, starts: NDArray[np.int64], sizes: NDArray[np.int64]
    ) -> tuple[bytes, NDArray[np.int64], NDArray[np.int64]]:
        """Return payloads in the layout of the type."""
        if sizes.min() < TEXT_AT + 4:
            raise MessageError("a message is cut off")
        if self._translation is None:
            return raw, starts, sizes
        return self._translation.records(raw, starts, sizes)

    def warn(self, where: str) -> None:
        """Log how many messages differ from the first in what a stream keeps but once."""
        if self._frames:
            log.warning(
                "%s: frame_id differs from that of the first message, which is kept, in %d of %d "
                "messages",
                where, self._frames, self.count,
            )  # fmt: skip
        if self._values:
            log.warning(
                "%s: members that %s does not declare differ from those of the first message in "
                "%d of %d messages; only those of the first are kept",
                where, self.kind.__name__, self._values, self.count,
            )  # fmt: skip

    def _mixed(self, raw: bytes, starts: NDArray[Any], keys: NDArray[Any]) -> Message:
        """Decode records of several lengths: a block of each, put back in their order."""
        unique, which = np.unique(keys, axis=0, return_inverse=True)
        if self._first is None:  # what the others are compared to is the first, not the shortest
            self._columns(raw, starts[:1], (int(keys[0, 0]), int(keys[0, 1])))
        rows = [np.flatnonzero(which == group) for group in range(len(unique))]
        blocks = [
            self._columns(raw, starts[of], (size, text))
            for of, (size, text) in zip(rows, unique.tolist(), strict=True)
        ]
        return self.kind.concat(blocks)[np.argsort(np.concatenate(rows))]

    def _columns(self, raw: bytes, starts: NDArray[Any], key: tuple[int, int]) -> Message:
        size, text = key
        records = picked(raw, starts, 0, np.dtype([("bytes", "u1", (size,))]))["bytes"]
        if (records[:, : len(HEADER)].view("<u4") != _HEADER).any():
            raise MessageError("a message is not plain little-endian CDR")
        if key not in self._layouts:
            if len(self._layouts) == MOST_LAYOUTS:
                self._layouts.clear()
            self._layouts[key] = self._lay_out(records[0].tobytes(), text)
        layout, undeclared = self._layouts[key]
        constants = records.view(undeclared)[:, 0]
        if self._first is None:
            self._first, self._first_key = constants[:1].copy(), key
        if key == self._first_key:
            changed = constants[_FRAME] != self._first[_FRAME]
            self._frames += _rows(changed)
        else:
            self._frames += len(records)
        rest = [name for name in undeclared.names or () if name != _FRAME]
        if rest:
            parts = [constants[name] != self._first[name] for name in rest]
            self._values += _rows(np.hstack(parts))
        return layout.decode_block(records)

    def _lay_out(self, record: bytes, text: int) -> tuple[Layout, np.dtype[Any]]:
        """Return where the members of a record like this one stand, declared and undeclared."""
        read_constants(self.kind, record)  # raises if the record is none of this type
        if not text:
            raise MessageError("frame_id has no terminating zero byte")
        if text > LONGEST_FRAME:
            raise MessageError(f"frame_id has {text} bytes; at most {LONGEST_FRAME} are read")
        # Any text of that length will do: nothing is encoded with this layout.
        layout = layout_of(self.kind, StreamConstants("?" * (text - 1)))
        return layout, _undeclared_layout(layout, text)

    def _ordered(self, block: Message) -> Message:
        t = block.t
        if (t[1:] < t[:-1]).any():
            block = block[np.argsort(t, kind="stable")]
            t = block.t
        twice = np.flatnonzero(t[1:] == t[:-1])
        if len(twice):
            raise MessageError(f"two messages have the stamp {t[twice[0]]} ns")
        if t[0] <= self._last:
            raise MessageError(
                f"the stamp {t[0]} ns does not lie behind {self._last} ns, of an earlier chunk; "
                "if chunks overlap in time, 'mcap sort' puts them in order"
            )
        self._last = int(t[-1])
        return block


def _rows(which: NDArray[np.bool_]) -> int:
    """Return how many rows of a matrix have a true element."""
    return int(which.any(axis=1).sum()) if which.any() else 0


def _undeclared_layout(layout: Layout, text: int) -> np.dtype[Any]:
    """Return where frame_id and the undeclared members of a record stand, as bytes."""
    undeclared = {path for path, _ in StreamConstants.of(layout.kind).values}
    places = [
        (layout.offsets[leaf.path], PRIMITIVES[leaf.type][0] * (leaf.count or 1))
        for leaf in leaves(definition(layout.kind))
        if leaf.path in undeclared
    ]
    joined: list[tuple[int, int]] = []
    for start, size in places:
        if joined and sum(joined[-1]) == start:
            start, size = joined[-1][0], joined.pop()[1] + size
        joined.append((start, size))

    # Words compare faster than bytes; -0.0 is not 0.0 here, and NaN is NaN.
    def words(size: int) -> tuple[str, tuple[int]]:
        width = next(width for width in (8, 4, 1) if size % width == 0)
        return f"<u{width}", (size // width,)

    return np.dtype(
        {
            "names": [_FRAME, *(f"part {number}" for number in range(len(joined)))],
            "formats": [words(text), *(words(size) for _, size in joined)],
            "offsets": [TEXT_AT + 4, *(start for start, _ in joined)],
            "itemsize": layout.size,
        }
    )
