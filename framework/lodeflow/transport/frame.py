"""Frames: what travels over a key. A payload of whole CDR records, and a head of fixed size.

On the key of a stream the head is the attachment, so that everybody can read the records. On the
key of a link the head of a small frame stands before the records: Zenoh takes longer for a put that
has an attachment, by about a twentieth of the way of a small message.
"""

from __future__ import annotations

import struct
from typing import NamedTuple

HEAD = struct.Struct("<QqqII")
"""Sequence, first stamp, bound, count, flags: 32 bytes, little endian."""
SMALL = 4096
"""Bytes of a payload up to which its head stands before it; a larger one would be copied for it."""

DATA = 0
"""Records of one stream, or none: then only its bound."""
HELLO = 1
"""Who I am, whom I have heard, what to expect next; not in sequence."""
ACK = 2
"""All before this number has been taken; not in sequence."""
AGAIN = 3
"""Likewise, and send again from the number in `bound` on; not in sequence. `rows` is the turn of
the last probe, or SURE."""
STOP = 4
"""I have been told to stop, and my host with me; not in sequence."""
NOTE = 5
"""A text for the recorder: a log record, a loss, a change, a report."""
BYE = 6
"""I have everything from you, and you have everything from me; not in sequence."""
WAKE = 7
"""From oneself: end a wait."""
GONE = 8
"""I end with things unsaid, and will not come back; not in sequence. `rows` is 1 if I have not
begun: then nothing is missing."""

PROBE = 9
"""What have you got? All before the number in `bound` was sent; not in sequence. `rows` is the
turn: how often the sender has sent something again."""

Payload = bytes | bytearray
"""What is put; Zenoh copies it, and a link keeps it to send it again."""

NUMBERED = (DATA, NOTE)
"""Kinds that come in sequence, and again if they are lost."""

KIND_BITS, GROUP_BITS = 4, 10
STREAM_SHIFT = KIND_BITS + GROUP_BITS
COUNT_BITS = 40
"""Bits of the number of a frame; the incarnation of its sender stands above them."""
COUNT_MASK = (1 << COUNT_BITS) - 1
INCARNATIONS = 1 << (64 - COUNT_BITS)


class Frame(NamedTuple):
    """One frame of a link.

    Attributes:
        sequence: incarnation of the sender and number of the frame.
        first: stamp of the first record, ns.
        bound: no later record of the stream lies below it.
        rows: how many records.
        kind: DATA, HELLO, ....
        group: number of the sending group.
        stream: number of the stream in the graph.
        payload: records, or the text of a control frame.
    """

    sequence: int
    first: int
    bound: int
    rows: int
    kind: int
    group: int
    stream: int
    payload: bytes


def head_of(
    sequence: int, first: int, bound: int, count: int, kind: int, group: int, stream: int
) -> bytes:
    """Return the head of a frame."""
    return HEAD.pack(sequence, first, bound, count, flags_of(kind, group, stream))


def flags_of(kind: int, group: int, stream: int) -> int:
    """Return kind, sender and stream of a frame as one number."""
    return kind | group << KIND_BITS | stream << STREAM_SHIFT


def read(head: bytes, payload: bytes) -> Frame | None:
    """Return the frame, or None if the head is none of ours."""
    if len(head) != HEAD.size:
        return None
    sequence, first, bound, count, flags = HEAD.unpack(head)
    kind, group = flags & (1 << KIND_BITS) - 1, flags >> KIND_BITS & (1 << GROUP_BITS) - 1
    fields = (sequence, first, bound, count, kind, group, flags >> STREAM_SHIFT, payload)
    return tuple.__new__(Frame, fields)  # at half the cost of a call


def join(head: bytes, payload: Payload) -> tuple[Payload, bytes | None]:
    """Return what a link puts for a frame: payload and attachment."""
    return (head + payload, None) if len(payload) <= SMALL else (payload, head)


def part(payload: bytes, attachment: bytes | None) -> Frame | None:
    """Return the frame for which a link has put this, or None if it is none of ours."""
    if attachment is None:
        return read(payload[: HEAD.size], payload[HEAD.size :])
    return read(attachment, payload)
