"""Records of a foreign definition as records of ours: the members that lodeflow's type has."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from lodeflow.errors import MessageError
from lodeflow.messages.cdr import LONGEST_FRAME, TEXT_AT, StreamConstants, layout_of
from lodeflow.messages.message import Message
from lodeflow.messages.ros import PRIMITIVES, Leaf, definition, leaves
from lodeflow.recording.mcap.raw import numbers_at
from lodeflow.recording.ros2msg.definition import Member, Struct, parse
from lodeflow.recording.ros2msg.places import Walk

_FRAME = "header.frame_id"


class Translation:
    """From the records that a file defines to those of a message type, by the names of members.

    What the type declares must be there, in the same shape, and in a type that fits into its own
    without loss (float32 into float64). Members that it does not declare are kept where ROS has
    them too, and left out otherwise.

    Args:
        kind: the message type.
        found: what the file defines.

    Raises:
        MessageError: it does not fit; names the member.
    """

    def __init__(self, kind: type[Message], found: Struct) -> None:
        self.kind = kind
        self._members = dict(_taken(kind, found))
        paths = [leaf.path for leaf in self._members]
        self._walk = Walk(found, {path: slot for slot, path in enumerate([_FRAME, *paths])})

    def records(
        self, raw: bytes, starts: NDArray[np.int64], sizes: NDArray[np.int64]
    ) -> tuple[bytes, NDArray[np.int64], NDArray[np.int64]]:
        """Return some payloads as those of the message type: bytes, where they start, sizes.

        Args:
            raw: bytes that hold the payloads.
            starts: (N,) where they start, N > 0.
            sizes: (N,) their sizes.

        Raises:
            MessageError: a payload is none of the type that the file defines.
        """
        places = np.empty((len(starts), 1 + len(self._members)), np.int64)
        for row, record in enumerate(zip(starts.tolist(), sizes.tolist(), strict=True)):
            places[row] = self._walk(raw, *record)
        texts = numbers_at(raw, 0, "<u4")[places[:, 0]]
        if texts.max() > LONGEST_FRAME:
            raise MessageError(
                f"frame_id has {texts.max()} bytes; at most {LONGEST_FRAME} are read"
            )
        parts = []
        into = np.empty((len(places), 2), np.int64)
        begin = 0
        for text in np.unique(texts).tolist():  # of one length of frame_id, all is in one place
            rows = np.flatnonzero(texts == text)
            part = self._translated(raw, places[rows], text)
            into[rows, 0] = begin + np.arange(len(rows)) * part.shape[1]
            into[rows, 1] = part.shape[1]
            begin += part.size
            parts.append(part.tobytes())
        return b"".join(parts), into[:, 0], into[:, 1]

    def _translated(self, raw: bytes, places: NDArray[Any], text: int) -> NDArray[np.uint8]:
        constants = StreamConstants("?" * max(0, text - 1), StreamConstants.of(self.kind).values)
        layout = layout_of(self.kind, constants)
        out = np.empty((len(places), layout.size), np.uint8)
        out[:] = np.frombuffer(layout.template, np.uint8)
        if text:
            out[:, TEXT_AT + 4 : TEXT_AT + 4 + text] = _bytes(raw, places[:, 0] + 4, text)
        for slot, (leaf, member) in enumerate(self._members.items(), 1):
            size = PRIMITIVES[leaf.type][0] * (leaf.count or 1)
            at = layout.offsets[leaf.path]
            if member.type == leaf.type:
                out[:, at : at + size] = _bytes(raw, places[:, slot], size)
            else:
                out[:, at : at + size] = _widened(raw, places[:, slot], leaf, member)
        return out


def translation(kind: type[Message], name: str, schema: bytes) -> Translation | None:
    """Return how to read what a schema defines as a message type; None if it is the same.

    Raises:
        MessageError: it is no definition that can be read, or does not fit.
    """
    found = parse(name, schema)
    ours = list(leaves(definition(kind)))
    if [(m.type, m.count, path) for path, m in _flat(found, len(ours) + 1)] == [
        (leaf.type, leaf.count, leaf.path) for leaf in ours
    ]:
        return None
    return Translation(kind, found)


def _flat(found: Struct, most: int, prefix: str = "") -> list[tuple[str, Member]]:
    """Return up to `most` members without members of their own, in wire order."""
    flat: list[tuple[str, Member]] = []
    for member in found.members:
        if isinstance(member.type, Struct) and member.count is None and not member.sequence:
            flat += _flat(member.type, most - len(flat), f"{prefix}{member.name}.")
        else:
            flat.append((prefix + member.name, member))
        if len(flat) >= most:
            break
    # A sequence has no form in our definitions, and is equal to nothing in them.
    return [(path, Member(m.name, "[]") if m.sequence else m) for path, m in flat]


def _taken(kind: type[Message], found: Struct) -> list[tuple[Leaf, Member]]:
    """Return the members of a type that a definition has, beside frame_id."""
    frame = found.find(_FRAME)
    if frame is None or str(frame) != "string frame_id":
        raise MessageError(f"{found.name} has no 'std_msgs/Header header' in this file")
    taken = []
    undeclared = {path for path, _ in StreamConstants.of(kind).values}
    for leaf in leaves(definition(kind)):
        member = found.find(leaf.path)
        if leaf.path == _FRAME:
            continue
        if member is not None and _fits(leaf, member, exact=leaf.path in undeclared):
            taken.append((leaf, member))
        elif leaf.path not in undeclared:
            array = "" if leaf.count is None else f"[{leaf.count}]"
            there = "" if member is None else f", but '{member}'"
            raise MessageError(
                f"{kind.__name__} needs '{leaf.type}{array} {leaf.path}', which {found.name} "
                f"does not have in this file{there}"
            )
    return taken


def _fits(leaf: Leaf, member: Member, *, exact: bool) -> bool:
    if member.type not in PRIMITIVES or member.sequence or member.count != leaf.count:
        return False
    if member.type == leaf.type or exact:
        return member.type == leaf.type
    ours, theirs = _dtype(leaf.type), _dtype(str(member.type))
    return (ours.kind == "f") == (theirs.kind == "f") and np.can_cast(theirs, ours, "safe")


def _dtype(primitive: str) -> np.dtype[Any]:
    return np.dtype("<" + PRIMITIVES[primitive][1])


def _bytes(raw: bytes, places: NDArray[Any], size: int) -> NDArray[np.uint8]:
    """Return (N, size) bytes, gathered from (N,) places."""
    anywhere = np.ndarray(len(raw) - size + 1, f"V{size}", raw, strides=(1,))
    found: NDArray[np.uint8] = anywhere[places].view(np.uint8).reshape(-1, size)
    return found


def _widened(raw: bytes, places: NDArray[Any], leaf: Leaf, member: Member) -> NDArray[np.uint8]:
    count, theirs = leaf.count or 1, _dtype(str(member.type))
    values = _bytes(raw, places, count * theirs.itemsize).view(theirs)
    wide: NDArray[np.uint8] = values.astype(_dtype(leaf.type), order="C").view(np.uint8)
    return wide
