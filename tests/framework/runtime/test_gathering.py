"""Small blocks of data at rest go on as large ones, with what each alone would have given."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest
from feeding import planned
from runtime_toys import Pair, Reading, ramp, reading, source

import lodeflow as lf
from lodeflow.clock import SimClock
from lodeflow.errors import ContractError, NodeFailure
from lodeflow.runtime import gathering
from lodeflow.runtime.feed import batches
from lodeflow.runtime.gathering import gathered
from lodeflow.sync import END


def gather(plugin: type[lf.Source], most: int) -> list[tuple[dict[int, list[int]], int]]:
    """Return the stamps of each port, and the bound, of each gathered batch."""
    return [
        ({port: one.t.tolist() for port, one in batch.messages}, batch.bound)
        for batch in gathered(batches(planned(plugin), SimClock(), most), most)
    ]


def test_small_blocks_are_gathered_to_some_rows_and_the_rest_goes_on_at_the_end() -> None:
    found = gather(source(ramp(3), ramp(5)[3:], ramp(9)[5:], ramp(10)[9:]), 4)
    assert found == [
        ({0: [0, 1, 2, 3, 4]}, 5),
        ({0: [5, 6, 7, 8]}, 9),
        ({0: [9]}, END),
    ]


def test_ports_are_gathered_side_by_side_and_bounds_go_on() -> None:
    def read_(self: lf.Source, clock: lf.Clock) -> Iterator[Pair]:
        yield Pair(ramp(1), None)
        yield Pair(None, ramp(2)[1:])
        yield lf.Bound(7)  # type: ignore[misc]
        yield Pair(Reading(8, 0.0), None)

    assert gather(reading(read_, pair=True), 2) == [({0: [0, 8], 1: [1]}, 9), ({}, END)]


def test_a_slow_source_is_not_waited_for(monkeypatch: pytest.MonkeyPatch) -> None:
    clock = iter(range(100))
    monkeypatch.setattr(gathering, "monotonic", lambda: float(next(clock)))
    assert [bound for _, bound in gather(source(ramp(1), ramp(2)[1:]), 10)] == [1, 2, END]


def test_what_came_before_a_failure_is_gathered_and_not_lost() -> None:
    feed = gathered(batches(planned(source(ramp(2), ramp(3)[2:], OSError())), SimClock(), 4096))
    ((_, one),) = next(feed).messages
    assert one.t.tolist() == [0, 1, 2]
    with pytest.raises(NodeFailure):
        next(feed)


def test_a_feed_that_is_no_longer_gathered_is_closed() -> None:
    closed = []

    def read_(self: lf.Source, clock: lf.Clock) -> Iterator[Reading]:
        try:
            yield ramp(3)
            yield ramp(6)[3:]
        finally:
            closed.append(True)

    feed = gathered(batches(planned(reading(read_)), SimClock(), 3), 3)
    next(feed)
    feed.close()
    assert closed == [True]


@pytest.mark.parametrize(
    ("wrong", "what"),
    [
        (Reading(np.array([5]), np.array([1.0], dtype=np.float32)), "float64 array of shape"),
        (Reading(np.array([5]), np.array([[1.0]])), "float64 array of shape"),
        (Reading(np.array([5]), [1.0]), "float64 array of shape"),
        (Reading(np.array([5], dtype=np.int32), np.array([1.0])), "int64 array of shape"),
        (Reading(np.array([2**62]), np.array([1.0])), "outside the range of ROS time"),
        ("text", "must send Reading, got str"),
    ],
)
def test_the_one_that_is_wrong_is_found_after_what_came_before(wrong: object, what: str) -> None:
    plugin = source(ramp(2), ramp(3)[2:], wrong, ramp(9)[6:])
    found = []
    with pytest.raises(ContractError, match=what):
        found.extend(gathered(batches(planned(plugin), SimClock(), 4096), 4096))
    assert [t for batch in found for _, one in batch.messages for t in one.t.tolist()] == [0, 1, 2]


def test_losses_of_what_came_before_a_wrong_one_are_counted_once() -> None:
    node = planned(source(ramp(3), ramp(2), Reading(np.array([2**62]), np.array([1.0]))))
    with pytest.raises(ContractError):
        list(batches(node, SimClock(), 4096))
    assert node.counters.lost == {"disorder": 2}
