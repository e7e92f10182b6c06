"""However long a file is, reading it takes the memory of its window."""

import tracemalloc

import numpy as np
import pytest
from recordings import Forward

import lodeflow as lf
from lodeflow.graph.model import Graph, GraphNode, Wire
from lodeflow.messages.cdr import layout_of
from lodeflow.messages.ros import schema_text
from lodeflow.recording.compare import compare
from lodeflow.recording.info import info
from lodeflow.recording.mcap.writer import McapWriter
from lodeflow.recording.reader import Recording
from lodeflow.recording.recover import recover
from lodeflow.recording.source import RecordedSensors
from lodeflow.supervisor.run import run

SHORT, LONG = 20_000, 200_000
STEP = 10_000_000


def write(path, count, text):
    """Write inertial measurements whose definition has this text."""
    layout, rows = layout_of(lf.Imu), 100
    random = np.random.default_rng(1)
    with McapWriter(path, chunk_bytes=1 << 20 if count >= SHORT else 1 << 16) as writer:
        channel = writer.channel("/imu", lf.Imu.ros, text)
        for first in range(0, count, rows):
            t = np.arange(first, first + rows) * STEP
            block = lf.Imu(t, random.random((rows, 3)), random.random((rows, 3)))
            records = layout.encode_block(block)
            if "notes" in text:  # behind the last member, where all is aligned
                records = np.pad(records, ((0, 0), (0, 4)))
            writer.write(channel, t, records)
    return path


OURS = schema_text(lf.Imu)
THEIRS = OURS.replace("=", "string[] notes\n=", 1)


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    folder = tmp_path_factory.mktemp("long")
    return [write(folder / f"{count}.mcap", count, OURS) for count in (SHORT, LONG)]


def columns(path):
    with Recording(path) as recording:
        return sum(len(block) for block in recording.stream("/imu", lf.Imu))


def a_run(path):
    """Run a small graph on a file, without a recorder, whose queues are no matter of reading."""
    params = RecordedSensors.Params(file=path, imu="/imu", mag=None)
    source = GraphNode("s", "recorded_sensors", RecordedSensors, params)
    node = GraphNode("n", "forward", Forward, Forward.Params(), {"imu": Wire("s", "imu")})
    return run(Graph("long", {"s": source, "n": node}), record="").counters["n"].stepped


def peak(what, path):
    """Return the most bytes that were in use while a file was read, and what came of it."""
    tracemalloc.start()
    found = what(path)
    most = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    return most, found


@pytest.mark.parametrize(
    "what",
    [
        columns,
        a_run,
        lambda path: info(path).streams["/imu"].count,
        lambda path: compare(path, path).streams["/imu"].shared,
        lambda path: recover(path).kept["/imu"],
    ],
    ids=["columns", "run", "info", "compare", "recover"],
)
def test_ten_times_the_length_takes_the_same_memory(files, what):
    peak(what, files[0])  # what is compiled, imported and cached once
    short, count = peak(what, files[0])
    assert count == SHORT
    long, count = peak(what, files[1])
    assert count == LONG
    assert long < 1.2 * short


def test_foreign_members_do_too(tmp_path):
    files = [write(tmp_path / f"{count}.mcap", count, THEIRS) for count in (500, 5_000)]
    peak(columns, files[0])
    short, count = peak(columns, files[0])
    assert count == 500
    long, count = peak(columns, files[1])
    assert count == 5_000
    assert long < 1.2 * short
