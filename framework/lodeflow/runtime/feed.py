"""Feeds: sources being read, those of data at rest on the run's thread, devices on their own."""

from __future__ import annotations

import itertools
import threading
from collections import deque
from collections.abc import Callable, Generator, Iterable, Iterator
from typing import Any

import numpy as np

from lodeflow.clock import Clock
from lodeflow.errors import ContractError
from lodeflow.messages.message import Message
from lodeflow.runtime.gathering import Pile
from lodeflow.runtime.intake import Batch, Intake, Lost
from lodeflow.runtime.plan import RAISED, PlanNode
from lodeflow.sync import END, NEVER, Bound

INBOX_SIZE = 10_000
"""Items that a live source may be ahead of the run before its samples overflow."""


def _cut(batch: Batch, until: int) -> Batch:
    """Return what of a batch lies before `until`; the end, if nothing more can."""
    if until == END:
        return batch
    blocks = [(index, m if m.is_block else m.as_block()) for index, m in batch.messages]
    blocks = [(index, block[: np.searchsorted(block.t, until)]) for index, block in blocks]
    bound = END if batch.bound >= until else batch.bound
    return Batch([(index, block) for index, block in blocks if len(block)], bound)


def batches(node: PlanNode, clock: Clock, rows: int = 1) -> Generator[Batch]:
    """Yield all that a source of data at rest has, and the end.

    Args:
        node: the source.
        clock: what it is handed.
        rows: small blocks may be looked at together, up to so many rows.

    Raises:
        NodeFailure: the source raised; names the last stamp that it reached.
    """
    intake = Intake(node)
    pile = Pile(intake, rows)
    items: Any = None
    bound = NEVER
    try:
        while bound < END:
            try:
                if items is None:
                    items = iter(intake.source.read(clock))
                item = next(items, _NO_MORE)
            except RAISED as error:
                yield from pile.take()
                raise node.failure("read", max(intake.last), error) from error
            if pile.add(item):
                if pile.is_full:
                    yield from pile.take()
                continue
            yield from pile.take()
            batch = Batch([], END) if item is _NO_MORE else intake.take(item)
            bound = batch.bound
            yield batch
    finally:
        _close(items)


def feeds(
    nodes: Iterable[PlanNode], clock: Clock, duration: int | None = None, rows: int = 1
) -> dict[str, Generator[Batch]]:
    """Return the batches of each source of data at rest, by its name.

    Args:
        nodes: the sources.
        clock: what they are handed.
        duration: event time to read, in ns from the first stamp of them all; None for all.
        rows: see `batches`.

    Raises:
        NodeFailure: a source raised before its first message.
    """
    found = {node.name: batches(node, clock, rows) for node in nodes}
    if duration is None:
        return found
    heads = {name: _head(feed) for name, feed in found.items()}
    stamps = [
        block.t[0] for head in heads.values() for batch in head for _, block in batch.messages
    ]
    until = int(min(stamps, default=0)) + duration
    return {name: _limited(heads[name], feed, until) for name, feed in found.items()}


def _head(feed: Iterator[Batch]) -> list[Batch]:
    """Return the batches up to the first with a message in it."""
    head = []
    for batch in feed:
        head.append(batch)
        if batch.messages:
            break
    return head


def _limited(head: list[Batch], feed: Generator[Batch], until: int) -> Generator[Batch]:
    """Yield what lies before `until`, and the end."""
    try:
        for batch in itertools.chain(head, feed):
            limited = _cut(batch, until)
            yield limited
            if limited.bound == END:
                break
    finally:
        feed.close()


class LiveFeed:
    """Reads a device source in a thread of its own, into a bounded inbox.

    The run drains the inbox; what does not fit is dropped and counted as overflow, before it
    enters any stream. A sample later than `max_delay` behind the clock is dropped as late.
    """

    def __init__(
        self, node: PlanNode, clock: Clock, wake: Callable[[], None], until: int = END
    ) -> None:
        self.node = node
        self.until = until
        self.clock = clock
        self.wake = wake
        self.inbox: deque[Any] = deque()
        self.overflow = 0
        self.counted = 0
        self.error: BaseException | None = None
        self.ended = False
        self.intake = Intake(node)
        self.stopping = False
        self.thread = threading.Thread(target=self._read, name=f"source {node.name}", daemon=True)

    def start(self) -> None:
        """Start reading."""
        self.thread.start()

    def _read(self) -> None:
        try:
            items = iter(self.intake.source.read(self.clock))
            for item in items:
                if self.stopping:
                    break
                if len(self.inbox) >= INBOX_SIZE and not isinstance(item, (Bound, Lost)):
                    self.overflow += _messages_in(item)
                else:
                    self.inbox.append(item)
                self.wake()
            _close(items)
        except RAISED as error:  # raised again by `drain`, on the run's own thread
            self.error = error
        finally:
            self.ended = True
            self.wake()

    def drain(self) -> Iterator[Batch]:
        """Yield what has come, then the bound that time alone gives."""
        ended = self.ended  # before the inbox is looked at: nothing follows once it is set
        source = self.intake.source
        bound = NEVER if source.own_bounds else self.clock.now() - source.max_delay
        for _ in range(len(self.inbox)):  # not what comes meanwhile, or a fast source holds us here
            yield _cut(self.intake.take(self.inbox.popleft()), self.until)
        if self.overflow > self.counted:
            self.node.counters.lose("overflow", self.overflow - self.counted)
            self.counted = self.overflow
        if ended and self.error is not None:
            raise self.node.failure("read", max(self.intake.last), self.error) from self.error
        self.intake.floor = END if ended else max(self.intake.floor, bound)
        if self.intake.floor >= self.until:
            self.intake.floor = END
            self.stop()
        yield Batch([], self.intake.floor)

    def stop(self) -> None:
        """Ask the thread to end at its next item."""
        self.stopping = True


_NO_MORE = object()


def _close(items: Any) -> None:
    """Let a generator release what it holds; another iterator has nothing to release."""
    close = getattr(items, "close", None)
    if close is not None:
        close()


def _messages_in(item: Any) -> int:
    messages = [m for m in (item if isinstance(item, tuple) else (item,)) if m is not None]
    if not all(isinstance(m, Message) for m in messages):
        raise ContractError(f"a source yielded {item!r}")
    return sum(len(m) if m.is_block else 1 for m in messages)
