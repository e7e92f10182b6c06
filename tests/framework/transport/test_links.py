"""The links of a group, over real sessions."""

from __future__ import annotations

import threading
import time
import types
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

import lodeflow as lf
from lodeflow.graph.model import Graph, GraphNode, Group, Wire
from lodeflow.graph.partition import partition
from lodeflow.messages.cdr import layout_of
from lodeflow.sync import END
from lodeflow.transport import frame, meeting
from lodeflow.transport.links import Links
from lodeflow.transport.session import LINKS, close_session, open_session


class Source(lf.Source):
    def read(self, clock: lf.Clock) -> Iterator[lf.Heading]:
        yield from ()


class Reader(lf.Node):
    def step(self, x: lf.Heading) -> None: ...


GRAPH = Graph(
    "links",
    {
        "s": GraphNode("s", "Source", Source, Source.Params()),
        "r": GraphNode("r", "Reader", Reader, Reader.Params(), {"x": Wire("s", "out")}),
    },
    processes={"first": Group(("s",)), "second": Group(("r",))},
)
PARTS = partition(GRAPH)
WIRE = Wire("s", "out")


class Driver:
    """What a sender's driver says of its port."""

    def port(self, wire: Wire) -> Any:
        return types.SimpleNamespace(bound=7)


class Pair:
    """Both groups in one process; `attended` counts how often the second looked for orders."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.opened: list[tuple[Links, Any]] = []
        self.attended = 0
        self.arrived: list[tuple[Any, int]] = []
        self.first, self.second = self.open("first"), self.open("second")

    def open(self, name: str) -> Links:
        index = list(PARTS).index(name)
        session = open_session(
            listen=[f"unixsock-stream/{self.folder}/{index}"],
            connect=[f"unixsock-stream/{self.folder}/{other}" for other in range(index)],
            settings=LINKS,
        )
        attend = self._attend if name == "second" else lambda links: None
        links = Links(session, GRAPH, PARTS[name], list(PARTS), attend=attend)
        if name == "second":
            links.on_arrival(WIRE, lambda message, bound: self.arrived.append((message, bound)))
        self.opened.append((links, session))
        return links

    def _attend(self, links: Links) -> None:
        self.attended += 1

    def meet(self, *, stopping: bool = False) -> None:
        def first() -> None:
            met.append(meeting.barrier(self.first, lambda: stopping, print))

        met: list[bool] = []
        other = threading.Thread(target=first)
        other.start()
        met.append(meeting.barrier(self.second, lambda: stopping, print))
        other.join()
        assert met == [True, True]

    def leave(self, links: Links) -> None:
        """Close without a word, as a process does that is killed."""
        [(_, session)] = [one for one in self.opened if one[0] is links]
        self.opened = [one for one in self.opened if one[0] is not links]
        links.close()
        close_session(session)


@pytest.fixture
def pair(tmp_path: Path) -> Iterator[Pair]:
    made = Pair(tmp_path)
    yield made
    for links, _ in list(made.opened):
        made.leave(links)


def taken(pair: Pair, seconds: float = 5.0) -> list[tuple[Any, int]]:
    """Return what comes to the second group first within a time: messages and bounds."""
    for _ in range(int(seconds / 0.05)):
        if pair.second.take():
            break
        pair.second.wait(0.05)
    return pair.arrived


def test_groups_meet_though_they_are_told_to_stop(pair: Pair) -> None:
    # One of them may have begun before it was told, and be owed what follows from what it sent.
    pair.meet(stopping=True)


def test_who_is_told_to_stop_does_not_wait_for_ever(pair: Pair) -> None:
    pair.leave(pair.first)
    assert not meeting.barrier(pair.second, lambda: True, print)


@pytest.mark.parametrize("begun", [False, True])
def test_who_leaves_before_it_has_begun_owes_nothing(pair: Pair, begun: bool) -> None:
    pair.meet()
    leaving = threading.Thread(
        target=meeting.farewell, args=(pair.first, 5.0), kwargs={"begun": begun}
    )
    leaving.start()
    arrivals = taken(pair)
    leaving.join(5.0)
    assert not leaving.is_alive()
    assert arrivals == [(None, END)]
    assert pair.second.losses["first"].gaps == int(begun)


def test_what_nobody_has_worked_on_is_known(pair: Pair) -> None:
    pair.meet()
    pair.first.attach(Driver(), lambda first, last: None)  # type: ignore[arg-type]
    pair.first.note("no data", "second")
    until = time.monotonic() + 5.0
    while not any(link.arrived for link in pair.second.links.values()):
        assert time.monotonic() < until
        pair.second.drain(time.monotonic())
    assert not pair.second.has_unread
    pair.first.tap(WIRE)(lf.Heading(5, 1.0))
    pair.first.flush()
    while not pair.second.has_unread:
        assert time.monotonic() < until
        pair.second.drain(time.monotonic())
    pair.second.break_off()
    assert pair.arrived == [(None, END)]
    assert pair.second.losses["first"].gaps == 1
    assert not pair.second.lossless


def test_orders_are_looked_for_whatever_ends_a_wait(pair: Pair) -> None:
    pair.meet()
    pair.second.take()
    for _ in range(5):
        before = pair.attended
        pair.second.wait(0.005)
        pair.second.take()
        assert pair.attended > before


def test_a_message_that_ends_a_wait_is_taken_at_once(pair: Pair) -> None:
    pair.meet()
    pair.first.attach(Driver(), lambda first, last: None)  # type: ignore[arg-type]
    pair.first.tap(WIRE)(lf.Heading(5, 1.0))
    pair.first.flush()
    assert taken(pair) == [(lf.Heading(5, 1.0), 7)]


@pytest.mark.parametrize("more", [-33, -32, -1, 0, 1])
def test_a_head_is_found_before_the_records_and_beside_them(
    pair: Pair, monkeypatch: pytest.MonkeyPatch, more: int
) -> None:
    monkeypatch.setattr(frame, "SMALL", layout_of(lf.Heading).size + more)
    pair.meet()
    pair.first.attach(Driver(), lambda first, last: None)  # type: ignore[arg-type]
    pair.first.tap(WIRE)(lf.Heading(5, 1.0))
    pair.first.flush()
    assert taken(pair) == [(lf.Heading(5, 1.0), 7)]


def test_what_only_brings_data_ends_a_wait_and_asks_for_nothing_else(pair: Pair) -> None:
    pair.meet()
    for look in (False, True):
        pair.second.take()
        begun = time.monotonic()
        pair.second.wake(look=look)
        pair.second.wait(5.0)
        assert time.monotonic() - begun < 4.0
        assert pair.second.woken == look


def test_no_frame_is_lost_between_two_waits(pair: Pair) -> None:
    pair.meet()
    pair.first.attach(Driver(), lambda first, last: None)  # type: ignore[arg-type]
    tap = pair.first.tap(WIRE)
    for t in (7, 8, 9):
        tap(lf.Heading(t, 0.1 * t))
        pair.first.flush()
    until = time.monotonic() + 5.0
    while len(pair.arrived) < 3 and time.monotonic() < until:
        pair.second.wait(0.02)
        pair.second.wait(0.02)
        pair.second.take()
    assert [message.t for message, _ in pair.arrived if message is not None] == [7, 8, 9]


@pytest.mark.parametrize("stop", [False, True])
def test_who_is_told_that_a_group_has_crashed_ends_its_streams(pair: Pair, stop: bool) -> None:
    pair.meet()
    pair.leave(pair.first)
    stand_in = pair.open("first")
    told = threading.Thread(
        target=meeting.resign, args=(stand_in, ["second"], 10.0), kwargs={"stop": stop}
    )
    told.start()
    arrivals = taken(pair)
    told.join(5.0)
    assert not told.is_alive()  # it was answered
    assert arrivals == [(None, END)]
    assert pair.second.losses["first"].gaps == 1
    assert pair.second.left_early() == ({"first"} if stop else set())


def test_who_cannot_be_reached_is_told_once_and_so_is_its_return(
    pair: Pair, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(meeting, "LOOK_EVERY", 0.0)
    monkeypatch.setattr(meeting, "OUT_OF_REACH", 0.05)
    pair.meet()
    said: list[str] = []
    reach = meeting.Reach(pair.second, ["first"], said.append)
    link = pair.second.by_name["first"]

    def look(matched: bool) -> None:
        until = time.monotonic() + 10.0
        while link.is_matched != matched:
            assert time.monotonic() < until
            time.sleep(0.01)
        for _ in range(4):
            reach.look()
            time.sleep(0.02)

    look(matched=True)
    assert said == []
    pair.leave(pair.first)
    look(matched=False)
    assert said == ["group 'first' cannot be reached; what it is owed is kept until it is back"]
    pair.open("first")
    look(matched=True)
    assert said[1:] == ["group 'first' is back after 0 s"]
