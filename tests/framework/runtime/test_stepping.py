"""The call that is written for a node of the sample driver."""

from typing import NamedTuple

import pytest
from runtime_toys import Add, Copy, Given, Pair, Reading, drive, graph, ramp, rows, tapped

import lodeflow as lf
from lodeflow.errors import ContractError, NodeFailure
from lodeflow.runtime.plan import Plan
from lodeflow.runtime.samples import SampleDriver
from lodeflow.sync import END


class Three(NamedTuple):
    a: Reading | None
    b: Reading | None
    c: Reading | None


class Spread(lf.Node):
    """Sends on one port after the other."""

    def step(self, x: Reading) -> Three | None:
        on = [x if x.t % 4 == k else None for k in range(3)]
        return Three(*on) if any(on) else None


def test_what_is_none_is_not_sent_and_nodes_of_one_form_do_not_mix() -> None:
    plan = Plan(
        graph(
            s=Given,
            n=(Spread, {"x": "s.a"}),
            m=(Spread, {"x": "n.a"}),
            k=(Copy, {"x": "n.b"}),
            j=(Copy, {"x": "n.c"}),
        )
    )
    sent = tapped(plan, "n.a", "n.b", "n.c", "m.a", "m.b", "k", "j")
    driver = drive("samples", plan, ramp(9))
    a, b, c = [(0, 0.0), (4, 4.0), (8, 8.0)], [(1, 1.0), (5, 5.0)], [(2, 2.0), (6, 6.0)]
    assert {name: rows(messages) for name, messages in sent.items()} == {
        "n.a": a,
        "n.b": b,
        "n.c": c,
        "m.a": a,
        "m.b": [],
        "k": b,
        "j": c,
    }
    assert plan.nodes["n"].counters.sent == {"a": 3, "b": 2, "c": 2}
    assert [plan.nodes[name].counters.stepped for name in "nmkj"] == [9, 3, 2, 2]
    assert driver.unfinished() == []


@pytest.mark.parametrize("first", ["named", "plain"])
def test_a_plain_tuple_is_counted_each_time(first: str) -> None:
    class Node(lf.Node):
        def step(self, x: Reading) -> Pair | None:
            if x.t < 2:
                return Pair(x, None) if first == "named" else (x, None)
            return (x, None, None)

    plan = Plan(graph(s=Given, n=(Node, {"x": "s.a"})))
    with pytest.raises(ContractError, match=r"'a, b': it must return these ports, got \(Reading"):
        drive("samples", plan, ramp(3))
    assert plan.nodes["n"].counters.stepped == 3


class Quiet(lf.Node):
    """Sends one in three; its reader has to learn that nothing came."""

    def step(self, x: Reading) -> Pair | None:
        return None if x.t % 3 else Pair(None, x)


def test_who_waits_for_bounds_learns_of_what_is_not_sent() -> None:
    plan = Plan(graph(s=Given, n=(Quiet, {"x": "s.a"}), join=(Add, {"x": "s.a", "y": "n.b"})))
    sent = tapped(plan, "join")
    plan.start()
    driver = SampleDriver(plan)
    waiting = []
    for i in range(7):
        driver.push("s", 0, ramp(7).row(i))
        waiting.append(driver.waiting()["join"])
    driver.promise("s", END)
    assert waiting == [0] * 7  # no row waits for a partner that does not come
    assert rows(sent["join"]) == [(0, 0.0), (3, 6.0), (6, 12.0)]


def test_an_error_of_a_reader_is_not_taken_for_one_of_the_sender() -> None:
    class Fails(lf.Node):
        def step(self, x: Reading) -> Reading | None:
            return 1 // 0

    plan = Plan(graph(s=Given, n=(Copy, {"x": "s.a"}), m=(Fails, {"x": "n"})))
    with pytest.raises(NodeFailure, match="node 'm'") as found:
        drive("samples", plan, ramp(2))
    assert "'n'" not in str(found.value)
