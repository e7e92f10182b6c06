"""A message, small plugins, and graphs of them, for the tests of the runtime."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

import lodeflow as lf
from lodeflow.graph.model import Graph, GraphNode, Wire
from lodeflow.messages.message import Message
from lodeflow.runtime.blocks import BlockDriver
from lodeflow.runtime.plan import Plan
from lodeflow.runtime.samples import SampleDriver
from lodeflow.sync import END


class Reading(Message, ros="lodeflow_runtime_test/msg/Reading"):
    """A number."""

    x: lf.Scalar


class Pair(NamedTuple):
    a: Reading | None
    b: Reading | None


class Copy(lf.Node):
    """Sends what it gets."""

    def step(self, x: Reading) -> Reading | None:
        return x


class Add(lf.Node):
    sync = lf.Exact()

    def step(self, x: Reading, y: Reading) -> Reading | None:
        return Reading(x.t, x.x + y.x)


def block(*rows: tuple[int, float]) -> Reading:
    return Reading(
        np.array([t for t, _ in rows], dtype=np.int64),
        np.array([x for _, x in rows], dtype=np.float64),
    )


def ramp(n: int, step: int = 1) -> Reading:
    return block(*[(i * step, float(i)) for i in range(n)])


def rows(messages: Sequence[Any]) -> list[tuple[int, float]]:
    """Return (t, x) of samples and blocks alike."""
    found = []
    for message in messages:
        many = message if message.is_block else message.as_block()
        found += list(zip(many.t.tolist(), many.x.tolist(), strict=True))
    return found


def source(*items: Any, pair: bool = False, max_delay: int | None = None) -> type[lf.Source]:
    """Return a source that yields `items`; an exception among them is raised."""

    def play(self: lf.Source, clock: lf.Clock) -> Iterator[Any]:
        for item in items:
            if isinstance(item, BaseException):
                raise item
            yield item

    return reading(play, pair=pair, max_delay=max_delay)


def reading(read: Any, *, pair: bool = False, max_delay: int | None = None) -> type[lf.Source]:
    """Return a source with this `read`."""
    read.__annotations__["return"] = Iterator[Pair if pair else Reading]
    return type("Scripted", (lf.Source,), {"read": read, "max_delay": max_delay})


def graph(**nodes: Any) -> Graph:
    """Return a graph of `name=plugin` and `name=(plugin, {input: "node.port"})`."""
    built = {}
    for name, given in nodes.items():
        plugin, inputs = given if isinstance(given, tuple) else (given, {})
        built[name] = GraphNode(name, plugin.__name__, plugin, plugin.Params(), wires(inputs))
    return Graph("test", built)


def wires(inputs: Mapping[str, str]) -> dict[str, Wire]:
    return {port: wire(text) for port, text in inputs.items()}


def wire(text: str) -> Wire:
    node, _, port = text.partition(".")
    return Wire(node, port or "out")


def tapped(plan: Plan, *names: str) -> dict[str, list[Any]]:
    """Return lists that fill with the messages of streams while the plan runs."""
    sent: dict[str, list[Any]] = {name: [] for name in names}
    for name, into in sent.items():
        plan.tap(wire(name), into.append)
    return sent


class Given(lf.Source):
    """Stands for data that a test pushes itself."""

    def read(self, clock: lf.Clock) -> Iterator[Pair]:
        yield from ()


def drive(form: str, plan: Plan, data: Reading, port: int = 0) -> Any:
    """Push a block through port `a` of the source "s", in one of the two drivers, and end it."""
    plan.start()
    if form == "blocks":
        driver: Any = BlockDriver(plan)
        driver.push("s", [(port, data)] if len(data) else [], END)
    else:
        driver = SampleDriver(plan)
        for i in range(len(data)):
            driver.push("s", port, data.row(i))
        driver.promise("s", END)
        driver.count()
    return driver


class Sum(lf.Node):
    def start(self) -> None:
        self.sum, self.t = 0.0, None

    def step(self, x: Reading) -> Reading | None:
        self.sum += x.x
        self.t = x.t
        return None if x.t % 3 else x.replace(x=self.sum)

    def finish(self) -> Reading | None:
        return None if self.t is None else Reading(self.t + 1, self.sum)


class Held(lf.Node):
    sync = lf.Hold("x", initial={"y": Reading(0, -1.0)})

    def step(self, x: Reading, y: Reading) -> Reading | None:
        return x.replace(x=x.x / 3 + y.x * y.t)


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


def fail(x: Any) -> Any:
    return 1 // 0


def told(error: BaseException) -> str:
    """Return an error's text without the line at which a toy raised."""
    return re.sub(r" \([\w.]+:\d+\)$", "", str(error))
