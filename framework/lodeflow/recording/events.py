"""Events of a run that are no messages of a node: logs, live changes, gaps. Texts, as ROS 2 CDR."""

from __future__ import annotations

import logging
import struct
from dataclasses import dataclass
from typing import NamedTuple

from lodeflow.errors import RecordingError
from lodeflow.messages.cdr import HEADER, LAST_STAMP

_TIME = "=" * 80 + "\nMSG: builtin_interfaces/Time\nint32 sec\nuint32 nanosec\n"


@dataclass(frozen=True)
class EventKind:
    """A kind of event.

    Attributes:
        topic: where it is recorded.
        ros: ROS 2 name of its type.
        schema: its ros2msg definition; the first member is the stamp.
        members: "s" for a string, "B" for a uint8, "I" for a uint32, "q" for an int64.
    """

    topic: str
    ros: str
    schema: str
    members: str

    def encode(self, t: int, *values: str | int) -> bytes:
        """Return the CDR record of one event.

        Args:
            t: stamp, ns.
            values: a text or number per member.
        """
        out = bytearray(struct.pack("<iI", *divmod(t, 1_000_000_000)))
        for code, value in zip(self.members, values, strict=True):
            if code == "s":
                data = str(value).encode(errors="replace") + b"\0"
                out += bytes(-len(out) % 4) + struct.pack("<I", len(data)) + data
            else:
                out += bytes(-len(out) % struct.calcsize(code)) + struct.pack(f"<{code}", value)
        return HEADER + bytes(out)

    def decode(self, record: bytes) -> list[str | int]:
        """Return the members of an event, without its stamp.

        Raises:
            RecordingError: the record is truncated.
        """
        values: list[str | int] = []
        at = len(HEADER) + 8
        try:
            for code in self.members:
                size = 4 if code == "s" else struct.calcsize(code)
                at += -(at - len(HEADER)) % size
                (value,) = struct.unpack_from("<I" if code == "s" else f"<{code}", record, at)
                at += size
                if code == "s":
                    text = record[at : at + value]
                    if len(text) != value:
                        raise struct.error
                    at += value
                    values.append(text.removesuffix(b"\0").decode("utf-8", "replace"))
                else:
                    values.append(value)
        except struct.error:
            raise RecordingError(f"{self.topic}: a record is truncated") from None
        return values


LOG = EventKind(
    "/rosout",
    "rcl_interfaces/msg/Log",
    "byte DEBUG=10\nbyte INFO=20\nbyte WARN=30\nbyte ERROR=40\nbyte FATAL=50\n"
    "builtin_interfaces/Time stamp\nuint8 level\nstring name\nstring msg\nstring file\n"
    "string function\nuint32 line\n" + _TIME,
    "BssssI",
)
CHANGE = EventKind(
    "/lodeflow/changes",
    "lodeflow_msgs/msg/Change",
    "# From the stamp on, a node is a fresh instance of this plugin with these parameters.\n"
    "builtin_interfaces/Time stamp\nstring node\nstring use\nstring params\n" + _TIME,
    "sss",
)
GAP = EventKind(
    "/lodeflow/gaps",
    "lodeflow_msgs/msg/Gap",
    "# A stretch of a stream that did not reach a process: stamps from begin to before end.\n"
    "builtin_interfaces/Time stamp\nstring stream\nstring sender\nstring reader\n"
    "int64 begin\nint64 end\n" + _TIME,
    "sssqq",
)
EVENTS = (LOG, CHANGE, GAP)
EVENT_TOPICS = frozenset(kind.topic for kind in EVENTS)
"""Topics that are no stream of a node."""


class RecordedGap(NamedTuple):
    """A stretch of a stream that did not reach who was to get it.

    Attributes:
        stream: its name.
        sender: the group that owed it, or the node if all ran in one process.
        reader: the group that did not get it; "recorder" for what is not in the recording.
        begin: first stamp that is missing, ns; NEVER if all is from the start on.
        end: first stamp that is there again, ns; END if none is.
    """

    stream: str
    sender: str
    reader: str
    begin: int
    end: int

    @classmethod
    def of(cls, values: list[str | int]) -> RecordedGap:
        """Return what the members of an event say."""
        stream, sender, reader, begin, end = values
        return cls(str(stream), str(sender), str(reader), int(begin), int(end))


def in_range(t: int) -> int:
    """Return a stamp that MCAP and ROS time can hold: 0 for what came before all messages."""
    return min(max(t, 0), LAST_STAMP)


def log_fields(record: logging.LogRecord) -> tuple[int, str, str, str, str, int]:
    """Return the members of a log record as an event."""
    return (
        min(record.levelno, 50),
        record.name,
        record.getMessage(),
        record.filename,
        record.funcName or "",
        record.lineno,
    )
