"""Both drivers: broken contracts, failures, counters, taps and last words."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
import pytest
from runtime_toys import (
    Add,
    Copy,
    Given,
    Pair,
    Reading,
    block,
    drive,
    graph,
    ramp,
    rows,
    tapped,
    wire,
)

import lodeflow as lf
from lodeflow.errors import ContractError, NodeFailure
from lodeflow.graph.model import Gate, Graph, GraphNode
from lodeflow.runtime.blocks import BlockDriver
from lodeflow.runtime.plan import Plan
from lodeflow.runtime.samples import SampleDriver
from lodeflow.sync import END

both = pytest.mark.parametrize("form", ["blocks", "samples"])


class Total(NamedTuple):
    total: Reading | None


def stepping(step: Callable[[Any], Any], *, hears: bool = False, **more: Any) -> Plan:
    """Return a plan of a source and a node "n" with this step."""

    class Node(lf.Node):
        lookback = more.get("lookback", 0)

        def step(self, x: Reading) -> Reading | None:
            return step(x)

    return plan_of(Node, hears=hears)


def block_stepping(step: Callable[[Any], Any]) -> Plan:
    class Node(lf.Node):
        def step_block(self, x: Reading) -> Reading | None:
            return step(x)

    return plan_of(Node)


def plan_of(node: type[lf.Node], *, hears: bool = False) -> Plan:
    nodes: dict[str, Any] = {"s": Given, "n": (node, {"x": "s.a"})}
    if hears:  # a join behind it makes the sample driver pass bounds
        nodes["join"] = (Add, {"x": "n", "y": "s.a"})
    return Plan(graph(**nodes))


def broken(form: str, plan: Plan, data: Any = None) -> str:
    with pytest.raises(ContractError) as found:
        drive(form, plan, ramp(3) if data is None else data)
    text = str(found.value)
    start = "node 'n' (Node) broke the contract of port "
    assert text.startswith(start), text
    return text.removeprefix(start)


@both
@pytest.mark.parametrize("hears", [False, True])
@pytest.mark.parametrize("first", [True, False])
@pytest.mark.parametrize(
    ("bad", "text"),
    [
        (lambda x: 3.5, "'out': it must send Reading, got float"),
        (lambda x: lf.Heading(x.t, 1.0), "'out': it must send Reading, got Heading"),
        (lambda x: [x, x], "'out': it must send Reading, got list"),
        (lambda x: (x,), "'out': it must send Reading, got tuple"),
        (lambda x: x.as_block(), "'out': a sample step must send samples, got a block"),
        (
            lambda x: x.replace(t=np.int64(x.t)),
            "'out': Reading.t must be an int in nanoseconds, or an int64 array for a block, got "
            "np.int64(2) (int64)",
        ),
        (
            lambda x: x.replace(t=x.t - 1),
            "'out': stamp 1 lies before its row minus the lookback of 0 ns",
        ),
    ],
)
def test_a_wrong_sample_is_refused_first_and_later(
    form: str, hears: bool, first: bool, bad: Callable[[Any], Any], text: str
) -> None:
    def step(x: Any) -> Any:
        return bad(x) if x.t == 2 else None if first else x

    assert broken(form, stepping(step, hears=hears)) == text


@both
@pytest.mark.parametrize("hears", [False, True])
def test_stamps_must_strictly_increase(form: str, hears: bool) -> None:
    plan = stepping(lambda x: x.replace(t=5), hears=hears)
    assert broken(form, plan) == "'out': stamps must strictly increase, got 5 where 6 is the least"


@both
def test_stamps_must_strictly_increase_in_a_block_too(form: str) -> None:
    plan = block_stepping(lambda x: block((9, 1.0), (7, 2.0)))
    assert broken(form, plan) == "'out': stamps must strictly increase, got 7 where 10 is the least"


def test_stamps_must_strictly_increase_between_blocks() -> None:
    plan = block_stepping(lambda x: block((9, 1.0)))
    plan.start()
    driver = BlockDriver(plan)
    driver.push("s", [(0, ramp(1))], 1)
    with pytest.raises(ContractError, match="got 9 where 10 is the least"):
        driver.push("s", [(0, block((1, 0.0)))], 2)


@both
def test_the_lookback_is_in_the_text(form: str) -> None:
    plan = stepping(lambda x: x.replace(t=x.t - 4), lookback=3)
    assert broken(form, plan) == "'out': stamp -4 lies before its row minus the lookback of 3 ns"
    good = stepping(lambda x: x.replace(t=x.t - 3), lookback=3)
    sent = tapped(good, "n")
    drive(form, good, ramp(3))
    assert [t for t, _ in rows(sent["n"])] == [-3, -2, -1]


@both
def test_a_block_step_sends_blocks(form: str) -> None:
    assert broken(form, block_stepping(lambda x: x.row(0))) == (
        "'out': a block step must send blocks, got a sample"
    )
    assert broken(form, block_stepping(lambda x: 7)) == "'out': it must send Reading, got int"


@both
def test_a_node_without_output_sends_nothing(form: str) -> None:
    class Node(lf.Node):
        def step(self, x: Reading) -> None:
            return x

    assert broken(form, plan_of(Node)) == (
        "'(none)': it must return these ports, got (Reading(t=0, x=0.0),)"
    )


@both
def test_several_ports_are_all_returned(form: str) -> None:
    class Node(lf.Node):
        def step(self, x: Reading) -> Pair | None:
            return x if x.t == 2 else Pair(x, None)

    assert broken(form, plan_of(Node)) == (
        "'a, b': it must return these ports, got Reading(t=2, x=2.0)"
    )


@both
@pytest.mark.parametrize(
    ("last", "text"),
    [
        (7, "'out': finish returned 7"),
        (lf.Heading(9, 1.0), "'out': it must send Reading, got Heading"),
        (Pair(None, None), "'out': finish returned Pair(a=None, b=None)"),
        (Reading(1, 0.0), "'out': stamp 1 lies before its row minus the lookback of 0 ns"),
    ],
)
def test_wrong_last_words(form: str, last: Any, text: str) -> None:
    class Node(lf.Node):
        def step(self, x: Reading) -> None: ...

        def finish(self) -> Reading | None:
            return last

    assert broken(form, plan_of(Node)) == text


@both
def test_last_words_after_the_last_sample(form: str) -> None:
    class Node(lf.Node):
        def step(self, x: Reading) -> Reading | None:
            return x

        def finish(self) -> Reading | None:
            return Reading(2, 9.0)

    assert broken(form, plan_of(Node)) == (
        "'out': stamps must strictly increase, got 2 where 3 is the least"
    )


@both
def test_a_value_that_does_not_fit_its_field_is_not_cut(form: str) -> None:
    class Node(lf.Node):
        def step(self, x: Reading) -> lf.Mode | None:
            return lf.Mode(x.t, 1 if x.t < 2 else 1.5)

    plan = plan_of(Node)
    if form == "blocks":
        assert broken(form, plan) == "'out': Mode.mode: not every sample has int64 of shape ()"
    else:
        sent = tapped(plan, "n")
        drive(form, plan, ramp(3))
        assert [m.mode for m in sent["n"]] == [1, 1, 1.5]  # the encoder refuses it


def failure(form: str, plan: Plan) -> str:
    with pytest.raises(NodeFailure) as found:
        drive(form, plan, ramp(3))
    assert isinstance(found.value.__cause__, ZeroDivisionError)
    return str(found.value)


def fail(x: Any) -> Any:
    return 1 // 0


ZERO = "ZeroDivisionError: integer division or modulo by zero"


@both
def test_a_failing_step_is_named_with_its_stamp_and_inputs(form: str) -> None:
    plan = stepping(lambda x: fail(x) if x.t == 2 else x)
    assert failure(form, plan) == f"node 'n' (Node.step) failed at t=2 on x=s.a: {ZERO}"
    assert plan.nodes["n"].counters.stepped >= 3


def test_a_failing_block_step_is_named_with_its_span() -> None:
    text = f"node 'n' (Node.step_block) failed at t=0..2 on x=s.a: {ZERO}"
    assert failure("blocks", block_stepping(fail)) == text
    one = block_stepping(fail)
    with pytest.raises(NodeFailure, match=r"failed at t=4 on x=s\.a"):
        drive("blocks", one, block((4, 0.0)))


def test_a_failing_block_step_in_the_sample_driver() -> None:
    text = failure("samples", block_stepping(fail))
    assert text.startswith("node 'n' (Node.step")
    assert text.endswith(f") failed at t=0 on x=s.a: {ZERO}")


@both
def test_a_failing_start_and_finish(form: str) -> None:
    class Start(lf.Node):
        def start(self) -> None:
            fail(None)

        def step(self, x: Reading) -> None: ...

    assert failure(form, plan_of(Start)) == (
        f"node 'n' (Start.start) failed before its first message on x=s.a: {ZERO}"
    )

    class Finish(lf.Node):
        def step(self, x: Reading) -> None: ...

        def finish(self) -> None:
            fail(None)

    assert failure(form, plan_of(Finish)) == (
        f"node 'n' (Finish.finish) failed at t=2 on x=s.a: {ZERO}"
    )
    with pytest.raises(NodeFailure, match=r"\(Finish.finish\) failed before its first message on"):
        drive(form, plan_of(Finish), Reading.empty())


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
    (join,) = [a.__closure__ for a in driver.nodes["n"].accept[:1]]
    queues = next(c.cell_contents for c in join if hasattr(c.cell_contents, "__self__"))
    queues = queues.__self__.queues
    for t in range(0, 2000, 2):
        driver.push("s", 1, Reading(t, float(t)))
        driver.promise("s", t + 1)
        assert sum(map(len, queues)) <= 2
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
    held = driver.nodes["n"].advance[1]
    queues = next(
        c.cell_contents.__self__.queues
        for c in held.__closure__
        if hasattr(c.cell_contents, "__self__")
    )
    for t in range(100):
        driver.push("r", 0, Reading(t, 0.0))
        assert sum(map(len, queues)) == 0
