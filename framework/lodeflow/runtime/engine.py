"""Engine: brings the data of all sources through a plan, with the driver that suits them."""

from __future__ import annotations

import threading
from collections.abc import Callable, Generator, Iterator
from typing import Any

import numpy as np

from lodeflow.clock import Clock, Pacer, SimClock, WallClock
from lodeflow.errors import ContractError, RunError
from lodeflow.runtime.blocks import BlockDriver
from lodeflow.runtime.feed import Batch, LiveFeed, feeds, gathered, max_delay
from lodeflow.runtime.plan import Plan, PlanNode
from lodeflow.runtime.samples import SampleDriver
from lodeflow.sync import END, NEVER

TICK = 0.02
"""Seconds between looks at the stop flag and the live sources' clocks when nothing comes."""

Watch = Callable[[int], None]
"""Called with the event time reached, between batches; it may raise to end the run."""


class Engine:
    """Runs a plan to the end of its sources, or until it is told to stop.

    Args:
        plan: a fresh plan.
        speed: event time per wall time; None for as fast as the data allows.
        duration: event time to run for, in nanoseconds; None for all. It counts from the first
            stamp of the data, or with a live source from the start of the run.
        watch: called between batches, at least every `TICK` seconds while paced or live.

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
    ) -> None:
        if speed is not None and not speed > 0:
            raise RunError(f"the speed must be above 0, not {speed}")
        if duration is not None and duration < 0:
            raise RunError(f"the duration must not be negative, got {duration} ns")
        self.plan = plan
        self.speed = speed
        self.watch = watch
        self.stopping = threading.Event()
        self.wake = threading.Event()
        self.live = [n for n in plan.sources if max_delay(n) is not None]
        self.clock: Clock = WallClock() if self.live else SimClock()
        self.first: int | None = None
        self.reached = self.clock.start
        self.duration = duration

    @property
    def span(self) -> int:
        """Event time from the first stamp that a source sent to the last, in nanoseconds."""
        return 0 if self.first is None else self.reached - self.first

    def _saw(self, first: int, last: int) -> None:
        self.first = first if self.first is None else min(self.first, first)
        self.reached = max(self.reached, last)

    def stop(self) -> None:
        """End all sources at the next look; what is on its way is finished. Safe in a signal."""
        self.stopping.set()
        self.wake.set()

    def run(self) -> None:
        """Start the nodes, run, and let every node finish.

        Raises:
            NodeFailure: a plugin raised.
            ContractError: a node broke a rule of event time.
        """
        self.plan.start()
        if self.live or self.speed is not None:
            self._run_samples()
        else:
            self._run_blocks()

    def _run_blocks(self) -> None:
        driver = BlockDriver(self.plan)
        read = feeds(self.plan.sources, self.clock, self.duration)
        sources = {name: gathered(feed) for name, feed in read.items()}
        reached = dict.fromkeys(sources, NEVER)
        try:
            while reached:
                # The source that is furthest behind: joins then hold as little as they can.
                name = min(reached, key=reached.__getitem__)
                batch = Batch([], END) if self.stopping.is_set() else next(sources[name])
                driver.push(name, batch.blocks, batch.bound)
                reached[name] = batch.bound
                if batch.bound == END:
                    del reached[name]
                for _, block in batch.blocks:
                    self._saw(int(block.t[0]), int(block.t[-1]))
                self.watch(self.reached)
        finally:
            for feed in sources.values():
                feed.close()
        _all_ended(driver.unfinished())

    def _run_samples(self) -> None:
        driver = SampleDriver(self.plan)
        at_rest = [node for node in self.plan.sources if node not in self.live]
        read = feeds(at_rest, self.clock, self.duration)
        files = [_Paced(node, read[node.name]) for node in at_rest]
        until = END if self.duration is None else self.clock.start + self.duration
        live = [LiveFeed(node, self.clock, self.wake, until) for node in self.live]
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
            feed.advance(driver)
        files = [feed for feed in files if feed.t < END]
        while (files or live) and not self.stopping.is_set():
            for inbox in live:
                for batch in inbox.drain():
                    self._push_rows(driver, inbox.node.name, batch)
            live = [inbox for inbox in live if inbox.intake.floor < END]
            due = min(files, key=lambda feed: feed.t, default=None)
            wait = TICK if due is None else pacer.remaining(due.t)
            if due is not None and wait <= 0:
                self._saw(due.t, due.t)
                due.push(driver)
                if due.t == END:
                    files.remove(due)
                wait = 0.0
            self.watch(self.reached)
            if wait > 0:
                driver.count()
                self.wake.wait(min(wait, TICK))
                self.wake.clear()
        for feed in files:
            driver.promise(feed.node.name, END)
        for inbox in live:
            for batch in inbox.drain():  # what had come before the stop is not lost
                self._push_rows(driver, inbox.node.name, batch)
            driver.promise(inbox.node.name, END)

    def _push_rows(self, driver: SampleDriver, source: str, batch: Batch) -> None:
        for t, messages in _by_stamp(batch):
            self._saw(t, t)
            for port, sample in messages:
                driver.push(source, port, sample)
        driver.promise(source, batch.bound)


class _Paced:
    """A source of data at rest, handed out stamp by stamp."""

    def __init__(self, node: PlanNode, batches: Generator[Batch]) -> None:
        self.node = node
        self.batches = batches
        self.rows: Iterator[tuple[int, list[tuple[int, Any]]]] = iter(())
        self.bound = NEVER
        self.t = NEVER
        self.next: list[tuple[int, Any]] = []

    def advance(self, driver: SampleDriver) -> None:
        """Look for the next stamp, and promise that nothing comes before it."""
        while True:
            found = next(self.rows, None)
            if found is not None:
                self.t, self.next = found
                break
            if self.bound == END:
                self.t, self.next = END, []
                break
            batch = next(self.batches)
            self.bound = batch.bound
            self.rows = _by_stamp(batch)
            if not batch.blocks:
                driver.promise(self.node.name, batch.bound)
        driver.promise(self.node.name, self.t)

    def push(self, driver: SampleDriver) -> None:
        """Bring in the messages of the next stamp."""
        for port, sample in self.next:
            driver.push(self.node.name, port, sample)
        self.advance(driver)

    def close(self) -> None:
        """Let the source release what it holds."""
        self.batches.close()


def _by_stamp(batch: Batch) -> Iterator[tuple[int, list[tuple[int, Any]]]]:
    """Yield (stamp, messages) of a batch in the order of stamps."""
    if not batch.blocks:
        return
    for t in np.unique(np.concatenate([block.t for _, block in batch.blocks])).tolist():
        found = []
        for port, block in batch.blocks:
            index = int(np.searchsorted(block.t, t))
            if index < len(block.t) and block.t[index] == t:
                found.append((port, block.row(index)))
        yield t, found


def _all_ended(unfinished: list[str]) -> None:
    if unfinished:
        raise ContractError(
            f"all sources have ended, but these nodes still wait: {', '.join(unfinished)}"
        )
