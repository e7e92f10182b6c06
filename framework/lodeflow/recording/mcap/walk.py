"""What stands in a chunk, found without an index; and whether an index leads to all of it."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from lodeflow.errors import MessageError
from lodeflow.recording.mcap.raw import numbers_at, places
from lodeflow.recording.mcap.records import INDEX_LAYOUT, LOG_TIME_AT, PREFIX, Op, message_layout

_DATA_AT = message_layout(0).itemsize


class Walked(NamedTuple):
    """What stands in a chunk: an index of each channel, and definitions as (op, body)."""

    indexes: dict[int, NDArray[Any]]
    definitions: list[tuple[int, bytes]]


def walked(raw: bytes) -> Walked | None:
    """Go through a chunk record by record; None where they do not follow each other."""
    at, starts = 0, []
    definitions: list[tuple[int, bytes]] = []
    while at < len(raw):
        if at + PREFIX.size > len(raw):
            return None
        op, length = PREFIX.unpack_from(raw, at)
        end = at + PREFIX.size + length
        if end > len(raw) or (op == Op.MESSAGE and end - at < _DATA_AT):
            return None
        if op == Op.MESSAGE:
            starts.append(at)
        elif op in (Op.SCHEMA, Op.CHANNEL):
            definitions.append((op, raw[at + PREFIX.size : end]))
        at = end
    indexes = {}
    if starts:
        rows = np.empty(len(starts), INDEX_LAYOUT)
        rows["offset"] = starts
        rows["log_time"] = numbers_at(raw, LOG_TIME_AT, "<u8")[starts]
        channels = numbers_at(raw, PREFIX.size, "<u2")[starts]
        for channel in np.unique(channels).tolist():
            found = rows[channels == channel]
            indexes[channel] = found[np.argsort(found["log_time"], kind="stable")]
    return Walked(indexes, definitions)


def tiles(raw: bytes, entries: list[tuple[int, NDArray[Any]]]) -> bool:
    """Whether the messages that the indexes lead to fill a chunk without gap or overlap."""
    filled = [(channel, rows) for channel, rows in entries if len(rows)]
    if not filled or len({channel for channel, _ in filled}) < len(filled):
        return False
    try:
        found = [places(raw, rows, channel) for channel, rows in filled]
    except MessageError:
        return False
    starts = np.concatenate([payloads for payloads, _ in found]) - _DATA_AT
    ends = starts + np.concatenate([sizes for _, sizes in found]) + _DATA_AT
    order = np.argsort(starts)
    starts, ends = starts[order], ends[order]
    inside = np.array_equal(starts[1:], ends[:-1])
    return bool(inside and starts[0] == 0 and ends[-1] == len(raw))


def equal(indexes: dict[int, NDArray[Any]], entries: list[tuple[int, NDArray[Any]]]) -> bool:
    """Whether the indexes of a file lead to all messages of a chunk."""
    found = {channel: np.sort(rows, order="offset") for channel, rows in entries if len(rows)}
    return found.keys() == indexes.keys() and all(
        np.array_equal(np.sort(rows, order="offset"), found[channel])
        for channel, rows in indexes.items()
    )


def filtered(raw: bytes, indexes: dict[int, NDArray[Any]]) -> tuple[bytes, dict[int, NDArray[Any]]]:
    """Return a chunk with the indexed messages alone, and its indexes."""
    starts = np.sort(np.concatenate([rows["offset"] for rows in indexes.values()])).tolist()
    kept = []
    for start in starts:
        length = PREFIX.unpack_from(raw, start)[1]
        kept.append(raw[start : start + PREFIX.size + length])
    raw = b"".join(kept)
    found = walked(raw)
    return raw, {} if found is None else found.indexes
