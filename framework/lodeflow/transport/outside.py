"""Messages from outside: what any Zenoh program puts on a key, merged by stamp."""

from __future__ import annotations

import heapq
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
import zenoh
from zenoh.handlers import FifoChannel

from lodeflow.clock import Clock, monotonic, sleep
from lodeflow.errors import LodeflowError
from lodeflow.graph.keyed import FromKey
from lodeflow.messages.cdr import layout_of
from lodeflow.runtime.intake import Lost
from lodeflow.sync import END, NEVER, Bound
from lodeflow.transport import frame as frames

QUEUE = 1 << 14
"""Samples that may wait in Zenoh's queue before its session stalls; it is emptied all the time."""
NAP = 0.001
"""Seconds between two looks while nothing comes."""


@dataclass
class _Publisher:
    """One key that messages come from.

    Attributes:
        bound: how far it has come, by its own word; NEVER if it says nothing.
        speaks: it says how far it has come.
        expected: next number of its puts, or -1.
        heard: when it last said anything, monotonic seconds.
    """

    bound: int = NEVER
    speaks: bool = False
    expected: int = -1
    heard: float = 0.0


def subscribe(session: zenoh.Session, source: FromKey, clock: Clock) -> Iterator[Any]:
    """Yield the samples on the key of a source in the order of their stamps, bounds, and losses.

    A sample is let go once no publisher can come with an earlier one: the least bound of those
    that tell theirs, and `max_delay` behind the clock for the others. A publisher that has been
    silent for longer than `max_delay` is not waited for.

    Args:
        session: on which to subscribe.
        source: its key, type and `max_delay`.
        clock: of the run.
    """
    layout, patience = layout_of(source.kind), int(source.max_delay or 0)
    subscriber = session.declare_subscriber(source.params.key, FifoChannel(QUEUE))
    publishers: dict[str, _Publisher] = {}
    waiting: list[tuple[int, int, Any]] = []
    count, floor = 0, NEVER
    while True:
        sample = subscriber.try_recv()
        now = monotonic()
        if sample is not None:
            publisher = publishers.setdefault(str(sample.key_expr), _Publisher())
            publisher.heard = now
            block, lost = _decode(sample, layout, publisher)
            yield from lost
            for index in range(0 if block is None else len(block)):
                count += 1
                heapq.heappush(waiting, (int(block.t[index]), count, block.row(index)))
        reached = _floor(publishers, now, patience, clock)
        while waiting and waiting[0][0] < reached:
            yield heapq.heappop(waiting)[2]
        if reached > floor:
            floor = reached
            yield Bound(floor)
        if sample is None:
            sleep(NAP)


def _decode(sample: Any, layout: Any, publisher: _Publisher) -> tuple[Any, list[Lost]]:
    """Return the block in a sample, or None, and what is missing before it."""
    lost = []
    attachment = sample.attachment
    frame = None
    payload = sample.payload.to_bytes()
    if attachment is not None:
        frame = frames.read(attachment.to_bytes(), payload)
    if frame is not None:
        if -1 < publisher.expected < frame.sequence:
            lost.append(Lost("gap", frame.sequence - publisher.expected))
        publisher.expected = frame.sequence + 1
        publisher.speaks = True
        publisher.bound = max(publisher.bound, frame.bound)
    if frame is not None and not frame.rows:
        return None, lost
    try:
        records = np.frombuffer(payload, dtype=np.uint8).reshape(-1, layout.size)
        return layout.decode_block(records), lost
    except (ValueError, LodeflowError):
        return None, [*lost, Lost("undecodable", 1)]


def _floor(publishers: dict[str, _Publisher], now: float, patience: int, clock: Clock) -> int:
    """Return the stamp below which nothing more is waited for."""
    if not publishers:
        return NEVER
    heard = [p for p in publishers.values() if now - p.heard <= patience / 1e9 or p.bound == END]
    speaking = [p.bound for p in heard if p.speaks]
    floor = min([bound for bound in speaking if bound < END], default=NEVER)
    if any(not p.speaks for p in publishers.values()):
        by_clock = clock.now() - patience
        return by_clock if floor == NEVER else min(floor, by_clock)
    if speaking and all(bound == END for bound in speaking):
        return END - 1
    return floor
