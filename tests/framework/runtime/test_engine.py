"""The engine: whole runs with either driver, stopping, pacing, and live sources."""

from __future__ import annotations

import random
from collections.abc import Iterator
from typing import Any

import pytest
from runtime_toys import (
    Add,
    Copy,
    Held,
    Pair,
    Reading,
    Sum,
    block,
    graph,
    ramp,
    reading,
    rows,
    source,
    tapped,
)

import lodeflow as lf
from lodeflow.errors import ContractError, NodeFailure, RunError
from lodeflow.graph.model import Graph
from lodeflow.messages.cdr import layout_of
from lodeflow.runtime.engine import Engine
from lodeflow.runtime.gathering import ROWS
from lodeflow.runtime.plan import Plan

FAST = 1e9
"""A speed at which pacing costs no time."""


class Scale(lf.Node):
    def step_block(self, x: Reading) -> Reading | None:
        keep = x.x % 2 < 1
        return Reading(x.t[keep], x.x[keep] * 2.5)


class Near(lf.Node):
    sync = lf.Nearest("y", within=4)
    lookback = 2

    def step(self, x: Reading, y: Reading) -> Reading | None:
        return y.replace(t=y.t - 2, x=x.x - y.x)


def mixed(*first: Any) -> Graph:
    rng = random.Random(3)
    stamps = sorted(rng.sample(range(400), 120))
    slow = block(*[(t * 1000, rng.random()) for t in stamps])
    second = [Pair(slow[i : i + 17], slow[i : i + 17 : 3]) for i in range(0, 120, 17)]
    return graph(
        fast=source(*first),
        pair=source(*second, pair=True),
        sum=(Sum, {"x": "fast"}),
        scale=(Scale, {"x": "pair.a"}),
        held=(Held, {"x": "scale", "y": "sum"}),
        near=(Near, {"x": "pair.b", "y": "held"}),
        add=(Add, {"x": "near", "y": "near"}),
    )


def run(graph: Graph, **options: Any) -> tuple[dict[str, bytes], dict[str, Any], Engine]:
    """Return the bytes of each stream, the counters, and the engine of a run."""
    plan = Plan(graph)
    streams: dict[str, bytes] = {}
    for wire in graph.streams():
        streams[str(wire)] = b""

        def tap(message: Any, name: str = str(wire)) -> None:
            many = message if message.is_block else message.as_block()
            streams[name] += layout_of(type(many)).encode_block(many).tobytes()

        plan.tap(wire, tap)
    engine = Engine(plan, **options)
    engine.run()
    return streams, {name: node.counters for name, node in plan.nodes.items()}, engine


def test_paced_samples_and_blocks_give_the_same_bytes_and_counts() -> None:
    whole = ramp(300, 1000)
    graphs = [
        mixed(whole),
        mixed(*[whole[i : i + 7] for i in range(0, 300, 7)]),
        mixed(*[whole.row(i) for i in range(300)]),
    ]
    runs = [run(g, **options) for g in graphs for options in ({}, {"speed": FAST})]
    streams, counters, engine = runs[0]
    assert all(streams.values())
    for other, other_counters, other_engine in runs[1:]:
        assert other == streams
        assert other_counters == counters
        assert (other_engine.first, other_engine.span) == (engine.first, engine.span)


@pytest.mark.parametrize("options", [{}, {"speed": FAST}])
@pytest.mark.parametrize("bad", [0, 5])
def test_dropped_rows_are_the_same_with_either_driver(options: dict[str, Any], bad: int) -> None:
    rows_ = [(0, 1.0), (2, float("nan")), (1, 2.0), (1, 3.0), (4, 4.0), (3, 5.0), (5, 6.0)]
    items = [block(row).row(0) for row in rows_[:bad]] + [block(*rows_[bad:])]
    plan = Plan(graph(s=source(*items), copy=(Copy, {"x": "s"})))
    sent = tapped(plan, "copy")
    Engine(plan, **options).run()
    assert rows(sent["copy"]) == [(0, 1.0), (1, 2.0), (4, 4.0), (5, 6.0)]
    assert plan.nodes["s"].counters.lost == {"nonfinite": 1, "disorder": 2}
    assert plan.nodes["s"].counters.sent == {"out": 4}
    assert not plan.lossless


both = pytest.mark.parametrize("options", [{}, {"speed": FAST}], ids=["blocks", "samples"])


@both
def test_the_duration_counts_from_the_start_and_leaves_its_end_out(options: Any) -> None:
    plan = Plan(graph(s=source(ramp(10), ramp(20)[10:]), sum=(Sum, {"x": "s"})))
    sent = tapped(plan, "s", "sum")
    engine = Engine(plan, duration=7, **options)
    engine.run()
    assert [t for t, _ in rows(sent["s"])] == list(range(7))
    assert rows(sent["sum"])[-1] == (7, 21.0)
    assert engine.span == 6


@both
def test_a_run_without_data_ends(options: Any) -> None:
    plan = Plan(graph(s=source(), sum=(Sum, {"x": "s"}), add=(Add, {"x": "s", "y": "sum"})))
    engine = Engine(plan, **options)
    engine.run()
    assert engine.span == 0
    Engine(Plan(graph()), **options).run()


@both
def test_stopping_ends_the_sources_and_lets_the_nodes_finish(options: Any) -> None:
    def endless(self: lf.Source, clock: lf.Clock) -> Iterator[Any]:
        t = 0
        while True:
            yield Reading(t, 1.0)
            t += 1

    plan = Plan(graph(s=reading(endless), u=source(ramp(3)), sum=(Sum, {"x": "s"})))
    sent = tapped(plan, "s", "sum")

    def watch(t: int) -> None:
        if t >= 20:
            engine.stop()

    engine = Engine(plan, watch=watch, **options)
    engine.run()
    count = len(rows(sent["s"]))
    assert 20 <= count <= (23 if options else 20 + ROWS)  # blocks are gathered
    assert rows(sent["sum"])[-1][1] == count


def test_samples_stop_between_two_stamps() -> None:
    class Stopping(Copy):
        def step(self, x: Reading) -> Reading:
            if x.t == 5:
                engine.stop()
            return x

    plan = Plan(graph(s=source(ramp(100)), copy=(Stopping, {"x": "s"})))
    sent = tapped(plan, "copy")
    engine = Engine(plan, speed=1e9)
    engine.run()
    assert [t for t, _ in rows(sent["copy"])] == [0, 1, 2, 3, 4, 5]


@both
def test_a_stop_before_the_run_runs_no_data(options: Any) -> None:
    plan = Plan(graph(s=source(ramp(3)), sum=(Sum, {"x": "s"})))
    sent = tapped(plan, "s", "sum")
    engine = Engine(plan, **options)
    engine.stop()
    engine.run()
    assert sent == {"s": [], "sum": []}


@both
def test_watch_hears_of_the_time_reached_and_may_end_the_run(options: Any) -> None:
    closed = []

    def guarded(self: lf.Source, clock: lf.Clock) -> Iterator[Any]:
        try:
            for i in range(10):
                yield Reading(i, 0.0)
        finally:
            closed.append(True)

    heard = []

    def watch(t: int) -> None:
        heard.append(t)
        if t >= 4:
            raise KeyboardInterrupt

    plan = Plan(graph(s=reading(guarded), copy=(Copy, {"x": "s"})))
    with pytest.raises(KeyboardInterrupt):
        Engine(plan, watch=watch, **options).run()
    assert heard == sorted(heard)
    assert heard[-1] == (4 if options else 9)  # blocks are gathered
    assert closed == [True]
    assert plan.nodes["copy"].counters.sent["out"] >= 4


@both
def test_a_failure_ends_the_run_and_closes_the_other_sources(options: Any) -> None:
    closed = []

    def guarded(self: lf.Source, clock: lf.Clock) -> Iterator[Any]:
        try:
            yield ramp(4)
            yield ramp(9)[4:]
        finally:
            closed.append(True)

    plan = Plan(graph(s=reading(guarded), u=source(ramp(2), OSError("unplugged"))))
    with pytest.raises(NodeFailure, match=r"^node 'u' \(Scripted.read\) failed at t=1: OSError: u"):
        Engine(plan, **options).run()
    assert closed == [True]


@both
def test_a_source_that_breaks_its_contract_ends_the_run(options: Any) -> None:
    with pytest.raises(ContractError, match="it must send Reading, got str"):
        Engine(Plan(graph(s=source("text"))), **options).run()


@pytest.mark.parametrize("speed", [0, -1.0, float("nan")])
def test_a_speed_is_above_zero(speed: float) -> None:
    with pytest.raises(RunError, match=f"^the speed must be above 0, not {speed}$"):
        Engine(Plan(graph()), speed=speed)


def test_a_duration_is_not_negative() -> None:
    with pytest.raises(RunError, match=r"^the duration must not be negative, got -5 ns$"):
        Engine(Plan(graph()), duration=-5)


def test_pacing_holds_no_message_back_until_the_next_one() -> None:
    """Between two stamps an hour apart the first is out, though the second is not due."""
    plan = Plan(graph(s=source(block((0, 1.0), (3_600_000_000_000, 2.0))), sum=(Sum, {"x": "s"})))
    sent = tapped(plan, "sum")
    seen = []

    def watch(t: int) -> None:
        seen.append(rows(sent["sum"]))
        if len(seen) == 2:
            engine.stop()

    engine = Engine(plan, speed=1.0, watch=watch)
    engine.run()
    assert seen == [[], [(0, 1.0)]]
    assert plan.nodes["s"].counters.sent == {"out": 1}


def test_what_a_paced_source_gave_before_it_failed_goes_on_its_way() -> None:
    """What follows the last stamp is read once that has been sent."""
    step = 5_000_000
    plan = Plan(graph(s=source(ramp(3, step), OSError("unplugged")), copy=(Copy, {"x": "s"})))
    sent = tapped(plan, "copy")
    with pytest.raises(NodeFailure, match=f"failed at t={2 * step}: OSError: unplugged"):
        Engine(plan, speed=1.0).run()
    assert rows(sent["copy"]) == [(0, 0.0), (step, 1.0), (2 * step, 2.0)]
