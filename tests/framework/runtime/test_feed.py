"""What sources yield: what enters, what is dropped and counted, and what is refused."""

from __future__ import annotations

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
from lodeflow.runtime.feed import batches
from lodeflow.runtime.intake import finite_rows
from lodeflow.sync import END

SETTINGS = settings(max_examples=150, deadline=None, derandomize=True, database=None)


def read(
    plugin: type[lf.Source], duration: int | None = None, most: int = 1
) -> tuple[list[Rows], dict[str, int], int]:
    """Return what entered per port, what was lost, and the number of batches."""
    node = planned(plugin)
    found: list[Rows] = [[] for _ in node.spec.outputs]
    reached = None
    count = 0
    for batch in feeds.feeds([node], SimClock(), duration, most)[node.name]:
        for index, one in batch.messages:
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
        for most in (1, 7, 4096):
            assert read(plugin, most=most)[:2] == ([kept], lost)


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
    assert finite_rows(truth) is None
    imu = lf.Imu(np.arange(3), np.zeros((3, 3)), np.zeros((3, 3)))
    assert finite_rows(imu) is None
    imu.angular_velocity[0, 2] = np.nan
    imu.linear_acceleration[2, 0] = -np.inf
    assert finite_rows(imu).tolist() == [False, True, False]


def test_nothing_is_nothing() -> None:
    assert read(source(None, Reading.empty(), ramp(2))) == ([[(0, 0.0), (1, 1.0)]], {}, 4)
    assert read(source()) == ([[]], {}, 1)


def broken(*items: Any, pair: bool = False) -> str:
    with pytest.raises(ContractError) as found:
        read(source(*items, pair=pair))
    text = told(found.value)
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
    return told(found.value)


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
    assert [rows([b]) for batch in seen for _, b in batch.messages] == [[(0, 0.0), (1, 1.0)]]


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
    assert read(reading(read_), duration=5)[0] == [[(0, 0.0), (1, 1.0), (2, 2.0)]]
    assert log == ["opened", "closed"] * 3


@given(st.integers(0, 12), st.sampled_from([0, 10**18]), st.lists(st.integers(0, 10)))
@SETTINGS
def test_the_duration_ends_at_a_stamp_wherever_the_blocks_end(
    duration: int, first: int, cuts: list[int]
) -> None:
    given = [(first + t, value) for t, value in rows([ramp(10)])]
    pieces = cut(given, [first + at for at in cuts], False)
    found, lost, _ = read(source(lf.Bound(0), *pieces), duration)
    assert found == [[row for row in given if row[0] < first + duration]]
    assert lost == {}


def test_the_duration_counts_from_the_first_stamp_of_all_sources() -> None:
    early, late, silent = planned(source(ramp(9))), planned(source(ramp(9)[4:])), planned(source())
    for node, name in ((early, "early"), (late, "late"), (silent, "silent")):
        node.name = name
    found = feeds.feeds([early, late, silent], SimClock(), 6)
    stamps = {
        name: [t for batch in feed for _, block in batch.messages for t in block.t.tolist()]
        for name, feed in found.items()
    }
    assert stamps == {"early": [0, 1, 2, 3, 4, 5], "late": [4, 5], "silent": []}


def test_a_source_without_end_is_cut() -> None:
    def endless(self: lf.Source, clock: lf.Clock) -> Iterator[Any]:
        t = 0
        while True:
            yield Reading(t, 0.0)
            t += 10

    assert read(reading(endless), duration=25)[0] == [[(0, 0.0), (10, 0.0), (20, 0.0)]]


def test_a_bound_beyond_the_end_is_the_end() -> None:
    assert read(source(ramp(2), lf.Bound(2**70)))[0] == [[(0, 0.0), (1, 1.0)]]
    assert read(source(lf.Bound(np.int64(1)), ramp(2)))[0] == [[(1, 1.0)]]
