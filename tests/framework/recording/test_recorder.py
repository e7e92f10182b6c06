"""The recorder on real runs: all of each stream, logs, full disks, and a killed process."""

import json
import logging
import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
import zstandard
from mcap.exceptions import McapError
from mcap.reader import make_reader
from mcap.records import Attachment, Channel, Header, Message, Metadata
from mcap.stream_reader import StreamReader
from rosbags.highlevel import AnyReader

import lodeflow as lf
from lodeflow.graph.model import Graph, GraphNode, Wire
from lodeflow.messages.cdr import layout_of
from lodeflow.recording import recorder as module
from lodeflow.recording.reader import Recording
from lodeflow.recording.recorder import BACKLOG, Recorder
from lodeflow.runtime.engine import Engine
from lodeflow.runtime.plan import Plan

ROWS = 400


class Ports(NamedTuple):
    rate: lf.AngularRate | None
    mode: lf.Mode | None


class Ticks(lf.Source):
    """Counts at 100 Hz, in blocks, and sends a mode once a second."""

    class Params(lf.Params):
        rows: int = ROWS
        first: int = 0
        block: int = 30

    def read(self, clock: lf.Clock) -> Iterator[Ports]:
        first, rows = self.params.first, self.params.rows
        for start in range(0, rows, self.params.block):
            count = np.arange(start, min(rows, start + self.params.block))
            t = first + count * 10_000_000
            rate = lf.AngularRate(t, count[:, None] + np.array([0.0, 0.25, 0.5]))
            change = count % 100 == 0
            mode = lf.Mode(t[change], count[change] // 100 % 3)
            yield Ports(rate, mode if len(mode) else None)


class Doubler(lf.Node):
    """Says aloud what it does, now and then."""

    def step(self, rate: lf.AngularRate) -> lf.AngularRate:
        if rate.t % 1_000_000_000 == 0:
            self.log.warning("at %d s — größer", rate.t // 1_000_000_000)
        return rate.replace(angular_rate=2 * rate.angular_rate)


def plan_of(**params):
    ticks = GraphNode("ticks", "ticks", Ticks, Ticks.Params(**params))
    inputs = {"rate": Wire("ticks", "rate")}
    double = GraphNode("double", "doubler", Doubler, Doubler.Params(), inputs)
    return Plan(Graph("test", {"ticks": ticks, "double": double}))


def record(path, *, wires=None, speed=None, **params):
    """Run the graph with a recorder; return what its ports sent, {topic: block}."""
    plan = plan_of(**params)
    sent = {}
    for wire in plan.taps:
        into = sent.setdefault(module.topic(wire), [])
        plan.tap(wire, lambda m, into=into: into.append(m if m.is_block else m.as_block()))
    recorder = Recorder(path, graph="nodes: {}\n", provenance={"graph": "test", "seed": "7"})
    recorder.attach(plan, plan.graph.streams() if wires is None else wires)
    try:
        Engine(plan, speed=speed, watch=recorder.keep_up).run()
    finally:
        recorder.close({"stopped": "no"})
    return {topic: type(parts[0]).concat(parts) for topic, parts in sent.items()}


@pytest.fixture
def path(tmp_path):
    return tmp_path / "runs" / "out.mcap"


@pytest.mark.parametrize("speed", [None, 40.0], ids=["blocks", "samples"])
def test_all_messages_of_all_streams_are_in_the_file(path, speed):
    sent = record(path, speed=speed)
    assert {topic: len(block) for topic, block in sent.items()} == {
        "/ticks/rate": ROWS,
        "/ticks/mode": ROWS // 100,
        "/double": ROWS,
    }
    with Recording(path) as recording:
        for topic, block in sent.items():
            kind = type(block)
            assert recording.topics[topic] == (kind.ros, len(block))
            assert kind.concat(list(recording.stream(topic, kind))) == block
    with path.open("rb") as file:
        found = {}
        for _, channel, message in make_reader(file, validate_crcs=True).iter_messages():
            found.setdefault(channel.topic, []).append((message.log_time, message.data))
    for topic, block in sent.items():
        records = layout_of(type(block)).encode_block(block)
        assert found[topic] == [
            (t, row.tobytes()) for t, row in zip(block.t.tolist(), records, strict=True)
        ]


def test_blocks_and_samples_give_the_same_recording(path, tmp_path):
    assert record(path) == record(tmp_path / "samples.mcap", speed=100.0)


def test_samples_and_blocks_of_one_stream_keep_their_order(path):
    plan, wire = plan_of(), Wire("double", "out")
    block = lf.AngularRate(np.arange(9), np.arange(27.0).reshape(9, 3))
    recorder = Recorder(path, graph="", provenance={})
    recorder.attach(plan, [wire])
    (tap,) = plan.taps[wire]
    for message in (block.row(0), block.row(1), block[2:5], block[5:6], block.row(6), block[7:9]):
        tap(message)
    recorder.close({})
    with Recording(path) as recording:
        assert list(recording.stream("/double", lf.AngularRate)) == [block]


def test_graph_and_provenance_stand_right_behind_the_header(path):
    record(path)
    with path.open("rb") as file:
        records = list(StreamReader(file).records)
    assert [type(r) for r in records[:3]] == [Header, Metadata, Attachment]
    header, provenance, graph = records[:3]
    assert header.profile == "ros2"
    assert (provenance.name, provenance.metadata) == (
        "lodeflow.provenance",
        {"graph": "test", "seed": "7"},
    )
    assert (graph.name, graph.data) == ("graph.yaml", b"nodes: {}\n")
    last_message = max(i for i, r in enumerate(records) if isinstance(r, Message))
    summary = [r for r in records[last_message:] if isinstance(r, Metadata)]
    assert [(m.name, m.metadata) for m in summary] == [("lodeflow.summary", {"stopped": "no"})]


def test_only_the_streams_asked_for(path):
    record(path, wires=[Wire("double", "out")])
    with Recording(path) as recording:
        assert set(recording.topics) == {"/double", "/rosout"}


def test_logs_arrive_on_rosout(path):
    record(path, speed=40.0)
    with AnyReader([path]) as reader:
        (connection,) = [c for c in reader.connections if c.topic == "/rosout"]
        logs = [
            (t, reader.deserialize(raw, connection.msgtype))
            for _, t, raw in reader.messages([connection])
        ]
    assert [message.msg for _, message in logs] == [f"at {s} s — größer" for s in range(4)]
    for t, message in logs:
        assert (message.name, message.level) == ("lodeflow.node.double", logging.WARNING)
        assert (message.file, message.function) == (Path(__file__).name, "step")
        line = Path(__file__).read_text().splitlines()[message.line - 1]
        assert "self.log.warning" in line
        assert message.stamp.sec * 10**9 + message.stamp.nanosec == t
    stamps = [t for t, _ in logs]
    assert stamps == sorted(stamps)
    assert stamps[-1] >= 2_990_000_000


def test_logs_of_any_length_level_and_script_decode(path, monkeypatch):
    # A lone surrogate that pytest captures could not travel between its own processes.
    monkeypatch.setattr(logging.getLogger("lodeflow"), "propagate", False)
    texts = ["", "a", "ab", "abc", "µ" * 300, "\ud800", "100 % done", "two\nlines"]
    recorder = Recorder(path, graph="", provenance={})
    plan = plan_of()
    recorder.attach(plan, [])
    recorder.keep_up(7_000_000_001)
    logger = logging.getLogger("lodeflow.test")
    for text in texts:
        logger.error(text)
    logger.log(1000, "beyond all levels")
    recorder.close({})
    logger.error("after the end")
    with AnyReader([path]) as reader:
        logs = [reader.deserialize(raw, c.msgtype) for c, _, raw in reader.messages()]
    expected = [text.replace("\ud800", "?") for text in texts]
    assert [message.msg for message in logs] == [*expected, "beyond all levels"]
    assert [message.level for message in logs] == [logging.ERROR] * len(texts) + [50]
    assert {(m.stamp.sec, m.stamp.nanosec) for m in logs} == {(7, 1)}


def test_a_wrong_log_call_does_not_end_the_step(path, monkeypatch, capsys):
    monkeypatch.setattr(logging.getLogger("lodeflow"), "propagate", False)  # pytest would raise
    recorder = Recorder(path, graph="", provenance={})
    recorder.attach(plan_of(), [])
    logging.getLogger("lodeflow.test").error("%d samples", "many")
    recorder.close({})
    assert "Logging error" in capsys.readouterr().err


def test_the_run_waits_for_the_recorder(path, monkeypatch):
    longest = 0
    keep_up = Recorder.keep_up

    def look(self, reached):
        nonlocal longest
        keep_up(self, reached)
        longest = max(longest, *(len(stream.queue) for stream in self.streams))

    monkeypatch.setattr(Recorder, "keep_up", look)
    sent = record(path, rows=3000, block=1)
    assert longest <= BACKLOG
    with Recording(path) as recording:
        assert recording.topics["/double"].messages == len(sent["/double"]) == 3000


def test_a_stamp_that_mcap_cannot_hold(path):
    with pytest.raises(lf.RecordingError, match=r"out\.mcap: row 0: the stamp -50000000 ns is neg"):
        record(path, first=-50_000_000)


def test_an_error_of_the_recorder_itself_ends_the_run(path, monkeypatch):
    def fail(self, block, out=None):
        raise ZeroDivisionError("of all things")

    monkeypatch.setattr(module.Layout, "encode_block", fail)
    with pytest.raises(lf.RecordingError, match="cannot be written: ZeroDivisionError: of all"):
        record(path, rows=3000, block=1)


def test_an_existing_file_and_a_folder_that_cannot_be(path):
    record(path)
    before = path.read_bytes()
    with pytest.raises(lf.RecordingError, match=r"out\.mcap: exists"):
        Recorder(path, graph="", provenance={})
    assert path.read_bytes() == before
    with pytest.raises(lf.RecordingError, match="choose another folder"):
        Recorder(path / "out.mcap", graph="", provenance={})


DISK_FULL = """
import json, resource, signal, sys
sys.path.insert(0, sys.argv[1])
import test_recorder as this
from pathlib import Path

signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
path, plan = Path(sys.argv[2]), this.plan_of(rows=200_000, block=500)
resource.setrlimit(resource.RLIMIT_FSIZE, (int(sys.argv[3]), resource.RLIM_INFINITY))
recorder = this.Recorder(path, graph="nodes: {}", provenance={"graph": "test"})
recorder.attach(plan, plan.graph.streams())
said = {}
try:
    this.Engine(plan, watch=recorder.keep_up).run()
except this.lf.RecordingError as error:
    said["run"] = str(error)
try:
    recorder.close({})
except this.lf.RecordingError as error:
    said["close"] = str(error)
print(json.dumps(said))
"""


def script(text, *arguments, **options):
    return subprocess.Popen(
        [sys.executable, "-c", text, str(Path(__file__).parent), *map(str, arguments)],
        env={**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))},
        stdout=subprocess.PIPE,
        text=True,
        **options,
    )


def recovered(path):
    """Return what a stream reader gets out of a file without an end, {topic: log times}."""
    found, topics, kinds = {}, {}, []
    with path.open("rb") as file:
        try:
            for item in StreamReader(file, validate_crcs=True).records:
                kinds.append(type(item))
                if isinstance(item, Channel):
                    topics[item.id] = item.topic
                    found[item.topic] = []
                elif isinstance(item, Message):
                    found[topics[item.channel_id]].append(item.log_time)
        except (McapError, zstandard.ZstdError, ValueError, OverflowError):
            pass
    assert kinds[:3] == [Header, Metadata, Attachment]
    return found


def test_a_full_disk_ends_the_run_and_leaves_a_readable_file(tmp_path):
    pytest.importorskip("resource")
    path = tmp_path / "full.mcap"
    child = script(DISK_FULL, path, 1_000_000)
    out, _ = child.communicate(timeout=120)
    said = json.loads(out)
    assert said.keys() == {"run", "close"}
    for error in said.values():
        assert error.startswith(f"{path}: cannot be written: File too large")
        assert "closed and readable" in error
    assert path.stat().st_size <= 1_000_000
    with Recording(path) as recording:
        t = np.concatenate([block.t for block in recording.stream("/ticks/rate", lf.AngularRate)])
    assert len(t) > 1000
    assert (t == 10_000_000 * np.arange(len(t))).all()


KILLED = """
import sys
sys.path.insert(0, sys.argv[1])
import test_recorder as this
from pathlib import Path

plan = this.plan_of(rows=100_000)
recorder = this.Recorder(Path(sys.argv[2]), graph="nodes: {}", provenance={"graph": "test"})
recorder.attach(plan, plan.graph.streams())

def watch(reached):
    recorder.keep_up(reached)
    print(reached, flush=True)

this.Engine(plan, speed=1.0, watch=watch).run()
"""


def test_a_killed_run_loses_less_than_its_last_second(tmp_path):
    path = tmp_path / "killed.mcap"
    child = script(KILLED, path)
    reached = 0
    for line in child.stdout:
        reached = int(line)
        if reached >= 2_500_000_000:
            break
    child.kill()
    child.communicate(timeout=60)
    found = recovered(path)
    for topic in ("/ticks/rate", "/double"):
        times = found[topic]
        assert times == [10_000_000 * number for number in range(len(times))]
        assert times[-1] >= reached - 1_000_000_000
    assert found["/ticks/mode"][:2] == [0, 1_000_000_000]
