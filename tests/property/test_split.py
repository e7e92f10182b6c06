"""Each stream's bytes do not depend on how a graph is split into groups that Zenoh links."""

from __future__ import annotations

import random
import tempfile
import threading
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from graphs import START, Case, Streams, cases, collect, counts, run_blocks, with_sources
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from lodeflow.graph.model import Graph, Group, Wire
from lodeflow.graph.partition import Part, farthest, partition
from lodeflow.runtime.engine import Engine
from lodeflow.runtime.exchange import part_of
from lodeflow.runtime.plan import Plan
from lodeflow.transport.links import Links
from lodeflow.transport.meeting import barrier, farewell
from lodeflow.transport.session import LINKS, close_session, open_session

SETTINGS = settings(
    max_examples=40,
    deadline=None,
    derandomize=True,
    suppress_health_check=[HealthCheck.too_slow, HealthCheck.data_too_large],
)


def grouped(graph: Graph, rng: random.Random) -> Graph:
    """Return the graph with its nodes in random groups."""
    names = list(graph.nodes)
    count = rng.randint(2, min(4, len(names))) if len(names) > 1 else 1
    homes: dict[int, list[str]] = {}
    for place, name in enumerate(rng.sample(names, len(names))):
        homes.setdefault(place if place < count else rng.randrange(count), []).append(name)
    return replace(graph, processes={f"g{i}": Group(tuple(n)) for i, n in homes.items()})


class RunningGroup(threading.Thread):
    """One group, in a thread of its own, with a session of its own."""

    def __init__(
        self, graph: Graph, parts: Mapping[str, Part], name: str, folder: Path, samples: bool
    ) -> None:
        super().__init__()
        index = list(parts).index(name)
        self.session = open_session(
            listen=[f"unixsock-stream/{folder}/{index}"],
            connect=[f"unixsock-stream/{folder}/{other}" for other in range(index)],
            settings=LINKS,
        )
        part = parts[name]
        rounds = farthest(parts) + 1
        self.links = Links(self.session, graph, part, list(parts), rounds=rounds)
        self.plan = Plan(part_of(graph, part.nodes, part.inlets))
        self.streams = {w: s for w, s in collect(self.plan).items() if w.node in part.nodes}
        for wire in part.outlets:
            self.plan.tap(wire, self.links.tap(wire))
        self.engine = Engine(
            self.plan, speed=1e12 if samples else None, exchange=self.links, samples=samples
        )
        self.error: BaseException | None = None
        self.left = -1

    def run(self) -> None:
        try:
            self.plan.start()
            assert barrier(self.links, lambda: False, lambda missing: None)
            self.engine.begin()
            self.left = farewell(self.links, 30.0)
            self.left += sum(link.owes for link in self.links.links.values())
        except BaseException as error:
            self.error = error
        finally:
            self.links.close()
            close_session(self.session)


def run_split(graph: Graph, *, samples: bool) -> tuple[Streams, dict[str, Any]]:
    parts = partition(graph)
    with tempfile.TemporaryDirectory(prefix="lf") as folder:
        groups = [RunningGroup(graph, parts, name, Path(folder), samples) for name in parts]
        for group in groups:
            group.start()
        for group in groups:
            group.join()
    streams: Streams = {}
    counted: dict[str, Any] = {}
    for group in groups:
        if group.error is not None:
            raise group.error
        assert group.left == 0
        streams |= group.streams
        mine = counts(group.plan)
        counted |= {node.name: mine[node.name] for node in group.plan.mine}
    return streams, counted


def moved(streams: Streams) -> dict[Wire, list[int]]:
    return {wire: [t for t, _ in rows] for wire, rows in streams.items()}


def check(case: Case, seed: int) -> None:
    rng = random.Random(seed)
    graph = grouped(with_sources(case, rng), rng)
    shifted = Case(
        case.graph,
        {name: [b.replace(t=b.t + START) for b in blocks] for name, blocks in case.data.items()},
    )
    expected, counted = run_blocks(shifted, rng, whole=True)
    streams, split_counted = run_split(graph, samples=rng.random() < 0.5)
    assert moved(streams) == moved(expected)
    assert streams == expected
    assert split_counted == counted


@SETTINGS
@given(cases(), st.integers(0, 2**32))
def test_streams_do_not_depend_on_the_split(case: Case, seed: int) -> None:
    check(case, seed)


@settings(SETTINGS, max_examples=10)
@given(cases(), st.integers(0, 2**32))
def test_nor_on_how_little_a_link_takes(case: Case, seed: int) -> None:
    """With a window of two frames, everybody waits for everybody, and nobody for ever."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("lodeflow.transport.outbox.WINDOW", 2)
        patch.setattr("lodeflow.transport.outlet.FRAME_BYTES", 64)
        check(case, seed)
