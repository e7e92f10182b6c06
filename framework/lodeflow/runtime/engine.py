"""Engine: brings the data of all sources through a plan, with the driver that suits them."""

from __future__ import annotations

import itertools
import threading
from collections import deque
from collections.abc import Callable, Generator, Iterator
from functools import partial
from typing import Any

import numpy as np

from lodeflow.clock import Clock, Pacer, SimClock, WallClock, monotonic
from lodeflow.errors import ContractError, RunError
from lodeflow.runtime.blocks import BlockDriver
from lodeflow.runtime.exchange import Alone, Driver, Exchange
from lodeflow.runtime.feed import LiveFeed, feeds
from lodeflow.runtime.gathering import ROWS, gathered
from lodeflow.runtime.intake import Batch, max_delay
from lodeflow.runtime.plan import Plan, PlanNode
from lodeflow.runtime.samples import SampleDriver
from lodeflow.sync import END, NEVER

TICK = 0.02
"""Seconds between looks at the stop flag and the live sources' clocks when nothing comes."""
AHEAD = 16
"""Stamps of data at rest that are read ahead, so that reading rarely delays a message."""
BURST, BURST_STAMPS = 0.001, 128
"""Seconds, and stamps, of overdue samples after which what came of them is passed on."""

Watch = Callable[[int], None]
"""Called with the event time reached, between batches; it may raise to end the run."""


class Engine:
    """Runs a plan to the end of its sources, or until it is told to stop.

    Attributes:
        driver: what runs the nodes; None before the first is run.
        inboxes: of the live sources.

    Args:
        plan: a fresh plan.
        speed: event time per wall time; None for as fast as the data allows.
        duration: event time to run for, in nanoseconds; None for all. It counts from the first
            stamp of the data, or with a live source from the start of the run.
        watch: called between batches, at least every `TICK` seconds while paced or live.
        exchange: the groups of the run that run elsewhere; None if there are none.
        samples: whether single samples are run; None for what the sources here need. All groups
            of a run do the same.

    Raises:
        RunError: the speed is not above 0, or the duration is negative.
    """

    def __init__(
        self,
        plan: Plan,
        *,
        speed: float | None = None,
        duration: int | None = None,
        watch: Watch = lambda t: None,
        exchange: Exchange | None = None,
        samples: bool | None = None,
    ) -> None:
        if speed is not None and not speed > 0:
            raise RunError(f"the speed must be above 0, not {speed}")
        if duration is not None and duration < 0:
            raise RunError(f"the duration must not be negative, got {duration} ns")
        self.plan = plan
        self.speed = speed
        self.watch = watch
        self.stopping = threading.Event()
        self.exchange: Exchange = Alone() if exchange is None else exchange
        self.driver: Driver | None = None
        self.inboxes: list[LiveFeed] = []
        self.live = [n for n in plan.sources if max_delay(n) is not None]
        self.clock: Clock = WallClock() if self.live else SimClock()
        self.first: int | None = None
        self.last = NEVER
        self.reached = self.clock.start
        self.duration = duration
        self.by_samples = bool(self.live) or speed is not None if samples is None else samples

    @property
    def begun(self) -> bool:
        """Whether all nodes have started, and data may come."""
        return self.driver is not None

    @property
    def span(self) -> int:
        """Event time from the first stamp that a source sent to the last, in nanoseconds."""
        return 0 if self.first is None else self.last - self.first

    def _saw(self, first: int, last: int) -> None:
        if self.first is None or first < self.first:
            self.first = first
        if last > self.last:
            self.last = last
        if last > self.reached:
            self.reached = last

    def stop(self) -> None:
        """End all sources at the next look; what is on its way is finished. Safe in a signal."""
        self.stopping.set()
        self.exchange.wake()

    def count(self) -> None:
        """Bring the counters of sent messages up to date."""
        if isinstance(self.driver, SampleDriver):
            self.driver.count()

    def run(self) -> None:
        """Start the nodes, run, and let every node finish.

        Raises:
            NodeFailure: a plugin raised.
            ContractError: a node broke a rule of event time.
        """
        self.plan.start()
        self.begin()

    def begin(self) -> None:
        """Run nodes that have started; see `run`."""
        if self.by_samples:
            self._run_samples()
        else:
            self._run_blocks()

    def _run_blocks(self) -> None:
        self.driver = driver = BlockDriver(self.plan)
        self.exchange.attach(driver, self._saw)
        read = feeds(self.plan.sources, self.clock, self.duration, ROWS)
        sources = {name: gathered(feed) for name, feed in read.items()}
        reached = dict.fromkeys(sources, NEVER)
        try:
            while reached or self.exchange.is_open():
                moved = self.exchange.take()
                # The source that is furthest behind: joins then hold as little as they can.
                name = min(reached, key=reached.__getitem__, default=None)
                if name is not None and self._may_go_on(reached[name]):
                    batch = Batch([], END) if self.stopping.is_set() else next(sources[name])
                    for _, block in batch.messages:
                        self._saw(int(block.t[0]), int(block.t[-1]))
                    driver.push(name, batch.messages, batch.bound)
                    reached[name] = batch.bound
                    if batch.bound == END:
                        del reached[name]
                    moved = True
                self.exchange.flush()
                self.watch(self.reached)
                if not moved:
                    self.exchange.wait(TICK)
        finally:
            for feed in sources.values():
                feed.close()
        _all_ended(driver.unfinished())

    def _may_go_on(self, reached: int) -> bool:
        """Whether a source of data at rest may go on: readers keep up, and no inlet is behind."""
        if self.stopping.is_set():
            return True
        return self.exchange.has_room() and reached <= self.exchange.behind()

    def _run_samples(self) -> None:
        self.driver = driver = SampleDriver(self.plan, self.exchange.outlets)
        self.exchange.attach(driver, self._saw)
        at_rest = [node for node in self.plan.sources if node not in self.live]
        read = feeds(at_rest, self.clock, self.duration)
        files = [_Paced(driver, node, read[node.name]) for node in at_rest]
        until = END if self.duration is None else self.clock.start + self.duration
        wake = partial(self.exchange.wake, look=False)
        live = [LiveFeed(node, self.clock, wake, until) for node in self.live]
        self.inboxes = live
        pacer = Pacer(1.0 if self.speed is None else self.speed)
        for feed in live:
            feed.start()
        try:
            self._loop(driver, files, live, pacer)
        finally:
            for paced in files:
                paced.close()
            for feed in live:
                feed.stop()
            driver.count()
        _all_ended(driver.unfinished())

    def _loop(
        self, driver: SampleDriver, files: list[_Paced], live: list[LiveFeed], pacer: Pacer
    ) -> None:
        for feed in files:
            feed.begin()
        files = [feed for feed in files if feed.t < END]
        while True:
            self.exchange.take()
            self.watch(self.reached)
            if self.stopping.is_set():
                self._end_sources(driver, files, live)
                files, live = [], []
                if not self.exchange.is_open():
                    self.exchange.flush()
                    return
            wait = TICK
            if has_room := self.exchange.has_room():
                for inbox in live:
                    for batch in inbox.drain():
                        self._push_rows(driver, inbox.node.name, batch)
                live = [inbox for inbox in live if inbox.intake.floor < END]
                self._push_due(files, pacer)
            self.exchange.flush()
            # Little is done from here to the wait: it would compete for a processor with the
            # threads that carry what was sent.
            if not (files or live or self.exchange.is_open()):
                return
            if files and has_room:
                wait = pacer.remaining(_next(files).t)
            if wait > 0:
                self.exchange.wait(min(wait, TICK))

    def _push_due(self, files: list[_Paced], pacer: Pacer) -> None:
        """Bring in what is due by now, for no longer than `BURST`."""
        if not files or pacer.remaining((due := _next(files)).t) > 0:
            return
        limit, until = pacer.reached(), monotonic() + BURST
        for _ in range(BURST_STAMPS):
            self._saw(due.t, due.t)
            due.push()
            if due.t == END:
                files.remove(due)
                if not files:
                    return
            if (due := _next(files)).t > limit:
                return
            self.watch(self.reached)  # as between any two stamps
            if self.stopping.is_set() or monotonic() > until:
                return

    def _end_sources(self, driver: SampleDriver, files: list[_Paced], live: list[LiveFeed]) -> None:
        for feed in files:
            driver.promise(feed.node.name, END)
        for inbox in live:
            for batch in inbox.drain():  # what had come before the stop is not lost
                self._push_rows(driver, inbox.node.name, batch)
            inbox.stop()
            driver.promise(inbox.node.name, END)

    def _push_rows(self, driver: SampleDriver, source: str, batch: Batch) -> None:
        for t, messages in _by_stamp(batch):
            self._saw(t, t)
            for port, sample in messages:
                driver.push(source, port, sample)
        driver.promise(source, batch.bound)


class _Paced:
    """A source of data at rest, handed out stamp by stamp.

    Attributes:
        t: the stamp that is next.
    """

    def __init__(self, driver: SampleDriver, node: PlanNode, batches: Generator[Batch]) -> None:
        self.node = node
        self.outputs = driver.nodes[node.name].outputs
        self.batches = batches
        self.rows: Iterator[tuple[int, list[tuple[int, Any]]]] = iter(())
        self.ahead: deque[tuple[int, list[tuple[int, Any]]]] = deque()
        self.bound = NEVER
        self.t = NEVER
        self.next: list[tuple[int, Any]] = []

    def begin(self) -> None:
        """Look for the first stamp, and promise that nothing comes before it."""
        self.t, self.next = self._read()
        for output in self.outputs:
            output.promise(self.t)

    def push(self) -> None:
        """Bring in the messages of the next stamp, and promise that nothing follows soon."""
        for port, sample in self.next:
            self.outputs[port].send(sample, sample.t)
        self.t, self.next = self.ahead.popleft() if self.ahead else self._read()
        for output in self.outputs:
            output.promise(self.t)

    def _read(self) -> tuple[int, list[tuple[int, Any]]]:
        """Return the stamp after those read so far, and its messages; END if there is none."""
        while not self.ahead:
            if found := list(itertools.islice(self.rows, AHEAD)):
                self.ahead.extend(found)
            elif self.bound == END:
                return END, []
            else:
                batch = next(self.batches)
                self.bound = batch.bound
                self.rows = _by_stamp(batch)
        return self.ahead.popleft()

    def close(self) -> None:
        """Let the source release what it holds."""
        self.batches.close()


def _next(files: list[_Paced]) -> _Paced:
    """Return the source whose stamp is next."""
    return files[0] if len(files) == 1 else min(files, key=lambda feed: feed.t)


def _by_stamp(batch: Batch) -> Iterator[tuple[int, list[tuple[int, Any]]]]:
    """Yield (stamp, messages) of a batch in the order of stamps."""
    if not batch.messages:
        return
    t = batch.messages[0][1].t
    if type(t) is int and all(type(m.t) is int and m.t == t for _, m in batch.messages):
        yield t, batch.messages  # samples, of a live source
        return
    blocks = [(port, m if m.is_block else m.as_block()) for port, m in batch.messages]
    if len(blocks) == 1:
        ((port, block),) = blocks
        for index, t in enumerate(block.t.tolist()):
            yield t, [(port, block.row(index))]
        return
    for t in np.unique(np.concatenate([block.t for _, block in blocks])).tolist():
        found = []
        for port, block in blocks:
            index = int(np.searchsorted(block.t, t))
            if index < len(block.t) and block.t[index] == t:
                found.append((port, block.row(index)))
        yield t, found


def _all_ended(unfinished: list[str]) -> None:
    if unfinished:
        raise ContractError(
            f"all sources have ended, but these nodes still wait: {', '.join(unfinished)}"
        )
