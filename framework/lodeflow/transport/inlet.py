"""Inlet: a stream of another group that this group reads, as it comes out of its link."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from lodeflow.errors import LodeflowError
from lodeflow.graph import Wire
from lodeflow.messages.cdr import Layout
from lodeflow.runtime.exchange import Arrival
from lodeflow.sync import END, NEVER
from lodeflow.transport.frame import Frame
from lodeflow.transport.losses import Gap, LinkLosses


class Inlet:
    """A stream that comes from another group.

    Args:
        wire: the stream.
        sender: the group that it comes from.
        reader: this group.
        layout: of its records.
        losses: of the link that it comes over.
        tell: told of what is missing for good.

    Attributes:
        bound: how far it has come.
    """

    def __init__(
        self,
        wire: Wire,
        sender: str,
        reader: str,
        layout: Layout,
        losses: LinkLosses,
        tell: Callable[[Gap], None],
    ) -> None:
        self.wire, self.sender, self.reader = wire, sender, reader
        self.layout, self.losses = layout, losses
        self.bound = NEVER
        self._tell = tell
        self._broken_off: int | None = None

    def open(self, frame: Frame) -> Arrival | None:
        """Return what a frame brings, decoded."""
        floor = self.bound
        message = None
        if frame.rows:
            try:
                message = self._decode(frame)
            except (ValueError, LodeflowError):
                self.losses.undecodable += 1
                self._gap(frame.first, frame.bound)
        if message is not None:
            if _first(message) < floor:
                message = self._fresh(message, floor)
            if self._broken_off is not None and message is not None:
                self._gap(self._broken_off, _first(message))
                self._broken_off = None
        if frame.bound > floor:
            self.bound = frame.bound
        elif message is None:
            return None
        return Arrival(self.wire, message, self.bound)

    def restarted(self) -> None:
        """Expect that something is missing up to what comes next: the sender began anew."""
        if NEVER < self.bound < END:
            self._broken_off = self.bound

    def end(self, *, lost: bool) -> Arrival | None:
        """End the stream where it is.

        Args:
            lost: what the sender still owed is missing.
        """
        if self.bound == END:
            return None
        if lost:
            self._gap(self.bound, END)
        self.bound = END
        return Arrival(self.wire, None, END)

    def _decode(self, frame: Frame) -> Any:
        if frame.rows == 1:
            return self.layout.decode_sample(frame.payload)
        records = np.frombuffer(frame.payload, dtype=np.uint8)
        return self.layout.decode_block(records.reshape(frame.rows, self.layout.size))

    def _fresh(self, message: Any, floor: int) -> Any:
        """Return what of a message was not here before the sender began anew."""
        block = message if message.is_block else message.as_block()
        fresh = block.t >= floor
        self.losses.repeated += int(len(fresh) - fresh.sum())
        return block[fresh] if fresh.any() else None

    def _gap(self, since: int, until: int) -> None:
        self.losses.gaps += 1
        self._tell(Gap(self.wire, self.reader, self.sender, since, until))


def _first(message: Any) -> int:
    return message.t if type(message.t) is int else int(message.t[0])
