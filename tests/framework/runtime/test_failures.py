"""What is said of a plugin that raises, wherever it does."""

from __future__ import annotations

from pathlib import Path

import pytest
from runtime_toys import Copy, Reading, graph, ramp, rows, source, tapped

import lodeflow as lf
from lodeflow.errors import NodeFailure
from lodeflow.runtime.engine import Engine
from lodeflow.runtime.plan import Plan


def test_a_failure_names_the_line_in_the_plugins_file() -> None:
    class Wrong(lf.Node):
        def step(self, x: Reading) -> Reading:
            return self.helper(x)

        def helper(self, x: Reading) -> Reading:
            raise ValueError("boom")

    with pytest.raises(NodeFailure, match=rf"ValueError: boom \({Path(__file__).name}:\d+\)$"):
        Engine(Plan(graph(s=source(ramp(3)), wrong=(Wrong, {"x": "s"})))).run()


def test_an_exit_or_a_failing_constructor_is_a_failure_like_others() -> None:
    class Exits(lf.Node):
        def step(self, x: Reading) -> Reading:
            raise SystemExit(7)

    class Unbuilt(lf.Node):
        def __init__(self, *args: object, **named: object) -> None:
            raise OSError("no device")

        def step(self, x: Reading) -> Reading:
            return x

    with pytest.raises(
        NodeFailure, match=r"'n' \(Exits.step\) failed at t=0 on x=s: SystemExit: 7"
    ):
        Engine(Plan(graph(s=source(ramp(3)), n=(Exits, {"x": "s"})))).run()
    with pytest.raises(NodeFailure, match=r"\(Unbuilt.__init__\) failed before its first message"):
        Plan(graph(s=source(ramp(3)), n=(Unbuilt, {"x": "s"})))


@pytest.mark.parametrize("wrong", ["raises", "another type", "a stamp that goes back"])
@pytest.mark.parametrize("speed", [None, 1e9])
def test_what_a_node_sent_before_it_failed_went_on_its_way(wrong: str, speed: float | None) -> None:
    """Live each row is out before the next one comes; a block must not take them along."""

    class Fails(lf.Node):
        def step(self, x: Reading) -> Reading | None:
            if x.t < 6:
                return x
            if wrong == "raises":
                raise ArithmeticError("six")
            return x.replace(t=2) if wrong == "a stamp that goes back" else x.t  # type: ignore

    plan = Plan(graph(s=source(ramp(10)), fails=(Fails, {"x": "s"}), behind=(Copy, {"x": "fails"})))
    sent = tapped(plan, "s", "fails", "behind")
    with pytest.raises(lf.LodeflowError, match="'fails'"):
        Engine(plan, speed=speed).run()
    assert rows(sent["fails"]) == rows(sent["behind"]) == [(t, float(t)) for t in range(6)]
    assert plan.nodes["fails"].counters.stepped == 7
    assert plan.nodes["behind"].counters.stepped == 6
