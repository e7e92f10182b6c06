"""What is said of a plugin that raises, wherever it does."""

from __future__ import annotations

from pathlib import Path

import pytest
from runtime_toys import Reading, graph, ramp, source

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
