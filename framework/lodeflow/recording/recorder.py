"""Recorder: takes the streams of a run off its hands, and writes them as columns.

The run only appends to a queue per stream; a thread encodes, compresses and writes. A chunk is
closed at least once a second, so that a kill loses less than that.
"""

from __future__ import annotations

import logging
import struct
import threading
from collections import deque
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from lodeflow.clock import monotonic
from lodeflow.errors import MessageError, RecordingError
from lodeflow.graph.model import Wire
from lodeflow.messages.cdr import HEADER, Layout, layout_of
from lodeflow.messages.message import Message
from lodeflow.messages.ros import schema_text
from lodeflow.recording.columns import LOG_TOPIC
from lodeflow.recording.mcap.writer import McapWriter
from lodeflow.runtime.plan import Plan

PERIOD = 0.1
"""Seconds between two looks of the thread into its queues."""
CHUNK_SECONDS = 0.8
"""Wall time after which the open chunk is closed, a look's length below the promised second."""
BACKLOG = 8
"""Blocks that may wait to be written before the run is held back."""
LOG_SCHEMA = (
    "rcl_interfaces/msg/Log",
    "byte DEBUG=10\nbyte INFO=20\nbyte WARN=30\nbyte ERROR=40\nbyte FATAL=50\n"
    "builtin_interfaces/Time stamp\nuint8 level\nstring name\nstring msg\nstring file\n"
    "string function\nuint32 line\n" + "=" * 80 + "\nMSG: builtin_interfaces/Time\n"
    "int32 sec\nuint32 nanosec\n",
)


def topic(wire: Wire) -> str:
    """Return the topic of a stream: /node, or /node/port where the port has a name."""
    return f"/{wire}".replace(".", "/")


class Recorder:
    """Writes the streams of one run into one MCAP file.

    Args:
        path: the file; its folder is made if missing.
        graph: the resolved graph as text, attached as graph.yaml.
        provenance: what else is needed to run it again, as texts.

    Raises:
        RecordingError: the file cannot be written.
    """

    def __init__(self, path: Path, *, graph: str, provenance: Mapping[str, str]) -> None:
        self.path = path
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise RecordingError(f"{path}: {error.strerror}; choose another folder") from error
        self.writer = McapWriter(path)
        self.writer.metadata("lodeflow.provenance", provenance)
        self.writer.attachment("graph.yaml", "application/yaml", graph.encode())
        self.streams: list[_Stream] = []
        self.error: RecordingError | None = None
        self.reached = 0
        self._log = _LogStream(self)
        self._closing = False
        self._wake = threading.Event()
        self._room = threading.Event()
        self._thread = threading.Thread(target=self._work, name="recorder", daemon=True)

    def attach(self, plan: Plan, wires: Iterable[Wire]) -> None:
        """Record these streams of a plan, and what its nodes log; then start writing."""
        kinds = {
            Wire(name, port.name): port.type
            for name, node in plan.nodes.items()
            for port in node.spec.outputs
        }
        for wire in wires:
            layout = layout_of(kinds[wire])
            channel = self.writer.channel(topic(wire), kinds[wire].ros, schema_text(kinds[wire]))
            stream = _Stream(channel, layout)
            self.streams.append(stream)
            plan.tap(wire, stream.queue.append)
        logging.getLogger("lodeflow").addHandler(self._log)
        self._thread.start()

    def keep_up(self, reached: int) -> None:
        """Called by the run between batches: waits while much is unwritten, and reports errors.

        Raises:
            RecordingError: writing has failed.
        """
        self.reached = max(self.reached, reached)
        while self.error is None and any(len(s.queue) > BACKLOG for s in self.streams):
            if not any(s.holds_blocks for s in self.streams):
                break  # single samples come at a pace; they are written by the clock
            self._room.clear()
            self._wake.set()
            self._room.wait(PERIOD)
        if self.error is not None:
            raise self.error

    def close(self, summary: Mapping[str, str]) -> None:
        """Write what is left, a summary of the run, and the end of the file.

        Raises:
            RecordingError: writing has failed now or earlier; the file is still readable.
        """
        logging.getLogger("lodeflow").removeHandler(self._log)
        self._closing = True
        self._wake.set()
        if self._thread.is_alive():
            self._thread.join()
        try:
            if self.error is None:
                self._drain()
                self.writer.flush_chunk()
                self.writer.metadata("lodeflow.summary", summary)
        except Exception as error:
            self.error = self._as_recording_error(error)
        finally:
            self.writer.close()
        if self.error is not None:
            raise self.error

    def _work(self) -> None:
        closed = monotonic()
        try:
            while not self._closing:
                self._wake.wait(PERIOD)
                self._wake.clear()
                self._drain()
                self._room.set()
                if monotonic() - closed >= CHUNK_SECONDS:
                    self.writer.flush_chunk()
                    closed = monotonic()
        except Exception as error:  # raised again on the run's own thread
            self.error = self._as_recording_error(error)
            self._room.set()

    def _as_recording_error(self, error: Exception) -> RecordingError:
        if isinstance(error, RecordingError):
            return error
        what = "" if isinstance(error, MessageError) else f"{type(error).__name__}: "
        found = RecordingError(f"{self.path}: cannot be written: {what}{error}")
        found.__cause__ = error
        return found

    def _drain(self) -> None:
        """Write all that waits."""
        for stream in self.streams:
            while block := stream.take():
                stream.write(self.writer, block)
                self._room.set()
        self._log.write()


class _Stream:
    """The messages of one stream that wait to be written, samples and blocks as they came."""

    def __init__(self, channel: int, layout: Layout) -> None:
        self.channel = channel
        self.layout = layout
        self.queue: deque[Any] = deque()

    @property
    def holds_blocks(self) -> bool:
        """Whether a block waits; asked by the run while the thread takes from the queue."""
        try:
            return bool(self.queue[0].is_block)
        except IndexError:
            return False

    def take(self, most: int = 4096) -> Message | None:
        """Return the next messages as one block, or None."""
        samples: list[Message] = []
        while self.queue and len(samples) < most:
            if self.queue[0].is_block:
                return self.layout.kind.stack(samples) if samples else self.queue.popleft()
            samples.append(self.queue.popleft())
        return self.layout.kind.stack(samples) if samples else None

    def write(self, writer: McapWriter, block: Message) -> None:
        """Write a block, encoded where it goes."""
        writer.write_encoded(
            self.channel,
            block.t,
            self.layout.size,
            lambda rows, out: self.layout.encode_block(block[rows], out),
        )


class _LogStream(logging.Handler):
    """Log records of the run as messages, stamped with the event time that the run had reached."""

    def __init__(self, recorder: Recorder) -> None:
        super().__init__()
        self.recorder = recorder
        self.queue: deque[tuple[int, bytes]] = deque()
        self.channel: int | None = None

    def emit(self, record: logging.LogRecord) -> None:
        t = min(max(self.recorder.reached, 0), 2**31 * 1_000_000_000 - 1)
        try:
            self.queue.append((t, _encode_log(record, t)))
        except Exception:  # a wrong format must not end the step that logged it
            self.handleError(record)

    def write(self) -> None:
        """Write what was logged; the channel is made with the first record."""
        writer = self.recorder.writer
        while self.queue:
            if self.channel is None:
                self.channel = writer.channel(LOG_TOPIC, *LOG_SCHEMA)
            t, data = self.queue.popleft()
            writer.write(self.channel, np.array([t]), np.frombuffer(data, dtype=np.uint8)[None])


def _encode_log(record: logging.LogRecord, t: int) -> bytes:
    out = bytearray(struct.pack("<iIB", *divmod(t, 1_000_000_000), min(record.levelno, 50)))
    texts = (record.name, record.getMessage(), record.filename, record.funcName or "")
    for text in texts:
        data = text.encode(errors="replace") + b"\0"
        out += bytes(-len(out) % 4) + struct.pack("<I", len(data)) + data
    out += bytes(-len(out) % 4) + struct.pack("<I", record.lineno)
    return HEADER + bytes(out)
