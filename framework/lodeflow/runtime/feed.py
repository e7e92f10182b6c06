"""Feeds: what sources yield, checked. Here and only here is a sample dropped, and counted."""

from __future__ import annotations

import itertools
import threading
from collections import deque
from collections.abc import Callable, Generator, Iterable, Iterator
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from lodeflow.clock import Clock, monotonic
from lodeflow.errors import ContractError
from lodeflow.graph.model import Loss
from lodeflow.messages.cdr import FIRST_STAMP, LAST_STAMP
from lodeflow.messages.message import Message
from lodeflow.node import Source
from lodeflow.runtime.plan import RAISED, PlanNode, check_output
from lodeflow.sync import END, NEVER, Bound

INBOX_SIZE = 10_000
"""Items that a live source may be ahead of the run before its samples overflow."""
ROWS = 4096
"""Rows that blocks of data at rest are gathered to: what a block costs is then next to nothing."""
PATIENCE = 0.05
"""Seconds after which a slow source's rows go on although they are fewer."""


def max_delay(node: PlanNode) -> int | None:
    """Return how late a live source's samples may come; None for data at rest."""
    delay: int | None = getattr(node.plugin, "max_delay", None)
    return delay


class Fed(Source):
    """Base of sources whose messages were in a graph before: they enter as they are.

    A node may send NaN, which no source may; replay can feed the streams of either.
    """


class Lost(NamedTuple):
    """What a source of the framework yields to say that messages did not come."""

    why: Loss
    messages: int


class Batch(NamedTuple):
    """What may enter the graph: blocks as (port index, block), then a bound on all ports."""

    blocks: list[tuple[int, Any]]
    bound: int


class Intake:
    """Checks what one source yields: types, finite values, order of stamps."""

    def __init__(self, node: PlanNode) -> None:
        self.node = node
        self.source: Any = node.plugin
        self.ports = node.spec.outputs
        self.live = max_delay(node) is not None
        self.fed = isinstance(node.plugin, Fed)
        self.floor = NEVER
        self.last = [NEVER] * len(self.ports)

    def take(self, item: Any) -> Batch:
        """Return the part of a yielded item that may enter, and count the rest."""
        if isinstance(item, Lost):
            self.node.counters.lose(item.why, item.messages)
            return Batch([], self.floor)
        if isinstance(item, Bound):
            if not isinstance(item.t, (int, np.integer)):
                raise self.node.broken(self._names(), f"it must yield Bound(int), got {item!r}")
            self.floor = min(max(self.floor, int(item.t)), END)
            return Batch([], self.floor)
        messages = item if self.node.spec.step_tuple else (item,)
        if not isinstance(messages, tuple) or len(messages) != len(self.ports):
            raise self.node.broken(
                self._names(), f"it must yield these ports or a Bound, got {item!r}"
            )
        blocks = []
        reached = self.floor
        for index, message in enumerate(messages):
            if message is None:
                continue
            check_output(self.node, self.ports[index], message)
            self._check_stamps(index, message.t)
            block = self._clean(index, message if message.is_block else message.as_block())
            if len(block):
                blocks.append((index, block))
                self.last[index] = int(block.t[-1])
                reached = max(reached, self.last[index] + 1)
        if not self.live:
            self.floor = reached
        return Batch(blocks, self.floor)

    def _names(self) -> str:
        return ", ".join(port.name for port in self.ports)

    def _check_stamps(self, index: int, t: Any) -> None:
        first, last = (t, t) if isinstance(t, int) else (t.min(initial=0), t.max(initial=0))
        if first < FIRST_STAMP or last > LAST_STAMP:
            raise self.node.broken(
                self.ports[index].name,
                f"stamp {first if first < FIRST_STAMP else last} is outside the range of ROS time "
                "(1901 to 2038, nanoseconds since 1970)",
            )

    def _clean(self, index: int, block: Any) -> Any:
        finite = None if self.fed else finite_rows(block)
        if finite is not None:
            self.node.counters.lose("nonfinite", int(len(block) - finite.sum()))
            block = block[finite]
        if self.live and (late := block.t < self.floor).any():
            self.node.counters.lose("late", int(late.sum()))
            block = block[~late]
        t = block.t
        if not len(t):
            return block
        before = max(self.last[index], NEVER if self.live else self.floor - 1)
        if t[0] > before and (t[1:] > t[:-1]).all():
            return block
        highest = np.maximum.accumulate(np.concatenate([[before], t[:-1]]))
        onward = t > highest
        self.node.counters.lose("disorder", int(len(t) - onward.sum()))
        return block[onward]


def finite_rows(block: Message) -> NDArray[np.bool_] | None:
    """Return which rows of a block are finite where they must be; None if all are."""
    rows: NDArray[np.bool_] | None = None
    for field, column in zip(block.fields, block.values(), strict=True):
        if field.integer or field.gaps:
            continue
        finite = np.isfinite(column)
        if not finite.all():
            finite = finite.reshape(len(finite), -1).all(axis=1)
            rows = finite if rows is None else rows & finite
    return rows


def _cut(batch: Batch, until: int) -> Batch:
    """Return what of a batch lies before `until`; the end, if nothing more can."""
    blocks = [(index, block[: np.searchsorted(block.t, until)]) for index, block in batch.blocks]
    bound = END if batch.bound >= until else batch.bound
    return Batch([(index, block) for index, block in blocks if len(block)], bound)


def batches(node: PlanNode, clock: Clock) -> Generator[Batch]:
    """Yield all that a source of data at rest has, and the end.

    Raises:
        NodeFailure: the source raised; names the last stamp that it reached.
    """
    intake = Intake(node)
    items: Any = None
    bound = NEVER
    try:
        while bound < END:
            try:
                if items is None:
                    items = iter(intake.source.read(clock))
                item = next(items, _NO_MORE)
            except RAISED as error:
                raise node.failure("read", max(intake.last), error) from error
            batch = Batch([], END) if item is _NO_MORE else intake.take(item)
            bound = batch.bound
            yield batch
    finally:
        _close(items)


def feeds(
    nodes: Iterable[PlanNode], clock: Clock, duration: int | None = None
) -> dict[str, Generator[Batch]]:
    """Return the batches of each source of data at rest, by its name.

    Args:
        nodes: the sources.
        clock: what they are handed.
        duration: event time to read, in ns from the first stamp of them all; None for all.

    Raises:
        NodeFailure: a source raised before its first message.
    """
    found = {node.name: batches(node, clock) for node in nodes}
    if duration is None:
        return found
    heads = {name: _head(feed) for name, feed in found.items()}
    stamps = [block.t[0] for head in heads.values() for batch in head for _, block in batch.blocks]
    until = int(min(stamps, default=0)) + duration
    return {name: _limited(heads[name], feed, until) for name, feed in found.items()}


def gathered(feed: Generator[Batch], rows: int = ROWS) -> Generator[Batch]:
    """Yield the batches of a feed joined until a port has so many rows, or `PATIENCE` is over."""
    held: list[Batch] = []
    counts: dict[int, int] = {}
    since = monotonic()
    try:
        for batch in feed:
            held.append(batch)
            for port, block in batch.blocks:
                counts[port] = counts.get(port, 0) + len(block)
            if max(counts.values(), default=0) >= rows or monotonic() - since >= PATIENCE:
                yield _joined(held)
                held, counts, since = [], {}, monotonic()
    except RAISED:  # what came before the failure is not lost
        if held:
            yield _joined(held)
        raise
    finally:
        feed.close()
    if held:
        yield _joined(held)


def _joined(batches: list[Batch]) -> Batch:
    """Return consecutive batches of one source as one."""
    if len(batches) == 1:
        return batches[0]
    blocks: dict[int, list[Any]] = {}
    for batch in batches:
        for port, block in batch.blocks:
            blocks.setdefault(port, []).append(block)
    joined = [(port, type(parts[0]).concat(parts)) for port, parts in sorted(blocks.items())]
    return Batch(joined, batches[-1].bound)


def _head(feed: Iterator[Batch]) -> list[Batch]:
    """Return the batches up to the first with a message in it."""
    head = []
    for batch in feed:
        head.append(batch)
        if batch.blocks:
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
