"""Viewing: what an onlooker makes of one stream. Decodes it, and counts what it did not get."""

from __future__ import annotations

import numpy as np

from lodeflow.errors import MessageError
from lodeflow.messages.cdr import StreamConstants, layout_of, read_constants
from lodeflow.messages.message import Message, by_ros_name
from lodeflow.sync import END
from lodeflow.transport import keys
from lodeflow.transport.frame import COUNT_MASK, DATA, Frame
from lodeflow.transport.onlooker import Sighting
from lodeflow.transport.window import ENCODING


class StreamView:
    """One stream, as it is seen from outside.

    Attributes:
        key: its key.
        type: ROS 2 name of its messages, "" before the first was seen.
        puts: puts of the stream that came; each holds a sample or a block.
        rows: messages in them.
        missed: puts that the run made and that did not come, since the first that did.
        begun_anew: how often its sender began anew.
        foreign: puts of strangers on its key; they are ignored.
        undecodable: puts whose payload is not what their type says.
        ended: whether the run has said that no more will come.
    """

    def __init__(self, key: str) -> None:
        self.key = key
        self.type = ""
        self.puts = self.rows = self.missed = self.begun_anew = 0
        self.foreign = self.undecodable = 0
        self.ended = False
        self._ours = key.startswith(f"{keys.DATA}/")
        self._next: int | None = None

    def see(self, sighting: Sighting) -> bool:
        """Count a put; return whether there is something to read in it."""
        frame = sighting.frame
        if frame is None and not self._ours:  # other programs' keys: records without attachment
            self._count(sighting, 1)
            return True
        if frame is None or not _is_sound(frame) or not sighting.encoding.startswith(ENCODING):
            self.foreign += 1
            return False
        number = frame.sequence & COUNT_MASK
        if self._next is not None and number < self._next:
            self.begun_anew += 1
        elif self._next is not None:
            self.missed += number - self._next
        self._next = number + 1
        self.ended = frame.bound == END
        if frame.rows:
            self._count(sighting, frame.rows)
        return bool(frame.rows)

    def read(self, sighting: Sighting) -> Message | None:
        """Return what a put holds, as a block.

        Returns:
            None if its type is unknown here, or if it does not hold what its type says, which is
            counted.
        """
        kind = by_ros_name.get(type_of(sighting))
        if kind is None:
            return None
        try:
            return decode(kind, sighting.payload, sighting.frame.rows if sighting.frame else 1)
        except MessageError:
            self.undecodable += 1
            return None

    def _count(self, sighting: Sighting, rows: int) -> None:
        self.type = type_of(sighting)
        self.puts += 1
        self.rows += rows


def type_of(sighting: Sighting) -> str:
    """Return the ROS 2 name in the encoding of a put, "" where there is none."""
    return sighting.encoding.partition(";")[2]


def decode(kind: type[Message], payload: bytes, rows: int) -> Message:
    """Return the block that a payload of so many CDR records holds.

    Raises:
        MessageError: it holds something else.
    """
    size, rest = divmod(len(payload), rows)
    if rest or not payload:
        raise MessageError(f"{kind.__name__}: {len(payload)} bytes are not {rows} records")
    layout = layout_of(kind)
    if size != layout.size:  # another frame_id than ours
        frame_id = read_constants(kind, payload[:size]).frame_id
        layout = layout_of(kind, StreamConstants(frame_id))
    return layout.decode_block(np.frombuffer(payload, dtype=np.uint8).reshape(rows, size))


def _is_sound(frame: Frame) -> bool:
    """Whether a window could have put this."""
    if (frame.kind, frame.group, frame.stream) != (DATA, 0, 0):
        return False
    if not frame.rows:
        return frame.bound == END and not frame.payload
    return len(frame.payload) % frame.rows == 0 and frame.first < frame.bound
