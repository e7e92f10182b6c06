"""Inlet: a stream of another group that this group reads, as it comes out of its link."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from lodeflow.errors import LodeflowError
from lodeflow.graph import Wire
from lodeflow.messages.cdr import Layout
from lodeflow.runtime.exchange import Enter
from lodeflow.sync import END, NEVER
from lodeflow.transport.losses import Gap, LinkLosses

FEW = 8
"""Rows of a frame up to which decoding one by one is quicker than columns."""


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
        enter: is given what comes.
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
        self.enter: Enter = lambda message, bound: None
        self._tell = tell
        self._broken_off: int | None = None

    def bring(self, first: int, bound: int, rows: int, payload: bytes) -> None:
        """Decode what a frame holds, and bring it in."""
        floor = self.bound
        if rows == 1 and self._broken_off is None:  # live, almost always
            try:
                sample = self.layout.decode_sample(payload)
            except (ValueError, LodeflowError):
                pass  # it is counted below
            else:
                if floor <= sample.t < bound:
                    self.bound = bound
                    self.enter(sample, bound)
                    return
        messages: list[Any] = []
        if rows:
            try:
                messages = self._decode(rows, payload)
            except (ValueError, LodeflowError):
                self.losses.undecodable += 1
                self._gap(first, bound)
        if messages and _first(messages[0]) < floor:
            messages = self._fresh(messages, floor)
        if messages and self._broken_off is not None:
            self._gap(self._broken_off, _first(messages[0]))
            self._broken_off = None
        if bound > floor:
            self.bound = bound
        elif not messages:
            return
        for sample in messages[:-1]:
            self.enter(sample, sample.t + 1)
        self.enter(messages[-1] if messages else None, self.bound)

    def restarted(self) -> None:
        """Expect that something is missing up to what comes next: the sender began anew."""
        if NEVER < self.bound < END:
            self._broken_off = self.bound

    def end(self, *, lost: bool) -> None:
        """End the stream where it is.

        Args:
            lost: what the sender still owed is missing.
        """
        if self.bound == END:
            return
        if lost:
            self._gap(self.bound, END)
        self.bound = END
        self.enter(None, END)

    def _decode(self, rows: int, payload: bytes) -> list[Any]:
        """Return the samples of a small frame, or one block."""
        layout = self.layout
        if rows == 1:
            return [layout.decode_sample(payload)]
        if rows <= FEW and len(payload) == rows * layout.size:
            ends = range(layout.size, len(payload) + 1, layout.size)
            return [layout.decode_sample(payload[end - layout.size : end]) for end in ends]
        records = np.frombuffer(payload, dtype=np.uint8)
        return [layout.decode_block(records.reshape(rows, layout.size))]

    def _fresh(self, messages: list[Any], floor: int) -> list[Any]:
        """Return what was not here before the sender began anew."""
        if not messages[0].is_block:
            found = [sample for sample in messages if sample.t >= floor]
            self.losses.repeated += len(messages) - len(found)
            return found
        (block,) = messages
        fresh = block.t >= floor
        self.losses.repeated += int(len(fresh) - fresh.sum())
        return [block[fresh]] if fresh.any() else []

    def _gap(self, since: int, until: int) -> None:
        self.losses.gaps += 1
        self._tell(Gap(self.wire, self.reader, self.sender, since, until))


def _first(message: Any) -> int:
    return message.t if type(message.t) is int else int(message.t[0])
