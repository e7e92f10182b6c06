"""What sources yield: what enters, what is dropped and counted, and what is refused."""

from __future__ import annotations

import math
import threading
from collections.abc import Iterator
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from runtime_toys import Pair, Reading, block, graph, ramp, reading, rows, source

import lodeflow as lf
from lodeflow.clock import SimClock
from lodeflow.errors import ContractError, NodeFailure
from lodeflow.runtime import feed as feeds
from lodeflow.runtime.feed import Intake, LiveFeed, batches, max_delay
from lodeflow.runtime.plan import Plan, PlanNode
from lodeflow.sync import END

SETTINGS = settings(max_examples=150, deadline=None, derandomize=True, database=None)

Rows = list[tuple[int, float]]


def planned(plugin: type[lf.Source]) -> PlanNode:
    return Plan(graph(s=plugin)).nodes["s"]


def read(plugin: type[lf.Source], until: int = END) -> tuple[list[Rows], dict[str, int], int]:
    """Return what entered per port, what was lost, and the number of batches."""
    node = planned(plugin)
    found: list[Rows] = [[] for _ in node.spec.outputs]
    reached = None
    count = 0
    for batch in batches(node, SimClock(), until):
        for index, one in batch.blocks:
            one.validate()
            assert len(one)
            assert reached is None or one.t[0] >= reached
            assert one.t[-1] < batch.bound
            found[index] += rows([one])
        assert reached is None or batch.bound >= reached
        reached = batch.bound
        count += 1
    assert reached == END
    return found, node.counters.lost, count


def by_definition(given: Rows) -> tuple[Rows, dict[str, int]]:
    kept: Rows = []
    lost = {"nonfinite": 0, "disorder": 0}
    for t, x in given:
        if not math.isfinite(x):
            lost["nonfinite"] += 1
        elif kept and t <= kept[-1][0]:
            lost["disorder"] += 1
        else:
            kept.append((t, x))
    return kept, {why: count for why, count in lost.items() if count}


any_rows = st.lists(
    st.tuples(
        st.integers(-20, 20), st.sampled_from([0.0, 1.5, -2.0, math.nan, math.inf, -math.inf])
    ),
    max_size=25,
)


def cut(given: Rows, cuts: list[int], samples: bool) -> list[Any]:
    """Return rows as items of a source: blocks cut at some indices, or samples where of one."""
    edges = [0, *sorted(min(c, len(given)) for c in cuts), len(given)]
    parts = [block(*given[a:b]) for a, b in pairwise(edges)]
    return [part.row(0) if samples and len(part) == 1 else part for part in parts]


@given(any_rows, st.lists(st.integers(0, 25)), st.booleans())
@SETTINGS
def test_what_is_dropped_does_not_depend_on_the_split(
    given: Rows, cuts: list[int], samples: bool
) -> None:
    kept, lost = by_definition(given)
    for plugin in (
        source(block(*given)),
        source(*cut(given, cuts, samples)),
        source(*cut(given, list(range(len(given))), True)),
    ):
        assert read(plugin)[:2] == ([kept], lost)


@given(any_rows, any_rows, st.lists(st.integers(-21, 21)), st.data())
@SETTINGS
def test_several_ports_split_at_common_stamps(
    a: Rows, b: Rows, stamps: list[int], data: st.DataObject
) -> None:
    (kept_a, lost_a), (kept_b, lost_b) = by_definition(a), by_definition(b)
    lost = {w: lost_a.get(w, 0) + lost_b.get(w, 0) for w in {*lost_a, *lost_b}}
    items = []
    at = [0, 0]
    for stamp in [*sorted(stamps), 99]:
        parts: list[Any] = []
        for port, (full, kept) in enumerate(((a, kept_a), (b, kept_b))):
            # What is dropped between the last row kept before the stamp and the next may fall
            # on either side of the cut.
            first = place(full, [k for k in kept if k[0] < stamp][-1:]) + 1
            later = [k for k in kept if k[0] >= stamp][:1]
            last = place(full, later) if later else len(full)
            end = data.draw(st.integers(max(first, at[port]), max(last, at[port])))
            end = len(full) if stamp == 99 else end
            part = block(*full[at[port] : end])
            parts.append(part if len(part) or data.draw(st.booleans()) else None)
            at[port] = end
        items.append(Pair(*parts))
    whole = read(source(Pair(block(*a), block(*b)), pair=True))
    assert whole[:2] == ([kept_a, kept_b], lost)
    assert read(source(*items, pair=True))[:2] == whole[:2]


def place(given: Rows, row: Rows) -> int:
    """Return where a kept row stands; -1 for none. Of equal rows the first is kept."""
    return given.index(row[0]) if row else -1


def test_after_a_yield_nothing_at_or_below_its_stamp_may_follow_on_any_port() -> None:
    found, lost, _ = read(
        source(
            Pair(block((1, 1.0), (5, 5.0)), None),
            Pair(None, block((3, 3.0), (5, 5.0), (6, 6.0))),
            pair=True,
        )
    )
    assert found == [[(1, 1.0), (5, 5.0)], [(6, 6.0)]]
    assert lost == {"disorder": 2}


def test_a_bound_holds_the_source_to_its_word() -> None:
    found, lost, _ = read(source(lf.Bound(10), ramp(12), lf.Bound(5), block((12, 0.5))))
    assert found == [[(10, 10.0), (11, 11.0), (12, 0.5)]]
    assert lost == {"disorder": 10}


def test_nan_may_stand_in_fields_with_gaps() -> None:
    truth = lf.AttitudeTruth(np.arange(3), np.full((3, 4), np.nan), np.zeros(3, dtype=np.int64))
    assert feeds.finite_rows(truth) is None
    imu = lf.Imu(np.arange(3), np.zeros((3, 3)), np.zeros((3, 3)))
    assert feeds.finite_rows(imu) is None
    imu.angular_velocity[0, 2] = np.nan
    imu.linear_acceleration[2, 0] = -np.inf
    assert feeds.finite_rows(imu).tolist() == [False, True, False]


def test_nothing_is_nothing() -> None:
    assert read(source(None, Reading.empty(), ramp(2))) == ([[(0, 0.0), (1, 1.0)]], {}, 4)
    assert read(source()) == ([[]], {}, 1)


def broken(*items: Any, pair: bool = False) -> str:
    with pytest.raises(ContractError) as found:
        read(source(*items, pair=pair))
    text = str(found.value)
    start = "node 's' (Scripted) broke the contract of port "
    assert text.startswith(start)
    return text.removeprefix(start)


FIELD = "Reading.x must be a C-contiguous float64 array of shape (N,), got"


def test_what_is_said_of_wrong_items() -> None:
    assert broken(3.5) == "'out': it must send Reading, got float"
    assert broken(lf.Heading(0, 1.0)) == "'out': it must send Reading, got Heading"
    assert broken((ramp(1),)) == "'out': it must send Reading, got tuple"
    assert broken(Reading(0.5, 1.0)) == (
        "'out': Reading.t must be an int in nanoseconds, or an int64 array for a block, "
        "got 0.5 (float)"
    )
    assert broken(Reading(np.arange(2), np.zeros(3))) == f"'out': {FIELD} float64 of shape (3,)"
    assert broken(Reading(np.arange(2), np.arange(2))) == f"'out': {FIELD} int64 of shape (2,)"
    assert broken(ramp(1), pair=True) == (
        "'a, b': it must yield these ports or a Bound, got Reading[1 rows, t=0..0]"
    )
    assert broken((ramp(1), None, None), pair=True).startswith("'a, b': it must yield these ports")
    assert broken(Pair(None, 3), pair=True) == "'b': it must send Reading, got int"
    assert broken(lf.Bound(0.5)) == "'out': it must yield Bound(int), got Bound(t=0.5)"


@pytest.mark.parametrize("t", [2**62, -(2**62), 2**63 - 1, 2**70, -(2**31) * 10**9 - 1])
def test_a_stamp_beyond_ros_time_is_refused(t: int) -> None:
    text = f"'out': stamp {t} is outside the range of ROS time (1901 to 2038, nanoseconds since "
    assert broken(ramp(1), Reading(t, 0.0)).startswith(text)
    if abs(t) < 2**63:
        assert broken(block((0, 0.0), (t, 0.0))).startswith(text)


def failed(plugin: type[lf.Source]) -> str:
    node = planned(plugin)
    with pytest.raises(NodeFailure) as found:
        list(batches(node, SimClock()))
    assert found.value.__cause__ is not None
    return str(found.value)


def test_a_source_that_raises() -> None:
    assert failed(source(ValueError("no such port"))) == (
        "node 's' (Scripted.read) failed before its first message: ValueError: no such port"
    )
    assert failed(source(ramp(4), OSError("unplugged"))) == (
        "node 's' (Scripted.read) failed at t=3: OSError: unplugged"
    )

    def opened(self: lf.Source, clock: lf.Clock) -> Any:
        raise FileNotFoundError("walk.csv")

    assert failed(reading(opened)) == (
        "node 's' (Scripted.read) failed before its first message: FileNotFoundError: walk.csv"
    )

    def nothing(self: lf.Source, clock: lf.Clock) -> Any:
        return None

    assert "TypeError: 'NoneType' object is not iterable" in failed(reading(nothing))


def test_what_came_before_the_failure_has_entered() -> None:
    seen = []
    with pytest.raises(NodeFailure):
        seen.extend(batches(planned(source(ramp(2), ValueError())), SimClock()))
    assert [rows([b]) for batch in seen for _, b in batch.blocks] == [[(0, 0.0), (1, 1.0)]]


def test_read_may_return_any_iterable() -> None:
    def listed(self: lf.Source, clock: lf.Clock) -> Any:
        return [ramp(2), lf.Bound(7)]

    assert read(reading(listed))[0] == [[(0, 0.0), (1, 1.0)]]


def test_the_source_is_read_once_and_closed() -> None:
    log = []

    def read_(self: lf.Source, clock: lf.Clock) -> Iterator[Any]:
        log.append("opened")
        try:
            yield None
            yield from (ramp(3), block((5, 5.0)), block((9, 9.0)))
        finally:
            log.append("closed")

    assert read(reading(read_))[0] == [[(0, 0.0), (1, 1.0), (2, 2.0), (5, 5.0), (9, 9.0)]]
    assert log == ["opened", "closed"]
    early = batches(planned(reading(read_)), SimClock())
    next(early)
    early.close()
    assert log == ["opened", "closed"] * 2
    assert read(reading(read_), until=5)[0] == [[(0, 0.0), (1, 1.0), (2, 2.0)]]
    assert log == ["opened", "closed"] * 3


@given(st.integers(-1, 12), st.lists(st.integers(0, 10)))
@SETTINGS
def test_until_cuts_at_a_stamp_wherever_the_blocks_end(until: int, cuts: list[int]) -> None:
    given = rows([ramp(10)])
    found, lost, _ = read(source(*cut(given, cuts, False)), until)
    assert found == [[row for row in given if row[0] < until]]
    assert lost == {}


def test_a_source_without_end_is_cut() -> None:
    def endless(self: lf.Source, clock: lf.Clock) -> Iterator[Any]:
        t = 0
        while True:
            yield Reading(t, 0.0)
            t += 10

    assert read(reading(endless), until=25)[0] == [[(0, 0.0), (10, 0.0), (20, 0.0)]]


def test_a_bound_beyond_the_end_is_the_end() -> None:
    assert read(source(ramp(2), lf.Bound(2**70)))[0] == [[(0, 0.0), (1, 1.0)]]
    assert read(source(lf.Bound(np.int64(1)), ramp(2)))[0] == [[(1, 1.0)]]


# Live sources, with a clock that the test moves.


def live(*items: Any, pair: bool = False, delay: int = 10) -> tuple[LiveFeed, SimClock]:
    clock = SimClock()
    plugin = source(*items, pair=pair, max_delay=delay)
    return LiveFeed(planned(plugin), clock, threading.Event()), clock


def finish(feed: LiveFeed) -> None:
    """Let the thread read to its end."""
    feed.start()
    feed.thread.join()
    assert feed.wake.is_set()


def drained(feed: LiveFeed) -> tuple[Rows, int]:
    """Return what the inbox gives now, and the bound behind it."""
    found = list(feed.drain())
    return [r for batch in found for _, b in batch.blocks for r in rows([b])], found[-1].bound


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
    assert [rows([b]) for batch in seen for _, b in batch.blocks] == [[(3, 0.0)]]
    assert str(found.value) == ("node 's' (Scripted.read) failed at t=3: OSError: unplugged")
    assert isinstance(found.value.__cause__, OSError)


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
        taken += len(batch.blocks)
        feed.inbox.append(Reading(taken, 0.0))
        assert taken < 5
    assert taken == 1


def test_a_live_source_is_cut_at_the_end_of_the_run() -> None:
    clock = SimClock()
    feed = LiveFeed(planned(source(max_delay=10)), clock, threading.Event(), until=50)
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

    feed = LiveFeed(planned(reading(wait, max_delay=5)), SimClock(), threading.Event())
    feed.start()
    feed.stop()
    go.set()
    feed.thread.join(10)
    assert closed.is_set()
    assert feed.ended
