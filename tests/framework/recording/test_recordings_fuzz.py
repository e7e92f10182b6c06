"""Any bytes at all: an error that says where, never another exception, a hang, or much memory."""

import os
import tempfile
import tracemalloc
from functools import cache
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.writer import CompressionType
from recordings import IMU, WANTED, columns, foreign, foreign_members, replayable, write

from lodeflow.errors import GraphError, NodeFailure, RecordingError
from lodeflow.graph import load_graph_text
from lodeflow.recording.compare import compare
from lodeflow.recording.export import export
from lodeflow.recording.info import info
from lodeflow.recording.mcap.records import MAGIC
from lodeflow.recording.reader import Recording
from lodeflow.recording.recover import recover
from lodeflow.recording.replay import replaying
from lodeflow.supervisor.run import run

EXAMPLES = int(os.environ.get("LODEFLOW_FUZZ", "250"))
"""Files that each test tries; thousands for a campaign."""
SEEDS = {
    "zstd": lambda path: write(path),
    "lz4": lambda path: write(path, compression="lz4"),
    "none": lambda path: write(path, compression=""),
    "killed": lambda path: write(path, closed=False),
    "foreign": lambda path: foreign(path, compression=CompressionType.ZSTD),
    "foreign none": lambda path: foreign(path, compression=CompressionType.NONE),
    "loose": lambda path: foreign(path, use_chunking=False),
    "members": lambda path: foreign_members(path),
    "run": lambda path: replayable(path),
}
OWN = 600_000  # bytes that reading takes however small the file is: windows, parsed schemas
RUN = 4_000_000  # the same of a run: a recorder has buffers of its own


@cache
def seed(name):
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "seed.mcap")
        SEEDS[name](path)
        return path.read_bytes()


@st.composite
def damaged(draw, seeds=tuple(SEEDS)):
    """A file that was good, after some accidents; or no file of ours at all."""
    if draw(st.integers(0, 9)) == 0:
        return draw(st.sampled_from([b"", MAGIC])) + draw(st.binary(max_size=300))
    data = bytearray(seed(draw(st.sampled_from(seeds))))
    for _ in range(draw(st.integers(1, 4))):
        at = draw(st.integers(0, len(data)))
        size = draw(st.integers(0, 200))
        match draw(st.sampled_from(["flip", "flip", "byte", "cut", "drop", "insert", "move"])):
            case "flip":
                if at < len(data):
                    data[at] ^= 1 << draw(st.integers(0, 7))
            case "byte":
                data[at : at + 8] = bytes([draw(st.sampled_from([0, 1, 127, 255]))]) * 8
            case "cut":
                del data[at:]
            case "drop":
                del data[at : at + size]
            case "insert":
                data[at:at] = draw(st.binary(max_size=40)) * draw(st.integers(1, 30))
            case "move":
                part = bytes(data[at : at + size])
                where = draw(st.integers(0, len(data)))
                data[where:where] = part
    return bytes(data)


def attempt(what, *arguments, own=OWN):
    """Call, and return what it returns or None for a proper error; check what memory it took."""
    found, refused = None, ""
    tracemalloc.start()
    try:
        found = what(*arguments)
    except (RecordingError, GraphError, NodeFailure) as error:
        refused = str(error)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert not refused or "in.mcap: " in refused
    assert peak < 10 * arguments[0].stat().st_size + own
    return found


@settings(max_examples=EXAMPLES, deadline=None)
@given(damaged())
def test_any_file_is_read_or_refused(data):
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "in.mcap")
        path.write_bytes(data)
        attempt(columns, path)
        attempt(compare, path, path)


@settings(max_examples=EXAMPLES, deadline=None)
@given(damaged())
def test_any_file_is_mended_or_refused(data):
    with tempfile.TemporaryDirectory() as folder:
        path, out = Path(folder, "in.mcap"), Path(folder, "out.mcap")
        path.write_bytes(data)
        found = attempt(recover, path, out)
        assert path.read_bytes() == data
        assert out.exists() == (found is not None and found.out is not None)
        if found is not None and found.out is not None:
            assert recover(out).out is None


def export_all(path):
    with Recording(path) as recording, tempfile.TemporaryDirectory() as folder:
        export(recording, "csv", Path(folder, "tables"))


@settings(max_examples=EXAMPLES, deadline=None)
@given(damaged())
def test_any_file_is_listed_and_exported_or_refused(data):
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "in.mcap")
        path.write_bytes(data)
        attempt(info, path)
        attempt(export_all, path)


def replay(path):
    """Replay a file as the command line does."""
    with Recording(path) as recording:
        text = recording.attachment("graph.yaml").decode("utf-8", "replace")
        planned = replaying(load_graph_text(text, filename=f"{path}: graph.yaml"), recording)
    summary = run(planned.graph, record=str(path.with_name("again.mcap")))
    if summary.error is not None:
        raise summary.error
    return summary


@settings(max_examples=EXAMPLES // 4, deadline=None)
@given(damaged(("run", "run", "run", "zstd")))
def test_any_file_is_replayed_or_refused(data):
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "in.mcap")
        path.write_bytes(data)
        attempt(replay, path, own=RUN)


@pytest.mark.parametrize("name", SEEDS)
def test_the_seeds_are_good_or_mended_without_loss(name, tmp_path):
    path = tmp_path / "in.mcap"
    path.write_bytes(seed(name))
    found = recover(path)
    assert (found.out is None) == (name not in ("killed", "loose"))
    if name == "run":
        assert found.kept == {"/s/imu": 100, "/s/mag": 0, "/s/truth": 0, "/f": 100}
        assert replay(path).lossless
        return
    readable = columns(found.out or path)
    assert found.kept == {topic: len(block) for topic, block in readable.items()}
    assert readable["/imu"] == IMU
    assert len(readable) == len(WANTED) - (name == "members")
