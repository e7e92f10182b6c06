"""From a graph and a recording to the graph that replays: who is computed, who is fed, and how."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest

import lodeflow as lf
from lodeflow.errors import GraphError
from lodeflow.graph import Gate, Graph, GraphNode, Record, Wire, load_graph
from lodeflow.messages.cdr import layout_of
from lodeflow.messages.message import Message
from lodeflow.messages.ros import schema_text
from lodeflow.recording.mcap.writer import McapWriter
from lodeflow.recording.reader import Recording
from lodeflow.recording.recorder import topic
from lodeflow.recording.replay import is_complete, last_stamps, replaying
from lodeflow.runtime.intake import Fed
from lodeflow.supervisor.run import run


class Number(Message, ros="lodeflow_replay/msg/Number"):
    """A number."""

    value: lf.Scalar[lf.Dimensionless]


class Other(Message, ros="lodeflow_replay/msg/Other"):
    """A number of another type."""

    value: lf.Scalar[lf.Dimensionless]


class Ports(NamedTuple):
    fast: Number | None
    slow: Number | None
    mode: lf.Mode | None


class Sensors(lf.Source):
    """A fast stream, a slow one, and a mode that changes but once; one fast sample is NaN."""

    def read(self, clock: lf.Clock) -> Iterator[Ports]:
        for first in range(0, 1000, 250):
            t = np.arange(first, first + 250)
            value = np.where(t == 700, np.nan, np.sin(t))
            mode = lf.Mode(t[:1], np.array([1 + first // 500]))
            yield Ports(Number(t, value), Number(t[::50].copy(), np.cos(t[::50])), mode)


class Device(lf.Source):
    max_delay = 0

    def read(self, clock: lf.Clock) -> Iterator[Number]:
        yield Number(clock.now(), 1.0)


class Scale(lf.Node):
    """Multiplies; NaN where the number is negative, as a node may."""

    class Params(lf.Params):
        factor: float = 2.0

    def step(self, x: Number) -> Number:
        return Number(x.t, float("nan") if x.value < 0 else self.params.factor * x.value)


class Count(lf.Node):
    """Counts the NaN among its inputs, and says how many there were at the end, too."""

    sync = lf.Hold("x")

    def start(self) -> None:
        self.unknown = 0

    def step(self, x: Number, held: Number) -> Number:
        self.unknown += np.isnan(x.value)
        self.t = x.t
        return Number(x.t, self.unknown + held.value)

    def finish(self) -> Number:
        return Number(self.t + 1, float(self.unknown))


class Loop(lf.Node):
    sync = lf.Hold("x", initial={"back": Number(0, 1.0)}, delay=True)

    def step(self, x: Number, back: Number) -> Number:
        return Number(x.t, 0.5 * back.value + 1.0)


class Switch(lf.Node):
    def step(self, x: Number) -> lf.Mode:
        return lf.Mode(x.t, 1 + (x.value > 0))


class Sink(lf.Node):
    def step(self, x: Number) -> None: ...


def node(name, plugin, gates=(), params=None, **inputs):
    wires = {port: Wire(*wire.split(".")) for port, wire in inputs.items()}
    params = plugin.Params(**(params or {}))
    return GraphNode(name, plugin.__name__, plugin, params, wires, gates, frozenset({"nonfinite"}))


OPEN = (Gate(Wire("sensors", "mode"), "mode", frozenset({2})),)


def make(*nodes):
    return Graph("toy", {found.name: found for found in nodes}, document={"name": "toy"})


GRAPH = make(
    node("sensors", Sensors),
    node("scale", Scale, x="sensors.fast"),
    node("count", Count, x="scale.out", held="sensors.slow"),
    node("gated", Scale, gates=OPEN, x="count.out"),
    node("loop", Loop, x="scale.out", back="scaled.out"),
    node("scaled", Scale, x="loop.out", params={"factor": 0.25}),
    node("sink", Sink, x="gated.out"),
)


def record(graph: Graph, path: Path, streams: list[str] | None = None) -> Path:
    """Run and record a graph, all streams or some topics."""
    wires = [w for w in graph.streams() if streams is None or topic(w) in streams]
    done = run(replace(graph, record=Record(str(path), tuple(wires))))
    assert done.error is None
    return path


def contents(path: Path) -> dict[str, bytes]:
    """Return the bytes of every stream; of none if it has no messages."""
    found = {}
    with Recording(path) as recording:
        kinds = {kind.ros: kind for kind in (Number, Other, lf.Mode)}
        for name, (ros, _) in recording.topics.items():
            blocks = recording.stream(name, kinds[ros])
            encoded = [layout_of(kinds[ros]).encode_block(block).tobytes() for block in blocks]
            found[name] = b"".join(encoded)
    return found


@pytest.fixture(scope="module")
def path(tmp_path_factory) -> Path:
    return record(GRAPH, tmp_path_factory.mktemp("replay") / "all.mcap")


def plan(path, *, graph=GRAPH, start=(), complete=True):
    with Recording(path) as recording:
        return replaying(graph, recording, start=start, complete=complete)


def test_all_but_sources_is_computed(path):
    replay = plan(path)
    assert replay.computed == ("scale", "count", "gated", "loop", "scaled", "sink")
    assert list(map(str, replay.fed)) == ["sensors.fast", "sensors.slow", "sensors.mode"]
    assert issubclass(replay.graph.nodes["sensors"].plugin, Fed)
    assert replay.graph.nodes["sensors"].plugin.spec.outputs == Sensors.spec.outputs
    assert replay.graph.nodes["scale"] is GRAPH.nodes["scale"]
    assert replay.graph.document == GRAPH.document
    assert replay.graph.record.to == "recordings/{name}-replay-{start}.mcap"
    assert set(replay.graph.record.streams) == set(GRAPH.streams())


@pytest.mark.parametrize("start", [(), ("count",), ("loop",), ("gated", "loop"), ("scale",)])
@pytest.mark.parametrize("speed", [None, 1e12])
def test_the_bytes_are_those_of_the_run(path, tmp_path, start, speed):
    replay = plan(path, start=start)
    done = run(replay.graph, record=str(tmp_path / "again.mcap"), speed=speed)
    assert done.error is None
    assert done.lossless  # what a source lost at the time has not entered, and cannot be lost again
    assert contents(tmp_path / "again.mcap") == contents(path)


def test_a_node_may_send_nan_and_it_is_fed(path, tmp_path):
    replay = plan(path, start=["count"], complete=False)
    assert "scale" not in replay.computed
    done = run(replay.graph, record=str(tmp_path / "again.mcap"))
    assert done.counters["scale"].sent == {"out": 999}
    assert contents(tmp_path / "again.mcap")["/count"] == contents(path)["/count"]


def test_from_a_node_what_lies_downstream_is_computed_and_what_it_reads_is_fed(path):
    replay = plan(path, start=["count"], complete=False)
    assert replay.computed == ("count", "gated", "sink")
    assert list(map(str, replay.fed)) == ["sensors.slow", "sensors.mode", "scale"]
    assert list(replay.graph.nodes) == ["sensors", "scale", "count", "gated", "sink"]
    params = replay.graph.nodes["sensors"].params
    assert params.topics == {"slow": "/sensors/slow", "mode": "/sensors/mode"}
    complete = plan(path, start=["count"])
    assert {*complete.fed, *complete.recomputed} == set(GRAPH.streams())


def test_a_cycle_is_computed_as_a_whole_and_gates_lead_downstream(path):
    assert plan(path, start=["scaled"]).computed == ("loop", "scaled")
    gate = (Gate(Wire("switch", "out"), "mode", frozenset({2})),)
    graph = make(
        GRAPH.nodes["sensors"],
        node("switch", Switch, x="sensors.slow"),
        node("gated", Scale, gates=gate, x="sensors.fast"),
    )
    assert plan(path, graph=graph, start=["switch"]).computed == ("switch", "gated")


def test_a_port_that_is_not_recorded_is_silent_if_nobody_reads_it(path, tmp_path):
    graph = make(GRAPH.nodes["sensors"], GRAPH.nodes["scale"])
    partly = record(GRAPH, tmp_path / "partly.mcap", ["/sensors/fast", "/scale"])
    done = run(plan(partly, graph=graph).graph, record=str(tmp_path / "again.mcap"))
    assert done.counters["sensors"].sent == {"fast": 999, "slow": 0, "mode": 0}
    assert contents(tmp_path / "again.mcap") == contents(partly)


def test_every_missing_stream_is_told_with_its_readers_and_the_file(tmp_path):
    partly = record(GRAPH, tmp_path / "partly.mcap", ["/sensors/fast", "/scale"])
    with pytest.raises(GraphError) as caught:
        plan(partly)
    assert caught.value.problems == (
        f"{partly}: 'sensors.slow' is not recorded, but read by 'count' (input held); "
        "--from sensors computes it anew",
        f"{partly}: 'sensors.mode' is not recorded, but read by 'gated' (gate); "
        "--from sensors computes it anew",
    )
    with pytest.raises(GraphError, match=r"'count' is not recorded, but read by 'gated' .input x"):
        plan(partly, start=["gated"])


def test_a_stream_of_another_type_is_told(path):
    class Reader(lf.Node):
        def step(self, x: Other) -> Other:
            return x

    class Changed(lf.Source):
        def read(self, clock: lf.Clock) -> Iterator[Other]:
            yield from ()

    graph = make(node("scale", Changed), node("reader", Reader, x="scale.out"))
    with pytest.raises(GraphError, match=r"'/scale' holds .*Number, not .*Other .*by 'reader'"):
        plan(path, graph=graph)


def test_a_source_of_which_nothing_is_recorded_is_computed(tmp_path, path):
    partly = record(GRAPH, tmp_path / "partly.mcap", ["/gated", "/loop"])
    replay = plan(partly)
    assert replay.computed == tuple(GRAPH.nodes)
    assert replay.fed == ()
    run(replay.graph, record=str(tmp_path / "again.mcap"))
    again = contents(tmp_path / "again.mcap")
    assert {name: again[name] for name in ("/gated", "/loop")} == contents(partly)
    assert plan(partly, start=["scale"]).computed == tuple(GRAPH.nodes)


def test_only_wanted_streams_are_recorded(path):
    graph = replace(GRAPH, record=Record("x", (Wire("gated", "out"),)))
    recorded = plan(path, graph=graph).graph.record.streams
    assert set(recorded) == set(GRAPH.streams())  # the recording has them all, and so has a replay


def test_a_live_source_is_fed_and_never_computed(path):
    live = make(node("scale", Device), node("count", Scale, x="scale.out"))
    replay = plan(path, graph=live)
    assert replay.computed == ("count",)
    assert replay.graph.nodes["scale"].plugin.max_delay is None
    with pytest.raises(GraphError, match="--from scale: 'scale' is a live device"):
        plan(path, graph=live, start=["scale"])
    unknown = make(node("device", Device), node("count", Scale, x="device.out"))
    with pytest.raises(GraphError, match=r"'device' is not recorded.*it comes from a live device"):
        plan(path, graph=unknown)
    unread = make(GRAPH.nodes["sensors"], GRAPH.nodes["scale"], node("device", Device))
    assert plan(path, graph=unread).computed == ("scale",)


def test_unknown_nodes_and_nothing_to_do_are_told(path):
    with pytest.raises(GraphError, match=r"--from cuont: no node 'cuont' .* mean 'count'"):
        plan(path, start=["cuont"])
    with pytest.raises(GraphError, match="nothing to compute, graph 'toy' has only sources"):
        plan(path, graph=make(GRAPH.nodes["sensors"]))


def test_a_changed_node_that_is_fed_is_told(tmp_path, monkeypatch):
    text = (
        "lodeflow: 1\nname: toy\nnodes:\n"
        f'  sensors: {{use: "{__name__}:Sensors"}}\n'
        f'  scale: {{use: "{__name__}:Scale", inputs: {{x: sensors.fast}}}}\n'
        f'  next: {{use: "{__name__}:Scale", inputs: {{x: scale}}}}\n'
    )
    (tmp_path / "toy.yaml").write_text(text)
    graph = load_graph(tmp_path / "toy.yaml")
    toy = tmp_path / "toy.mcap"
    run(graph, record=str(toy))
    assert plan(toy, graph=graph).notes == ()
    changed = load_graph(tmp_path / "toy.yaml", sets=["scale.factor=3"])
    assert plan(toy, graph=changed).notes == ()
    (note,) = plan(toy, graph=changed, start=["next"]).notes
    assert note.startswith(f"'scale' is not what it was when {toy} was recorded")


def test_the_provenance_of_a_replay_says_more(path, tmp_path):
    run(plan(path).graph, record=str(tmp_path / "again.mcap"), about={"replay_of": str(path)})
    with Recording(tmp_path / "again.mcap") as again:
        assert again.metadata("lodeflow.provenance")["replay_of"] == str(path)
        assert "numpy" in json.loads(again.metadata("lodeflow.provenance")["versions"])


def test_where_the_streams_of_a_killed_run_end(tmp_path, path):
    killed = tmp_path / "killed.mcap"
    with McapWriter(killed, chunk_bytes=2000) as writer:
        for name, count in (("/sensors/fast", 200), ("/sensors/slow", 3), ("/scale", 0)):
            block = Number(np.arange(count), np.zeros(count))
            channel = writer.channel(name, Number.ros, schema_text(Number))
            writer.write(channel, block.t, layout_of(Number).encode_block(block))
    fast, slow, scale = (Wire("sensors", "fast"), Wire("sensors", "slow"), Wire("scale", "out"))
    assert last_stamps(killed, [fast, slow, scale]) == {fast: 199, slow: 2}
    with Recording(killed) as recording:
        assert not is_complete(recording)
    with Recording(path) as recording:
        assert is_complete(recording)
