"""Paths of a graph, and latencies over them."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np
import pytest

import lodeflow as lf
from lodeflow.graph.model import Gate, Graph, GraphNode, Wire
from lodeflow.runtime.exchange import part_of
from lodeflow.runtime.plan import Plan
from lodeflow.runtime.samples import SampleDriver
from lodeflow.supervisor.meter import Meter, ends, latencies, paths, unpack


class Ports(NamedTuple):
    a: lf.Heading | None
    b: lf.Heading | None


class Two(lf.Source):
    def read(self, clock: lf.Clock) -> Iterator[Ports]:
        yield from ()


class One(lf.Source):
    def read(self, clock: lf.Clock) -> Iterator[lf.Heading]:
        yield from ()


class Copy(lf.Node):
    def step(self, x: lf.Heading) -> lf.Heading:
        return x


class Last(lf.Node):
    def step(self, x: lf.Heading) -> None:
        self.last = x

    def finish(self) -> lf.Heading:
        return self.last


class Sink(lf.Node):
    sync = lf.Each()

    def step(self, x: lf.Heading | None, y: lf.Heading | None) -> None:
        pass


def graph(**nodes: Any) -> Graph:
    built = {}
    for name, (plugin, *inputs) in nodes.items():
        ports = [port.name for port in plugin.spec.inputs]
        wires = [Wire(*text.split(".")) if "." in text else Wire(text, "out") for text in inputs]
        built[name] = GraphNode(
            name, plugin.__name__, plugin, plugin.Params(), dict(zip(ports, wires, strict=True))
        )
    return Graph("g", built)


GRAPH = graph(
    two=(Two,),
    one=(One,),
    copy=(Copy, "two.a"),
    again=(Copy, "copy"),
    last=(Last, "copy"),
    sink=(Sink, "copy", "one"),
)


def test_paths_lead_from_sources_to_streams_nobody_reads_and_to_sinks() -> None:
    assert ends(GRAPH) == {
        "again": Wire("again", "out"),
        "sink.x": Wire("copy", "out"),
        "sink.y": Wire("one", "out"),
    }
    assert paths(GRAPH) == [("two", "again"), ("two", "sink.x"), ("one", "sink.y")]


def test_a_gate_is_part_of_a_path_and_a_cycle_ends() -> None:
    nodes = dict(graph(one=(One,), two=(Two,), a=(Copy, "b"), b=(Copy, "a")).nodes)
    gate = Gate(Wire("two", "a"), "heading", frozenset({1}))
    gated = GraphNode("c", "Copy", Copy, Copy.Params(), {"x": Wire("one", "out")}, (gate,))
    assert paths(Graph("g", {**nodes, "c": gated})) == [("one", "c"), ("two", "c")]


def test_latencies_match_stamps() -> None:
    source = np.array([[0, 1000], [10, 1010], [20, 1020], [20, 1021]])
    end = np.array([[0, 1003], [10, 1014], [20, 1040]])
    assert latencies(source, end).tolist() == [3, 4, 20]


def test_a_stamp_that_is_not_the_sources_counts_from_its_last_message() -> None:
    source = np.array([[0, 1000], [100, 1100]])
    end = np.array([[-5, 1000], [30, 1037], [99, 1100], [130, 1131]])
    assert latencies(source, end).tolist() == [7, 1, 1]


@pytest.mark.parametrize("empty", ["source", "end"])
def test_nothing_measured_is_no_latency(empty: str) -> None:
    none, some = np.empty((0, 2), dtype=np.int64), np.array([[1, 2]])
    assert not len(latencies(*((none, some) if empty == "source" else (some, none))))


def push(driver: SampleDriver, t: int) -> None:
    driver.push("one", 0, lf.Heading(t, 0.0))


def test_only_what_is_asked_for_is_measured(monkeypatch: pytest.MonkeyPatch) -> None:
    now = [100.0]
    monkeypatch.setattr("lodeflow.supervisor.meter.monotonic", lambda: now[0])
    whole = graph(one=(One,), copy=(Copy, "one"))
    plan = Plan(whole)
    plan.start()
    driver = SampleDriver(plan)
    meter = Meter(whole, plan)
    meter.tend(driver)
    assert not any(plan.taps.values())
    assert len(unpack(meter.passings(1.0)["ends"]["copy"])) == 0
    meter.tend(driver)
    for t in range(5):
        push(driver, t)
    found = meter.passings(60.0)
    source, end = unpack(found["sources"]["one"]), unpack(found["ends"]["copy"])
    assert source[:, 0].tolist() == end[:, 0].tolist() == [0, 1, 2, 3, 4]
    assert (latencies(source, end) >= 0).all()
    now[0] += 6.0
    meter.tend(driver)
    assert not any(plan.taps.values())
    push(driver, 5)
    assert len(unpack(meter.passings(60.0)["ends"]["copy"])) == 0


def test_what_ends_in_a_sink_is_measured_in_the_process_of_the_sink() -> None:
    whole = graph(one=(One,), sink=(Sink, "one", "one"))
    sender = Plan(part_of(whole, ["one"], {}))
    reader = Plan(part_of(whole, ["sink"], {Wire("one", "out"): "sender"}))
    assert Meter(whole, sender).passings(1.0).keys() == {"sources", "ends"}
    assert list(Meter(whole, sender).passings(1.0)["sources"]) == ["one"]
    assert not Meter(whole, sender).passings(1.0)["ends"]
    meter = Meter(whole, reader)
    meter.passings(1.0)
    reader.start()
    driver = SampleDriver(reader)
    meter.tend(driver)
    push(driver, 3)
    assert unpack(meter.passings(60.0)["ends"]["sink.x"])[:, 0].tolist() == [3]
    assert meter.passings(60.0)["sources"] == {}
