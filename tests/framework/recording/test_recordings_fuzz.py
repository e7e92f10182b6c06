"""Any bytes at all: an error that says where, never another exception, a hang, or much memory."""

import tempfile
import tracemalloc
from functools import cache
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.writer import CompressionType
from recordings import WANTED, columns, foreign, write

from lodeflow.errors import RecordingError
from lodeflow.recording.compare import compare
from lodeflow.recording.mcap.records import MAGIC
from lodeflow.recording.recover import recover

SEEDS = {
    "zstd": lambda path: write(path),
    "lz4": lambda path: write(path, compression="lz4"),
    "none": lambda path: write(path, compression=""),
    "killed": lambda path: write(path, closed=False),
    "foreign": lambda path: foreign(path, compression=CompressionType.ZSTD),
    "foreign none": lambda path: foreign(path, compression=CompressionType.NONE),
    "loose": lambda path: foreign(path, use_chunking=False),
}
OWN = 600_000  # bytes that reading takes however small the file is: windows, parsed schemas


@cache
def seed(name):
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "seed.mcap")
        SEEDS[name](path)
        return path.read_bytes()


@st.composite
def damaged(draw):
    """A file that was good, after some accidents; or no file of ours at all."""
    if draw(st.integers(0, 9)) == 0:
        return draw(st.sampled_from([b"", MAGIC])) + draw(st.binary(max_size=300))
    data = bytearray(seed(draw(st.sampled_from(sorted(SEEDS)))))
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


def attempt(what, *arguments):
    """Call, and return what it returns or None for a proper error; check what memory it took."""
    found, refused = None, ""
    tracemalloc.start()
    try:
        found = what(*arguments)
    except RecordingError as error:
        refused = str(error)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert not refused or "in.mcap: " in refused
    assert peak < 10 * arguments[0].stat().st_size + OWN
    return found


@settings(max_examples=250, deadline=None)
@given(damaged())
def test_any_file_is_read_or_refused(data):
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "in.mcap")
        path.write_bytes(data)
        attempt(columns, path)
        attempt(compare, path, path)


@settings(max_examples=250, deadline=None)
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


@pytest.mark.parametrize("name", SEEDS)
def test_the_seeds_are_good_or_mended_without_loss(name, tmp_path):
    path = tmp_path / "in.mcap"
    path.write_bytes(seed(name))
    found = recover(path)
    assert found.kept == {"/heading": 300, "/imu": 100}
    assert (found.out is None) == (name not in ("killed", "loose"))
    assert len(columns(found.out or path)) == len(WANTED)
