"""Both drivers: counters, taps, last words, cycles, and what they hold back."""

from __future__ import annotations

import gc
from typing import Any

import pytest
from runtime_toys import (
    Add,
    Copy,
    Given,
    Pair,
    Reading,
    block,
    drive,
    fail,
    graph,
    plan_of,
    ramp,
    rows,
    stepping,
    tapped,
    wire,
)

import lodeflow as lf
from lodeflow.graph.model import Gate, Graph, GraphNode
from lodeflow.runtime.plan import Plan
from lodeflow.runtime.samples import SampleDriver
from lodeflow.sync import END

both = pytest.mark.parametrize("form", ["blocks", "samples"])


@both
def test_counters(form: str) -> None:
    class Odd(lf.Node):
        def step(self, x: Reading) -> Pair | None:
            return Pair(x, None) if x.x % 2 else None

    class Switch(lf.Node):
        def step(self, x: Reading) -> lf.Mode | None:
            return lf.Mode(x.t, 1 + (x.x >= 4))

    nodes = graph(
        s=Given,
        odd=(Odd, {"x": "s.a"}),
        add=(Add, {"x": "s.a", "y": "odd.a"}),
        switch=(Switch, {"x": "s.a"}),
    ).nodes
    gates = (Gate(wire("switch"), "mode", frozenset({2})),)
    gated = GraphNode("gated", "Copy", Copy, Copy.Params(), {"x": wire("s.a")}, gates)
    plan = Plan(Graph("test", {**nodes, "gated": gated}))
    drive(form, plan, ramp(7))
    counts = {
        name: (n.counters.stepped, n.counters.unmatched, n.counters.gated, n.counters.sent)
        for name, n in plan.nodes.items()
    }
    assert counts == {
        "s": (0, 0, 0, {"a": 7, "b": 0}),
        "odd": (7, 0, 0, {"a": 3, "b": 0}),
        "add": (3, 4, 0, {"out": 3}),
        "switch": (7, 0, 0, {"out": 7}),
        "gated": (3, 0, 4, {"out": 3}),
    }
    assert all(n.counters.lost == {} for n in plan.nodes.values())


@both
def test_taps_get_every_message_of_their_stream_in_order(form: str) -> None:
    plan = stepping(lambda x: x if x.t != 1 else None)
    sent = tapped(plan, "s.a", "s.b", "n")
    again = tapped(plan, "n")
    drive(form, plan, ramp(3))
    assert rows(sent["s.a"]) == [(0, 0.0), (1, 1.0), (2, 2.0)]
    assert sent["s.b"] == []
    assert rows(sent["n"]) == rows(again["n"]) == [(0, 0.0), (2, 2.0)]


@both
def test_an_error_in_a_tap_is_not_hidden(form: str) -> None:
    plan = stepping(lambda x: x)
    plan.tap(wire("n"), fail)
    with pytest.raises(ZeroDivisionError):
        drive(form, plan, ramp(1))


@both
def test_finish_of_every_node_and_once(form: str) -> None:
    log = []

    class Node(lf.Node):
        def start(self) -> None:
            self.sum = 0.0

        def step(self, x: Reading) -> Reading | None:
            self.sum += x.x

        def finish(self) -> Reading | None:
            log.append(self.name)
            return Reading(9, self.sum)

    plan = Plan(graph(s=Given, one=(Node, {"x": "s.a"}), two=(Node, {"x": "one"})))
    sent = tapped(plan, "one", "two")
    assert drive(form, plan, ramp(4)).unfinished() == []
    assert log == ["one", "two"]
    assert rows(sent["one"]) == rows(sent["two"]) == [(9, 6.0)]


@both
def test_finish_may_send_blocks_and_some_ports(form: str) -> None:
    class Node(lf.Node):
        def step(self, x: Reading) -> None: ...

        def finish(self) -> Pair:
            return Pair(None, ramp(3))

    plan = plan_of(Node)
    sent = tapped(plan, "n.a", "n.b")
    drive(form, plan, Reading.empty())
    assert (rows(sent["n.a"]), rows(sent["n.b"])) == ([], rows([ramp(3)]))


@both
def test_last_words_at_the_last_row_meet_it(form: str) -> None:
    """A port that a finish may write promises nothing above its last row."""

    class Last(lf.Node):
        def step(self, x: Reading) -> Reading | None:
            self.t = x.t

        def finish(self) -> Reading | None:
            return Reading(self.t, 100.0)

    plan = Plan(graph(s=Given, last=(Last, {"x": "s.a"}), add=(Add, {"x": "s.a", "y": "last"})))
    sent = tapped(plan, "add")
    drive(form, plan, ramp(4))
    assert rows(sent["add"]) == [(3, 103.0)]


@both
def test_an_optional_input_that_is_not_wired_is_none(form: str) -> None:
    class Node(lf.Node):
        sync = lf.Exact()

        def step(self, x: Reading, y: Reading = None) -> Reading | None:
            return x.replace(x=x.x + 1) if y is None else None

    class BlockNode(lf.Node):
        sync = lf.Each()

        def step_block(self, x: lf.Sparse[Reading], y: lf.Sparse[Reading] = None) -> Reading | None:
            assert len(y.values) == 0
            assert (y.rows == -1).all()
            return x.values

    plan = Plan(graph(s=Given, n=(Node, {"x": "s.a"}), m=(BlockNode, {"x": "s.a"})))
    sent = tapped(plan, "n", "m")
    drive(form, plan, ramp(2))
    assert rows(sent["n"]) == [(0, 1.0), (1, 2.0)]
    assert rows(sent["m"]) == [(0, 0.0), (1, 1.0)]


@both
def test_a_second_start_runs_from_the_beginning(form: str) -> None:
    class Node(lf.Node):
        def start(self) -> None:
            self.seen = 0

        def step(self, x: Reading) -> Reading | None:
            self.seen += 1
            return x.replace(x=float(self.seen))

    plan = plan_of(Node)
    sent = tapped(plan, "n")
    drive(form, plan, ramp(2))
    drive(form, plan, ramp(2))
    assert rows(sent["n"]) == [(0, 1.0), (1, 2.0)] * 2


class Loop(lf.Node):
    sync = lf.Hold("x", initial={"back": Reading(0, 1.0)}, delay=True)

    def step(self, x: Reading, back: Reading) -> Reading | None:
        return x.replace(x=2 * x.x + back.x + back.t)


class EitherOf(lf.Node):
    sync = lf.Each()

    def step(self, x: Reading | None, y: Reading | None) -> Reading | None:
        return x or y


def test_a_cycle_through_each_promises_nothing_that_it_still_holds() -> None:
    """While `either` steps, `loop` sends it the next row: its bound must wait for that row."""
    results = []
    for form in ("blocks", "samples"):
        plan = Plan(
            graph(
                s=Given,
                loop=(Loop, {"x": "s.b", "back": "either"}),
                either=(EitherOf, {"x": "loop", "y": "s.a"}),
            )
        )
        sent = tapped(plan, "loop")
        drive(form, plan, block((5, 1.0), (6, 8.0), (8, 15.0)), port=1)
        results.append(rows(sent["loop"]))
    assert results[0] == results[1]
    assert [x for _, x in results[0]] == [3.0, 24.0, 60.0]


def test_a_join_does_not_wait_for_the_silent_port_of_a_node_that_speaks() -> None:
    class Split(lf.Node):
        def step(self, x: Reading) -> Pair | None:
            return Pair(x, None)

    plan = Plan(
        graph(s=Given, split=(Split, {"x": "s.a"}), j=(EitherOf, {"x": "s.a", "y": "split.b"}))
    )
    sent = tapped(plan, "j")
    plan.start()
    driver = SampleDriver(plan)
    for i in range(3):
        driver.push("s", 0, ramp(3).row(i))
        assert len(sent["j"]) == i + 1


def held_back() -> int:
    """Return how many messages something still holds."""
    return sum(type(thing) is Reading for thing in gc.get_objects())


@pytest.mark.parametrize(
    "sync_",
    [lf.Exact(), lf.Nearest("x", 5), lf.Hold("x"), lf.Hold("x", initial={"y": Reading(0, 7.0)})],
)
def test_a_silent_lead_does_not_fill_the_memory(sync_: Any) -> None:
    class Join(lf.Node):
        sync = sync_

        def step(self, x: Reading, y: Reading) -> Reading | None:
            return x.replace(x=y.x)

    plan = Plan(graph(s=Given, n=(Join, {"x": "s.a", "y": "s.b"})))
    sent = tapped(plan, "n")
    plan.start()
    driver = SampleDriver(plan)
    before = held_back()
    for t in range(0, 2000, 2):
        driver.push("s", 1, Reading(t, float(t)))
        driver.promise("s", t + 1)
    assert held_back() <= before + 3
    driver.push("s", 0, Reading(2001, 0.0))
    driver.promise("s", 2100)
    expected = [] if sync_ == lf.Exact() else [(2001, 1998.0)]
    assert rows(sent["n"]) == expected
    driver.promise("s", END)


def test_what_comes_after_the_lead_has_ended_is_let_go() -> None:
    class Join(lf.Node):
        sync = lf.Hold("x")

        def step(self, x: Reading, y: Reading) -> None: ...

    plan = Plan(graph(s=Given, r=Given, n=(Join, {"x": "s.a", "y": "r.a"})))
    plan.start()
    driver = SampleDriver(plan)
    driver.promise("s", END)
    assert driver.unfinished() == []
    before = held_back()
    for t in range(1000):
        driver.push("r", 0, Reading(t, 0.0))
    assert held_back() <= before + 3
