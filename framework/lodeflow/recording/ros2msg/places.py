"""Where the members of one CDR record stand, by its definition: record for record, in Python.

The way for records whose size the definition does not fix. A string or a sequence moves what
follows it, so that each record is walked from its begin to its end; nothing is copied.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Mapping
from typing import Any

from lodeflow.errors import MessageError
from lodeflow.messages.cdr import HEADER
from lodeflow.messages.ros import PRIMITIVES
from lodeflow.recording.ros2msg.definition import Member, Struct

Found = list[int]
"""Where each wanted member was found; for a string its length field."""

Step = Callable[[bytes, int, int, int, Found], int]
"""Walks over a member: (bytes, where it may begin, begin and end of the body, found) -> its end."""

_LENGTH = struct.Struct("<I")


class Walk:
    """A definition made ready to walk over its records.

    Args:
        definition: the type.
        wanted: members whose places are asked for, by path, with their slots in what is returned.

    Raises:
        MessageError: it has a member whose encoding is not known.
    """

    def __init__(self, definition: Struct, wanted: Mapping[str, int]) -> None:
        self._slots = len(wanted)
        self._step = _struct(definition, wanted, {})

    def __call__(self, raw: bytes, start: int, size: int) -> Found:
        """Return where in `raw` the wanted members of one record stand.

        Args:
            raw: bytes that hold the record.
            start: where it starts.
            size: how many bytes it has.

        Raises:
            MessageError: it is no record of this type.
        """
        if raw[start : start + len(HEADER)] != HEADER:
            raise MessageError("a message is not plain little-endian CDR")
        body, end = start + len(HEADER), start + size
        found = [0] * self._slots
        at = self._step(raw, body, body, end, found)
        # Some middlewares fill a record up to a multiple of four bytes.
        if at != end and not (at < end < at + 4 and (end - body) % 4 == 0):
            raise MessageError(f"a message has {end - at} bytes too many")
        return found


def _struct(
    definition: Struct, wanted: Mapping[str, int], compiled: dict[str, Step], prefix: str = ""
) -> Step:
    """Return the step over a type; those without a wanted member are compiled once."""
    if not wanted and definition.name in compiled:
        return compiled[definition.name]
    steps = [_member(member, wanted, compiled, prefix) for member in definition.members]

    def step(raw: bytes, at: int, body: int, end: int, found: Found) -> int:
        for each in steps:
            at = each(raw, at, body, end, found)
        return at

    if not wanted:
        compiled[definition.name] = step
    return step


def _member(
    member: Member, wanted: Mapping[str, int], compiled: dict[str, Step], prefix: str
) -> Step:
    path = prefix + member.name
    slot = wanted.get(path)
    if isinstance(member.type, Struct):
        single = member.count is None and not member.sequence
        inside = {key: to for key, to in wanted.items() if single and key.startswith(f"{path}.")}
        return _times(_struct(member.type, inside, compiled, f"{path}."), member)
    if member.type == "string":
        return _times(_string(path, slot), member)
    if member.type == "wstring":
        raise MessageError(f"'{path}' is a wstring, whose encoding differs between middlewares")
    return _numbers(path, slot, PRIMITIVES[member.type][0], member)


def _times(step: Step, member: Member) -> Step:
    """Return the step over the elements of an array; each has a byte at least, so it ends."""
    if member.count is None and not member.sequence:
        return step

    def repeat(raw: bytes, at: int, body: int, end: int, found: Found) -> int:
        count = member.count
        if count is None:
            at, count = _count(raw, at, body, end, member.name)
        for _ in range(count):
            at = step(raw, at, body, end, found)
        return at

    return repeat


def _numbers(path: str, slot: int | None, size: int, member: Member) -> Step:
    def step(raw: bytes, at: int, body: int, end: int, found: Found) -> int:
        count = 1 if member.count is None else member.count
        if member.sequence:
            at, count = _count(raw, at, body, end, path)
            if not count:
                return at
        at += (body - at) % size
        if slot is not None:
            found[slot] = at
        at += size * count
        if at > end:
            raise MessageError(f"a message is truncated at {path}")
        return at

    return step


def _string(path: str, slot: int | None) -> Step:
    def step(raw: bytes, at: int, body: int, end: int, found: Found) -> int:
        at, length = _count(raw, at, body, end, path)
        if slot is not None:
            found[slot] = at - _LENGTH.size
        if at + length > end:
            raise MessageError(f"a message is truncated at {path}")
        return at + length

    return step


def _count(raw: Any, at: int, body: int, end: int, path: str) -> tuple[int, int]:
    """Return where the elements begin, and how many there are."""
    at += (body - at) % _LENGTH.size
    if at + _LENGTH.size > end:
        raise MessageError(f"a message is truncated at {path}")
    return at + _LENGTH.size, int(_LENGTH.unpack_from(raw, at)[0])
