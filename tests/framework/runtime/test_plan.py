"""Plan: order, cycles, taps, and what counts as a loss."""

from __future__ import annotations

from dataclasses import replace

import pytest
from runtime_toys import Add, Copy, Given, Reading, graph, source, wire

import lodeflow as lf
from lodeflow.errors import ContractError
from lodeflow.graph.model import Graph
from lodeflow.node import OutputPort
from lodeflow.runtime.plan import Counters, Plan, PlanNode


class Ending(lf.Node):
    lookback = 5

    def step(self, x: Reading) -> Reading | None: ...

    def finish(self) -> Reading | None: ...


def test_nodes_come_after_what_they_read() -> None:
    plan = Plan(graph(last=(Copy, {"x": "mid"}), mid=(Copy, {"x": "s.a"}), t=source(), s=Given))
    names = list(plan.nodes)
    assert names.index("s") < names.index("mid") < names.index("last")
    assert [node.name for node in plan.sources] == ["t", "s"]
    assert list(plan.taps) == [wire(n) for n in ("last", "mid", "t", "s.a", "s.b")]


def test_a_cycle_without_delay_is_refused() -> None:
    with pytest.raises(ContractError) as found:
        Plan(graph(s=Given, a=(Add, {"x": "s.a", "y": "b"}), b=(Copy, {"x": "a"})))
    assert str(found.value) == "nodes on a cycle that no delayed Hold closes: a, b"


def test_a_node_of_a_plan() -> None:
    class Held(lf.Node):
        sync = lf.Hold("y")

        def step(self, y: Reading, x: Reading = None) -> None: ...

    wired = PlanNode(graph(n=(Held, {"x": "s.a", "y": "s.b"})).nodes["n"])
    assert (wired.lead, wired.sync) == ("y", lf.Hold("y"))
    alone = PlanNode(graph(n=(Held, {"y": "s.b"})).nodes["n"])
    assert (alone.lead, alone.sync) == ("y", None)
    assert [port.name for port in alone.wired] == ["y"]
    assert alone.plugin.name == "n"


def test_which_ports_follow_the_bounds_of_the_inputs() -> None:
    free = PlanNode(graph(n=(Copy, {"x": "s.a"})).nodes["n"])
    (port,) = free.spec.outputs
    assert free.promises_freely(port)
    assert free.bound_after(port, 10) == 11
    tied = PlanNode(graph(n=(Ending, {"x": "s.a"})).nodes["n"])
    (port,) = tied.spec.outputs
    assert not tied.promises_freely(port)
    assert tied.bound_after(port, 10) == 5
    assert tied.bound_after(OutputPort("out", Reading, True, False), 10) == 6
    assert not tied.promises_freely(OutputPort("out", Reading, True, False))


def test_losses_that_the_graph_allows_are_none() -> None:
    made = graph(s=Given, t=source())
    allowed = replace(made.nodes["s"], allow=frozenset({"late"}))
    plan = Plan(Graph("test", {**made.nodes, "s": allowed}))
    assert plan.lossless
    plan.nodes["s"].counters.lose("late", 3)
    plan.nodes["t"].counters.lose("late", 0)
    assert plan.lossless
    plan.nodes["s"].counters.lose("overflow")
    assert not plan.lossless
    assert plan.nodes["s"].counters.lost == {"late": 3, "overflow": 1}


def test_losses_add_up() -> None:
    counters = Counters()
    counters.lose("late", 2)
    counters.lose("late")
    counters.lose("disorder", 0)
    assert counters.lost == {"late": 3}
