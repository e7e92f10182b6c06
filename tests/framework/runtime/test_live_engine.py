"""The engine with live sources: late samples, errors in their threads, stops, durations."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from typing import Any

import pytest
from runtime_toys import (
    Add,
    Held,
    Reading,
    Sum,
    graph,
    reading,
    rows,
    tapped,
)

import lodeflow as lf
from lodeflow.clock import SimClock, WallClock
from lodeflow.errors import NodeFailure
from lodeflow.runtime.engine import Engine
from lodeflow.runtime.plan import Plan


def test_sources_are_given_the_clock_of_the_run() -> None:
    seen = []

    def look(self: lf.Source, clock: lf.Clock) -> Iterator[Any]:
        seen.append(clock)
        yield Reading(clock.start, 0.0)

    plan = Plan(graph(s=reading(look)))
    engine = Engine(plan)
    engine.run()
    assert isinstance(seen[0], SimClock)
    assert (seen[0].start, seen[0].now()) == (0, 0)
    live = Plan(graph(s=reading(look, max_delay=10**12)))
    Engine(live).run()
    assert isinstance(seen[1], WallClock)
    assert live.nodes["s"].counters.sent == {"out": 1}


def test_a_live_run_ends_with_its_sources_and_loses_nothing() -> None:
    def device(self: lf.Source, clock: lf.Clock) -> Iterator[Any]:
        for i in range(50):
            yield Reading(clock.start + i, float(i))

    live = reading(device, max_delay=3_600_000_000_000)
    plan = Plan(graph(s=live, u=live, sum=(Sum, {"x": "s"}), held=(Held, {"x": "s", "y": "u"})))
    sent = tapped(plan, "s", "sum", "held")
    engine = Engine(plan)
    engine.run()
    assert [x for _, x in rows(sent["s"])] == [float(i) for i in range(50)]
    assert rows(sent["sum"])[-1][1] == sum(range(50))
    assert len(sent["held"]) == 50
    assert plan.lossless
    assert engine.span == 49


def test_samples_of_long_ago_are_late() -> None:
    go = threading.Event()

    def device(self: lf.Source, clock: lf.Clock) -> Iterator[Any]:
        yield Reading(clock.start, 1.0)
        go.wait()
        yield Reading(clock.start - 10**15, 2.0)
        yield Reading(clock.start + 10**12, 3.0)

    plan = Plan(graph(s=reading(device, max_delay=10**12)))
    sent = tapped(plan, "s")
    engine = Engine(plan, watch=lambda t: go.set())
    engine.run()
    assert [x for _, x in rows(sent["s"])] == [1.0, 3.0]
    assert plan.nodes["s"].counters.lost == {"late": 1}
    assert not plan.lossless


def test_an_error_in_the_thread_of_a_source_ends_the_run() -> None:
    def device(self: lf.Source, clock: lf.Clock) -> Iterator[Any]:
        yield Reading(clock.start, 1.0)
        raise OSError("unplugged")

    plan = Plan(graph(s=reading(device, max_delay=10**12), sum=(Sum, {"x": "s"})))
    sent = tapped(plan, "s")
    with pytest.raises(
        NodeFailure, match=r"^node 's' \(Scripted.read\) failed at t=\d+: OSError: "
    ):
        Engine(plan).run()
    assert [x for _, x in rows(sent["s"])] == [1.0]
    assert plan.nodes["s"].counters.sent == {"out": 1}


def test_a_stop_ends_a_live_run_and_loses_nothing_that_had_come() -> None:
    go, come, forever = threading.Event(), threading.Event(), threading.Event()

    def device(self: lf.Source, clock: lf.Clock) -> Iterator[Any]:
        yield Reading(clock.start, 0.0)
        go.wait()
        for i in range(1, 5):
            yield Reading(clock.start + i, float(i))
        come.set()
        forever.wait()

    plan = Plan(graph(s=reading(device, max_delay=10**15), sum=(Sum, {"x": "s"})))
    sent = tapped(plan, "sum")
    engine = Engine(plan)

    def watch(t: int) -> None:
        go.set()
        come.wait()
        engine.stop()

    engine.watch = watch
    try:
        engine.run()
    finally:
        forever.set()
    assert rows(sent["sum"])[-1][1] == 10.0


def test_the_duration_ends_a_live_run() -> None:
    forever = threading.Event()

    def device(self: lf.Source, clock: lf.Clock) -> Iterator[Any]:
        yield Reading(clock.start + 5, 1.0)
        yield Reading(clock.start + 10**15, 2.0)
        forever.wait()

    plan = Plan(graph(s=reading(device, max_delay=0), sum=(Sum, {"x": "s"})))
    sent = tapped(plan, "s")
    try:
        Engine(plan, duration=50_000_000).run()
    finally:
        forever.set()
    assert 2.0 not in [x for _, x in rows(sent["s"])]
    assert plan.nodes["s"].counters.lost.keys() <= {"late"}


def test_files_and_devices_run_together() -> None:
    def device(self: lf.Source, clock: lf.Clock) -> Iterator[Any]:
        for i in range(20):
            yield Reading(clock.start + i, float(i))

    def recorded(self: lf.Source, clock: lf.Clock) -> Iterator[Any]:
        for i in range(20):
            yield Reading(clock.start + i, 100.0)

    plan = Plan(
        graph(
            s=reading(device, max_delay=10**12),
            u=reading(recorded),
            add=(Add, {"x": "s", "y": "u"}),
        )
    )
    sent = tapped(plan, "add")
    Engine(plan).run()
    assert [x for _, x in rows(sent["add"])] == [100.0 + i for i in range(20)]
