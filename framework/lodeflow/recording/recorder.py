"""Recorder: takes the streams of a run off its hands, and writes them as columns.

The run only appends to a queue per stream; a thread encodes, compresses and writes. A chunk is
closed at least once a second, so that a kill loses less than that.
"""

from __future__ import annotations

import logging
import threading
from collections import deque
from collections.abc import Callable, Collection, Iterable, Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

from lodeflow.clock import monotonic
from lodeflow.errors import MessageError, RecordingError
from lodeflow.graph.groups import RECORDER
from lodeflow.graph.model import Wire
from lodeflow.messages.cdr import Layout, StreamConstants, layout_of
from lodeflow.messages.message import Message
from lodeflow.messages.ros import schema_text
from lodeflow.recording.events import GAP, LOG, EventKind, in_range, log_fields
from lodeflow.recording.mcap.writer import McapWriter
from lodeflow.runtime.plan import Plan
from lodeflow.sync import END, NEVER

PERIOD = 0.1
"""Seconds between two looks of the thread into its queues."""
CHUNK_SECONDS = 0.5
"""Wall time after which the open chunk is closed: far enough below the promised second for a look's
length, and for a machine that is busy."""
BACKLOG = 8
"""Blocks that may wait to be written before the run is held back."""
STACK = 4096
"""Samples that are written as one block."""
LAG = 0.7
"""Seconds that a run of blocks may be ahead of what a kill leaves before it is held back."""

Taker = Callable[[Message], None]
"""Takes the messages of a stream, samples or blocks."""


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
        self.settled = monotonic()  # what came before then is in closed chunks
        self._log = _LogHandler(self)
        self._events: deque[tuple[EventKind, int, bytes]] = deque()
        self._event_channels: dict[EventKind, int] = {}
        self._broken_off: Collection[Wire] = ()
        self._closing = False
        self._wake = threading.Event()
        self._room = threading.Event()
        self._thread = threading.Thread(target=self._work, name="recorder", daemon=True)

    def attach(
        self,
        plan: Plan,
        wires: Iterable[Wire],
        constants: Mapping[Wire, StreamConstants] = MappingProxyType({}),
        filtered: Callable[[Wire, Taker], Taker] = lambda wire, take: take,
    ) -> None:
        """Record these streams of a plan, and what its nodes log; then start writing.

        Args:
            plan: whose streams are recorded.
            wires: the streams.
            constants: frame_id and undeclared members of streams that have others than the
                defaults of their types.
            filtered: may put something between a stream and what takes its messages.
        """
        kinds = {
            Wire(name, port.name): port.type
            for name, node in plan.nodes.items()
            for port in node.spec.outputs
        }
        for wire, take in self.open({wire: kinds[wire] for wire in wires}, constants).items():
            plan.tap(wire, filtered(wire, take))

    def open(
        self,
        kinds: Mapping[Wire, type[Message]],
        constants: Mapping[Wire, StreamConstants] = MappingProxyType({}),
    ) -> dict[Wire, Taker]:
        """Start writing; return what takes the messages of each stream, samples or blocks."""
        takers: dict[Wire, Taker] = {}
        for wire, kind in kinds.items():
            channel = self.writer.channel(topic(wire), kind.ros, schema_text(kind))
            stream = _Stream(wire, channel, layout_of(kind, constants.get(wire)))
            self.streams.append(stream)
            takers[wire] = stream.queue.append
        logging.getLogger("lodeflow").addHandler(self._log)
        self._thread.start()
        return takers

    def event(self, kind: EventKind, t: int, *texts: str | int) -> None:
        """Record an event: something that is no message of a node, such as a change."""
        self._events.append((kind, t, kind.encode(t, *texts)))

    def keep_up(self, reached: int) -> None:
        """Called by the run between batches: waits while much is unwritten, and reports errors.

        Raises:
            RecordingError: writing has failed.
        """
        self.reached = max(self.reached, reached)
        while self.error is None and self._is_behind():
            self._room.clear()
            self._wake.set()
            self._room.wait(PERIOD)
        if self.error is not None:
            raise self.error

    def _is_behind(self) -> bool:
        """Whether too much waits; single samples come at a pace, and are written by the clock."""
        if not any(stream.holds_blocks for stream in self.streams):
            return False
        return monotonic() - self.settled > LAG or any(
            len(stream.queue) > BACKLOG for stream in self.streams
        )

    def break_off(self, wires: Collection[Wire]) -> None:
        """Record that streams end before their time where they are, so that a replay does too."""
        self._broken_off = wires

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
                for stream in self.streams:
                    if (wire := stream.wire) in self._broken_off:
                        begin = NEVER if stream.last == NEVER else stream.last + 1
                        missing = (str(wire), wire.node, RECORDER, begin, END)
                        self.event(GAP, in_range(begin), *missing)
                self._write_events()
                self.writer.flush_chunk()
                self.writer.metadata("lodeflow.summary", summary)
        except Exception as error:
            self.error = self._as_recording_error(error)
        finally:
            self.writer.close()
        if self.error is not None:
            raise self.error

    def _work(self) -> None:
        try:
            while not self._closing:
                self._wake.wait(PERIOD)
                self._wake.clear()
                begun = monotonic()
                self._drain()
                if begun - self.settled >= CHUNK_SECONDS:
                    self.writer.flush_chunk()
                    self.settled = begun
                self._room.set()
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
        """Write all that waits now, the streams in turn, so that none is ahead of the others."""
        left = {stream: len(stream.queue) for stream in self.streams}
        while left:
            for stream, count in list(left.items()):
                if not count:
                    del left[stream]
                    continue
                block, taken = stream.take(count)
                left[stream] -= taken
                stream.write(self.writer, block)
                self._room.set()
        self._write_events()

    def _write_events(self) -> None:
        """Write the events that wait; a channel is made with its first."""
        while self._events:
            kind, t, data = self._events.popleft()
            if kind not in self._event_channels:
                self._event_channels[kind] = self.writer.channel(kind.topic, kind.ros, kind.schema)
            record = np.frombuffer(data, dtype=np.uint8)[None]
            self.writer.write(self._event_channels[kind], np.array([t]), record)


class _Stream:
    """The messages of one stream that wait to be written, samples and blocks as they came."""

    def __init__(self, wire: Wire, channel: int, layout: Layout) -> None:
        self.wire, self.last = wire, NEVER
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

    def take(self, most: int) -> tuple[Message, int]:
        """Return the next of `most` messages that wait as one block, and how many they were."""
        if self.queue[0].is_block:
            return self.queue.popleft(), 1
        samples: list[Message] = []
        while len(samples) < min(most, STACK) and not self.queue[0].is_block:
            samples.append(self.queue.popleft())
        return self.layout.kind.stack(samples), len(samples)

    def write(self, writer: McapWriter, block: Message) -> None:
        """Write a block, encoded where it goes."""
        self.last = int(block.t[-1])
        writer.write_encoded(
            self.channel,
            block.t,
            self.layout.size,
            lambda rows, out: self.layout.encode_block(block[rows], out),
        )


class _LogHandler(logging.Handler):
    """Log records of the run as messages, stamped with the event time that the run had reached."""

    def __init__(self, recorder: Recorder) -> None:
        super().__init__()
        self.recorder = recorder

    def emit(self, record: logging.LogRecord) -> None:
        try:
            self.recorder.event(LOG, in_range(self.recorder.reached), *log_fields(record))
        except Exception:  # a wrong format must not end the step that logged it
            self.handleError(record)
