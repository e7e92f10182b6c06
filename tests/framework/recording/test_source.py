"""The source that plays a recording: aligned in time, bounded in memory, the same live and not."""

from collections.abc import Iterator
from itertools import pairwise
from typing import NamedTuple

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import ValidationError

import lodeflow as lf
from lodeflow.clock import SimClock
from lodeflow.graph.model import Graph, GraphNode, Wire
from lodeflow.messages.cdr import layout_of
from lodeflow.messages.ros import schema_text
from lodeflow.messages.vocabulary import AttitudeTruth
from lodeflow.recording.mcap.writer import McapWriter
from lodeflow.recording.reader import Recording
from lodeflow.recording.source import RecordedSensors, aligned
from lodeflow.runtime.engine import Engine
from lodeflow.runtime.plan import Plan
from lodeflow.testing import check_node

KINDS = {"/imu": lf.Imu, "/mag": lf.MagneticField, "/truth": AttitudeTruth}
TOPICS = {"imu": "/imu", "mag": "/mag", "truth": "/truth"}


def random_block(kind, t):
    random = np.random.default_rng(len(t))
    columns = [
        random.integers(0, 2, (len(t), *field.shape))
        if field.integer
        else random.standard_normal((len(t), *field.shape))
        for field in kind.fields
    ]
    return kind(np.asarray(t, dtype=np.int64), *columns)


def write(path, blocks, pieces=50):
    """Write blocks by topic, a few rows of each in turn."""
    with McapWriter(path, chunk_bytes=20_000) as writer:
        channels = {
            topic: writer.channel(topic, type(block).ros, schema_text(type(block)))
            for topic, block in blocks.items()
        }
        for first in range(0, max(map(len, blocks.values())), pieces):
            for topic, block in blocks.items():
                part = block[first : first + pieces]
                records = layout_of(type(part)).encode_block(part)
                writer.write(channels[topic], part.t, records)
    return path


@pytest.fixture
def blocks():
    """An IMU at 300 Hz, a field at 100 Hz and beside it, a reference that ends early."""
    return {
        "/imu": random_block(lf.Imu, 10**9 + np.arange(900) * 3_333_333),
        "/mag": random_block(lf.MagneticField, 10**9 + np.arange(300) * 10_000_000),
        "/truth": random_block(AttitudeTruth, 10**9 + np.arange(150) * 6_666_666),
    }


@pytest.fixture
def path(tmp_path, blocks):
    return write(tmp_path / "in.mcap", blocks)


def source(path, **topics):
    return RecordedSensors(RecordedSensors.Params(file=path, **{**TOPICS, **topics}))


def played(node):
    """Return {port: block} of a source, and how many yields it took."""
    found = {port.name: [] for port in node.spec.outputs}
    count = 0
    for count, item in enumerate(node.read(SimClock()), 1):  # noqa: B007
        for port, block in item._asdict().items():
            if block is not None:
                found[port].append(block)
    kinds = {port.name: port.type for port in node.spec.outputs}
    return {port: kinds[port].concat(blocks) for port, blocks in found.items()}, count


def test_it_keeps_the_contract(path):
    params = {"file": str(path), **TOPICS}
    check_node(RecordedSensors, params, duration=10**10)


def test_it_plays_all_there_is(path, blocks):
    found, count = played(source(path))
    assert {f"/{port}": block for port, block in found.items()} == blocks
    assert count > 10


def test_a_port_without_a_topic_is_silent(path, blocks):
    found, _ = played(source(path, mag=None, truth=None))
    assert found["imu"] == blocks["/imu"]
    assert (len(found["mag"]), len(found["truth"])) == (0, 0)


def test_a_path_starts_at_the_current_folder(path, blocks, monkeypatch):
    monkeypatch.chdir(path.parent)
    found, _ = played(source("in.mcap"))
    assert found["imu"] == blocks["/imu"]


def test_topics_of_imu_and_field_must_be_named(path):
    with pytest.raises(ValidationError, match=r"imu\n.*\n?.*required[\s\S]*mag\n"):
        RecordedSensors.Params(file=path)


@pytest.mark.parametrize(
    ("topics", "message"),
    [
        ({"imu": "/imo"}, "no topic '/imo', did you mean '/imu'"),
        ({"mag": "/truth"}, "'/truth' holds lodeflow_msgs/msg/AttitudeTruth, not sensor_msgs"),
    ],
)
def test_a_wrong_topic_fails_before_the_first_message(path, topics, message):
    node = GraphNode(
        "rec", "rec", RecordedSensors, RecordedSensors.Params(file=path, **{**TOPICS, **topics})
    )
    plan = Plan(Graph("wrong", {"rec": node}))
    sent = []
    for wire in plan.taps:
        plan.tap(wire, sent.append)
    with pytest.raises(lf.NodeFailure, match=f"node 'rec' .*{message}"):
        Engine(plan).run()
    assert sent == []


def test_the_file_is_released_when_the_run_ends_early(path, monkeypatch):
    closed = []
    close = Recording.close
    monkeypatch.setattr(Recording, "close", lambda self: closed.append(self.path) or close(self))
    items = source(path).read(SimClock())
    next(items)
    items.close()
    assert closed == [path]


@settings(max_examples=200, deadline=None)
@given(
    data=st.lists(
        st.tuples(
            st.lists(st.integers(1, 30), max_size=25),  # steps from stamp to stamp
            st.sets(st.integers(1, 25)),  # where blocks begin
        ),
        min_size=1,
        max_size=4,
    )
)
def test_aligned_yields_all_up_to_each_stamp_and_holds_one_block_of_each(data):
    whole, streams, drawn = {}, {}, {}

    def stream(name, parts):
        for part in parts:
            drawn[name].append(part)
            yield part

    for number, (steps, cuts) in enumerate(data):
        name = str(number)
        whole[name] = random_block(lf.Mode, np.cumsum(steps))
        edges = [0, *sorted(cut for cut in cuts if cut < len(steps)), len(steps)]
        parts = [whole[name][a:b] for a, b in pairwise(edges) if b > a]
        drawn[name] = []
        streams[name] = stream(name, parts)
    found = {name: [] for name in whole}
    reached = -1
    for blocks in aligned(streams):
        assert blocks
        assert min(block.t[0] for block in blocks.values()) > reached
        reached = max(block.t[-1] for block in blocks.values())
        for name, block in blocks.items():
            found[name].append(block)
        for name, parts in drawn.items():
            rows = sum(map(len, parts)) - sum(map(len, found[name]))
            assert rows <= (len(parts[-1]) if parts else 0)
    assert {name: lf.Mode.concat(parts) for name, parts in found.items()} == whole


class Pairs(lf.Node):
    """Adds up what meets: depends on every stamp and value of both inputs."""

    sync = lf.Nearest("imu", within=3_000_000)

    def start(self) -> None:
        self.sum = np.zeros(3)

    def step(self, imu: lf.Imu, mag: lf.MagneticField) -> lf.AngularRate:
        self.sum = 0.5 * self.sum + imu.angular_velocity + mag.magnetic_field
        return lf.AngularRate(imu.t, self.sum)


class Joined(NamedTuple):
    pairs: lf.AngularRate | None
    count: lf.Mode | None


class Moving(lf.Node):
    """Counts the inputs that are there at each stamp."""

    sync = lf.Each()

    def step(self, truth: AttitudeTruth | None, pairs: lf.AngularRate | None) -> Joined:
        t = truth.t if truth is not None else pairs.t
        return Joined(pairs, lf.Mode(t, (truth is not None) + 2 * (pairs is not None)))


class Nothing(lf.Source):
    """A second source, of its own time."""

    def read(self, clock: lf.Clock) -> Iterator[lf.Mode]:
        yield from (lf.Mode(10**9 + 10**8 * i, i % 3) for i in range(1, 20))


def graph(path):
    params = RecordedSensors.Params(file=path, **TOPICS)
    nodes = [
        GraphNode("rec", "recorded_sensors", RecordedSensors, params),
        GraphNode("other", "nothing", Nothing, Nothing.Params()),
        GraphNode(
            "pairs", "pairs", Pairs, Pairs.Params(),
            {"imu": Wire("rec", "imu"), "mag": Wire("rec", "mag")},
        ),
        GraphNode(
            "moving", "moving", Moving, Moving.Params(),
            {"truth": Wire("rec", "truth"), "pairs": Wire("pairs", "out")},
        ),
    ]  # fmt: skip
    return Graph("played", {node.name: node for node in nodes})


def streams_of(path, **options):
    """Run the graph and return its streams as {wire: block}."""
    plan = Plan(graph(path))
    found = {wire: [] for wire in plan.taps}
    for wire, into in found.items():
        plan.tap(wire, lambda m, into=into: into.append(m if m.is_block else m.as_block()))
    Engine(plan, **options).run()
    assert plan.lossless
    assert not any(node.counters.lost for node in plan.nodes.values())
    return {str(wire): type(parts[0]).concat(parts) for wire, parts in found.items()}


def test_blocks_and_paced_samples_give_the_same_streams(path, blocks):
    as_blocks = streams_of(path)
    as_samples = streams_of(path, speed=1e6)
    assert as_blocks == as_samples
    for port in ("imu", "mag", "truth"):
        assert as_blocks[f"rec.{port}"] == blocks[f"/{port}"]
    assert len(as_blocks["pairs"]) == 300
    assert set(as_blocks["moving.count"].mode.tolist()) == {1, 2, 3}
