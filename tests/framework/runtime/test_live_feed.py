"""Live sources, with a clock that the test moves: late, overflow, errors in their threads."""

from __future__ import annotations

import math
import threading
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from feeding import Rows, any_rows, by_definition, cut, planned
from hypothesis import given, settings
from hypothesis import strategies as st
from runtime_toys import Pair, Reading, block, ramp, reading, rows, source, told

import lodeflow as lf
from lodeflow.clock import SimClock
from lodeflow.errors import ContractError, NodeFailure
from lodeflow.runtime import feed as feeds
from lodeflow.runtime.engine import _by_stamp
from lodeflow.runtime.feed import LiveFeed
from lodeflow.runtime.intake import Intake, max_delay
from lodeflow.sync import END

SETTINGS = settings(max_examples=150, deadline=None, derandomize=True, database=None)


def live(*items: Any, pair: bool = False, delay: int = 10) -> tuple[LiveFeed, SimClock]:
    clock = SimClock()
    plugin = source(*items, pair=pair, max_delay=delay)
    return LiveFeed(planned(plugin), clock, threading.Event().set), clock


def finish(feed: LiveFeed) -> None:
    """Let the thread read to its end."""
    feed.start()
    feed.thread.join()
    awake: Any = feed.wake
    assert awake.__self__.is_set()


def drained_stamps(feed: LiveFeed) -> list[int]:
    return [m.t for batch in feed.drain() for _, m in batch.messages]


def drained(feed: LiveFeed) -> tuple[Rows, int]:
    """Return what the inbox gives now, and the bound behind it."""
    found = list(feed.drain())
    return [r for batch in found for _, b in batch.messages for r in rows([b])], found[-1].bound


def test_max_delay_makes_a_source_live() -> None:
    assert max_delay(planned(source())) is None
    assert max_delay(planned(source(max_delay=0))) == 0
    assert Intake(planned(source(max_delay=0))).live


def test_the_clock_moves_the_bound_of_a_live_source() -> None:
    feed, clock = live(delay=10)
    clock.advance(100)
    assert drained(feed) == ([], 90)
    clock.advance(105)
    assert drained(feed) == ([], 95)
    finish(feed)
    assert drained(feed) == ([], END)


def test_what_comes_later_than_max_delay_is_dropped_and_counted() -> None:
    feed, clock = live(delay=10)
    clock.advance(30)
    assert drained(feed) == ([], 20)
    feed.inbox.extend([Reading(19, 1.0), Reading(20, 2.0), block((18, 0.0), (25, 3.0))])
    clock.advance(40)
    assert drained(feed) == ([(20, 2.0), (25, 3.0)], 30)
    assert feed.node.counters.lost == {"late": 2}


@given(any_rows, st.lists(st.integers(0, 25)))
@SETTINGS
def test_late_rows_are_counted_the_same_however_they_are_split(
    given: Rows, cuts: list[int]
) -> None:
    finite = [row for row in given if math.isfinite(row[1])]
    timely, expected = by_definition([row for row in finite if row[0] >= 0])
    counts = {
        "nonfinite": len(given) - len(finite),
        "late": sum(t < 0 for t, _ in finite),
        "disorder": expected.get("disorder", 0),
    }
    for items in ([block(*given)], cut(given, cuts, True)):
        feed, clock = live(delay=10)
        clock.advance(10)
        assert drained(feed) == ([], 0)
        feed.inbox.extend(items)
        assert drained(feed)[0] == timely
        assert feed.node.counters.lost == {why: n for why, n in counts.items() if n}


def test_a_live_source_may_promise_a_bound_itself() -> None:
    feed, _ = live(delay=1000)
    feed.inbox.extend([lf.Bound(50), Reading(49, 0.0), Reading(50, 1.0)])
    assert drained(feed) == ([(50, 1.0)], 50)
    assert feed.node.counters.lost == {"late": 1}


def test_ports_of_a_live_source_do_not_wait_for_each_other() -> None:
    feed, _ = live(pair=True, delay=1000)
    feed.inbox.extend([Pair(Reading(8, 1.0), None), Pair(None, Reading(3, 2.0))])
    assert drained(feed)[0] == [(8, 1.0), (3, 2.0)]
    assert feed.node.counters.lost == {}


def test_samples_of_one_moment_go_on_together_and_others_by_their_stamps() -> None:
    feed, _ = live(pair=True, delay=1000)
    feed.inbox.extend(
        [Pair(Reading(4, 1.0), Reading(4, 2.0)), Pair(Reading(9, 3.0), Reading(7, 4.0))]
    )
    found = [
        (t, [(port, sample.t, sample.x) for port, sample in messages])
        for batch in feed.drain()
        for t, messages in _by_stamp(batch)
    ]
    assert found == [
        (4, [(0, 4, 1.0), (1, 4, 2.0)]),
        (7, [(1, 7, 4.0)]),
        (9, [(0, 9, 3.0)]),
    ]


def test_a_live_source_ends_where_the_run_does() -> None:
    feed, _ = live(delay=1000)
    feed.until = 6
    feed.inbox.extend([Reading(5, 1.0), Reading(6, 2.0), Reading(7, 3.0)])
    assert drained(feed)[0] == [(5, 1.0)]


@pytest.mark.parametrize(
    "odd", [[math.nan, 0.0, 0.0], [math.inf, -math.inf, 0.0], [0.0, 0.0, -math.inf]]
)
def test_an_array_of_a_live_sample_is_finite(odd: list[float]) -> None:
    class Device(lf.Source):
        max_delay = 1000

        def read(self, clock: lf.Clock) -> Iterator[lf.MagneticField]:
            yield lf.MagneticField(1, np.full(3, 1e308))
            yield lf.MagneticField(2, np.array(odd))

    feed = LiveFeed(planned(Device), SimClock(), threading.Event().set)
    finish(feed)
    assert drained_stamps(feed) == [1]
    assert feed.node.counters.lost == {"nonfinite": 1}


def test_what_does_not_fit_the_inbox_is_counted_as_overflow(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(feeds, "INBOX_SIZE", 3)
    pairs = Pair(Reading(8, 0.0), ramp(4)), Pair(None, Reading(9, 0.0))
    feed, _ = live(*[Pair(Reading(t, 0.0), None) for t in range(3)], *pairs, pair=True)
    finish(feed)
    assert [t for t, _ in drained(feed)[0]] == [0, 1, 2]
    assert feed.node.counters.lost == {"overflow": 6}
    list(feed.drain())
    assert feed.node.counters.lost == {"overflow": 6}


def test_a_bound_is_never_an_overflow(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(feeds, "INBOX_SIZE", 1)
    feed, _ = live(Reading(0, 0.0), lf.Bound(7), Reading(8, 0.0))
    finish(feed)
    batches_ = list(feed.drain())
    assert [batch.bound for batch in batches_][1] == 7
    assert feed.node.counters.lost == {"overflow": 1}


def test_an_error_in_the_thread_comes_after_what_was_read_before() -> None:
    feed, _ = live(Reading(3, 0.0), OSError("unplugged"))
    finish(feed)
    seen = []
    with pytest.raises(NodeFailure) as found:
        seen.extend(feed.drain())
    assert [rows([b]) for batch in seen for _, b in batch.messages] == [[(3, 0.0)]]
    assert told(found.value) == ("node 's' (Scripted.read) failed at t=3: OSError: unplugged")
    assert isinstance(found.value.__cause__, OSError)


def test_an_error_waits_until_all_that_came_before_it_is_in_the_inbox() -> None:
    feed, _ = live()
    feed.error = OSError("unplugged")  # the thread is about to end, and another item may have come
    assert drained(feed)[0] == []
    feed.inbox.append(Reading(3, 0.0))
    feed.ended = True
    found = feed.drain()
    assert rows([b for _, b in next(found).messages]) == [(3, 0.0)]
    with pytest.raises(NodeFailure):
        next(found)


def test_a_live_bound_beyond_the_end_is_the_end() -> None:
    feed, _ = live(delay=1000)
    feed.inbox.append(lf.Bound(2**70))
    assert drained(feed) == ([], END)
    assert feed.intake.floor == END


def test_an_error_before_the_first_sample() -> None:
    feed, _ = live(OSError("no device"))
    finish(feed)
    with pytest.raises(NodeFailure, match=r"^node 's' \(Scripted.read\) failed before its first"):
        list(feed.drain())


def test_a_wrong_item_of_a_live_source_is_refused() -> None:
    feed, _ = live(Reading(0, 0.0), "text")
    finish(feed)
    with pytest.raises(ContractError, match="it must send Reading, got str"):
        list(feed.drain())


def test_a_wrong_item_that_overflows_is_refused_all_the_same(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(feeds, "INBOX_SIZE", 0)
    feed, _ = live("text")
    finish(feed)
    with pytest.raises(NodeFailure, match="a source yielded 'text'"):
        list(feed.drain())


def test_a_source_faster_than_the_run_does_not_hold_it() -> None:
    feed, _ = live(delay=10)
    feed.inbox.append(Reading(0, 0.0))
    taken = 0
    for batch in feed.drain():
        taken += len(batch.messages)
        feed.inbox.append(Reading(taken, 0.0))
        assert taken < 5
    assert taken == 1


def test_a_live_source_is_cut_at_the_end_of_the_run() -> None:
    clock = SimClock()
    feed = LiveFeed(planned(source(max_delay=10)), clock, threading.Event().set, until=50)
    feed.inbox.extend([Reading(49, 1.0), Reading(50, 2.0)])
    clock.advance(55)
    assert drained(feed) == ([(49, 1.0)], 45)
    assert not feed.stopping
    clock.advance(60)
    assert drained(feed) == ([], END)
    assert feed.stopping
    assert feed.node.counters.lost == {}


def test_stopping_ends_the_thread_and_closes_the_source() -> None:
    go, closed = threading.Event(), threading.Event()

    def wait(self: lf.Source, clock: lf.Clock) -> Iterator[Any]:
        try:
            while True:
                go.wait()
                yield None
        finally:
            closed.set()

    feed = LiveFeed(planned(reading(wait, max_delay=5)), SimClock(), threading.Event().set)
    feed.start()
    feed.stop()
    go.set()
    feed.thread.join(10)
    assert closed.is_set()
    assert feed.ended
