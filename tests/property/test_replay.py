"""A random graph, run, recorded and replayed from random nodes, gives the same bytes again."""

from __future__ import annotations

import functools
import random
import tempfile
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from graphs import Case, cases, with_sources
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from mcap.reader import make_reader

from lodeflow.graph import Record, Wire
from lodeflow.recording import recorder
from lodeflow.recording.mcap.writer import McapWriter
from lodeflow.recording.reader import Recording
from lodeflow.recording.recorder import topic
from lodeflow.recording.replay import replaying
from lodeflow.supervisor.run import run


def records(path: Path) -> dict[str, list[tuple[int, bytes]]]:
    """Return what a recording holds of each stream, by the mcap package."""
    with path.open("rb") as file:
        reader = make_reader(file, validate_crcs=True)
        found = {c.topic: [] for c in reader.get_summary().channels.values()}
        for _, channel, message in reader.iter_messages():
            found[channel.topic].append((message.log_time, message.data))
    return found


def counted(summary: Any, names: Any) -> dict[str, tuple[int, int, int]]:
    counters = {name: summary.counters[name] for name in names}
    return {name: (c.stepped, c.unmatched, c.gated) for name, c in counters.items()}


def check(case: Case, seed: int, folder: Path) -> None:
    rng = random.Random(seed)
    graph = with_sources(case, rng)
    everything = folder / "everything.mcap"
    paced = rng.random() < 0.3
    before = run(graph, record=str(everything), speed=1e12 if paced else None)
    assert before.error is None
    expected = records(everything)
    start = rng.sample(list(graph.nodes), rng.randint(0, 2))
    path, kept = everything, set(expected)
    if rng.random() < 0.4:
        # A source of which nothing was recorded is computed anew; what a recomputed node sends
        # need not be there.
        forgotten = rng.choice(list(case.data))
        streams = [w for w in graph.streams() if w.node != forgotten]
        if not start:
            streams = [w for w in streams if w.node in case.data or rng.random() < 0.5]
        path, kept = folder / "partly.mcap", {topic(wire) for wire in streams}
        run(replace(graph, record=Record(str(path), tuple(streams))))
    with Recording(path) as recording:
        replay = replaying(graph, recording, start=start)
    again = run(
        replay.graph, record=str(folder / "again.mcap"), speed=1e12 if rng.random() < 0.3 else None
    )
    assert again.error is None
    assert again.lossless
    found = records(folder / "again.mcap")
    assert found == {name: expected[name] for name in found}
    assert found.keys() >= kept
    assert set(start) <= set(replay.computed)
    assert set(replay.recomputed).isdisjoint(replay.fed)
    assert {topic(wire) for wire in replay.recomputed} <= found.keys()
    assert counted(again, replay.computed) == counted(before, replay.computed)
    with Recording(folder / "again.mcap") as recording:  # a replay is a recording like any other
        once_more = replaying(graph, recording, start=start, complete=False)
    assert run(once_more.graph, record=str(folder / "once more.mcap")).error is None
    found = records(folder / "once more.mcap")
    assert found == {name: expected[name] for name in found}


@settings(
    max_examples=250,
    deadline=None,
    derandomize=True,
    suppress_health_check=[HealthCheck.too_slow, HealthCheck.data_too_large],
)
@given(cases(), st.integers(0, 2**32))
def test_a_replay_has_the_bytes_of_the_run(case: Case, seed: int) -> None:
    with tempfile.TemporaryDirectory() as folder, pytest.MonkeyPatch.context() as patch:
        # Chunks of a few messages: streams must be brought together across them.
        small = functools.partial(McapWriter, chunk_bytes=random.Random(seed).choice([300, 10**6]))
        patch.setattr(recorder, "McapWriter", small)
        check(case, seed, Path(folder))


def test_wires_have_the_topics_that_the_test_expects() -> None:
    assert topic(Wire("a", "out")) == "/a"
    assert topic(Wire("a", "b")) == "/a/b"
