"""Outlet: a stream of this group that other groups read, on its way into their links."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from typing import Any

import numpy as np

from lodeflow.graph import Wire
from lodeflow.messages.cdr import Layout
from lodeflow.runtime.exchange import Port, Silent
from lodeflow.sync import END, NEVER
from lodeflow.transport.frame import Payload
from lodeflow.transport.link import Link
from lodeflow.transport.losses import LinkLosses

FRAME_BYTES = 1 << 20
"""Size of the frames, about, into which a larger block is cut; each costs a put, a wake and an
acknowledgement, whatever its size."""


class Outlet:
    """A stream that other groups read.

    Args:
        flags: of its frames.
        wire: the stream.
        layout: of its records.
        readers: the links to its readers, with what each of them loses.

    Attributes:
        queue: messages that are still to be sent, samples and blocks.
        port: of the driver, which has the bound.
        bound: what the readers were told.
    """

    def __init__(
        self, flags: int, wire: Wire, layout: Layout, readers: Mapping[Link, LinkLosses]
    ) -> None:
        self.flags, self.wire, self.layout, self.readers = flags, wire, layout, readers
        self.queue: deque[Any] = deque()
        self.port: Port = Silent()
        self.bound = NEVER

    def send(self, bound: int) -> None:
        """Send all that waits, each block in frames of moderate size, and the bound of the port."""
        queue, layout = self.queue, self.layout
        while queue:
            message = queue.popleft()
            if type(t := message.t) is int:
                if not queue or queue[0].is_block:  # live, this is all there is
                    self.bound = bound if not queue and bound > t else t + 1
                    self._hand(t, 1, layout.encode_sample(message))
                    continue
                samples = [message]
                while queue and not queue[0].is_block:
                    samples.append(queue.popleft())
                message = layout.kind.stack(samples)
            pieces = max(1, round(len(message) * layout.size / FRAME_BYTES))
            rows = max(1, -(-len(message) // pieces))  # alike, for a small last one costs as much
            for at in range(0, len(message), rows):
                piece = message[at : at + rows] if len(message) > rows else message
                last = not queue and at + rows >= len(message)
                t = piece.t
                self.bound = bound if last and bound > t[-1] else int(t[-1]) + 1
                records = bytearray(len(t) * layout.size)
                layout.encode_block(piece, np.frombuffer(records, np.uint8).reshape(len(t), -1))
                self._hand(int(t[0]), len(t), records)
        if bound > self.bound:
            self.bound = bound
            self._hand(0, 0, b"")

    def _hand(self, first: int, count: int, payload: Payload) -> None:
        """Send a frame to each reader, unless one only watches and is behind; the end comes."""
        for link, losses in self.readers.items():
            if link.closed:
                continue
            if not (link.latest and link.is_full):
                link.send(self.flags, first, self.bound, count, payload)
                continue
            losses.missed += count
            if self.bound == END:
                link.send(self.flags, 0, END, 0, b"")
