"""Info against what was written: counts, rates, gaps, losses, and memory for many channels."""

import json
import tracemalloc

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from recordings import foreign, write

from lodeflow.errors import RecordingError
from lodeflow.messages.cdr import layout_of
from lodeflow.messages.ros import schema_text
from lodeflow.messages.vocabulary import Heading
from lodeflow.recording.events import GAP, in_range
from lodeflow.recording.info import StreamInfo, _Steps, info
from lodeflow.recording.mcap.writer import McapWriter
from lodeflow.recording.recover import recover
from lodeflow.sync import END, NEVER


@pytest.fixture
def path(tmp_path):
    return tmp_path / "run.mcap"


def record(path, t, **metadata):
    t = np.asarray(t, dtype=np.int64)
    with McapWriter(path, chunk_bytes=2000) as writer:
        for name, entries in metadata.items():
            writer.metadata(f"lodeflow.{name}", entries)
        channel = writer.channel("/heading", Heading.ros, schema_text(Heading))
        records = layout_of(Heading).encode_block(Heading(t, np.zeros(len(t))))
        writer.write(channel, t, records)
    return path


def test_streams_rates_and_ends(path):
    found = info(write(path))
    assert {topic: (s.type, s.count) for topic, s in found.streams.items()} == {
        "/heading": (Heading.ros, 300),
        "/imu": ("sensor_msgs/msg/Imu", 100),
    }
    heading = found.streams["/heading"]
    assert (heading.first, heading.last, heading.gaps, heading.unordered) == (0, 598, 0, 0)
    assert heading.rate == pytest.approx(1e9 / 2)
    assert (found.losses, found.graph) == (None, "nodes: {}\n")
    assert found.provenance == {"graph": "test"}
    json.dumps(found.as_dict(), allow_nan=False)


def test_gaps_are_steps_longer_than_three_median_steps(path):
    t = np.arange(1000) * 10_000_000
    t[300:] += 19_900_000  # a step of a little less than three: none
    t[500:] += 20_100_000
    t[900:] += 5_000_000_000
    stream = info(record(path, t)).streams["/heading"]
    assert stream.gaps == 2
    assert stream.gap_time == 30_100_000 + 5_010_000_000
    assert stream.rate == pytest.approx(999 / ((t[-1] - t[0]) / 1e9))


@given(
    steps=st.lists(st.integers(1, 10**12), min_size=1, max_size=60),
    cuts=st.lists(st.integers(0, 60), max_size=4),
)
def test_gaps_as_found_with_all_stamps_at_hand(steps, cuts):
    t = np.cumsum([5, *steps])
    found, stream = _Steps(), StreamInfo("", len(t))
    for part in np.split(t, sorted(cut for cut in cuts if cut < len(t))):
        if len(part):
            found.add(part)
    found.report(stream)
    median = sorted(steps)[(len(steps) - 1) // 2]
    surely = [step for step in steps if step > 3.01 * median]
    maybe = [step for step in steps if step > 2.99 * median]
    assert len(surely) <= stream.gaps <= len(maybe)
    assert sum(surely) <= stream.gap_time <= sum(maybe)
    assert (stream.first, stream.last, stream.unordered) == (t[0], t[-1], 0)


def test_short_streams(path, tmp_path):
    stream = info(record(path, [])).streams["/heading"]
    assert (stream.count, stream.first, stream.last, stream.rate) == (0, None, None, None)
    stream = info(record(tmp_path / "one.mcap", [7])).streams["/heading"]
    assert (stream.count, stream.first, stream.last, stream.rate, stream.gaps) == (1, 7, 7, None, 0)


def test_losses_are_those_of_the_run(path, tmp_path):
    nodes = {"imu": {"lost": {"late": 3}}, "mag": {"lost": {}}}
    found = info(record(path, [1], summary={"summary": json.dumps({"nodes": nodes})}))
    assert found.losses == {"imu": {"late": 3}}
    for number, text in enumerate(["", "{", "[]", '{"nodes": 3}', "[" * 100_000]):
        other = record(tmp_path / f"{number}.mcap", [1], summary={"summary": text})
        assert info(other).losses is None


def test_a_mended_file_says_so(path):
    found = info(recover(write(path, closed=False)).out)
    assert found.recovery["kept"] == {"/heading": 300, "/imu": 100}
    assert found.losses is None


def test_a_foreign_file(path):
    foreign(path)
    found = info(path)
    assert found.streams["/imu"].count == 100
    assert (found.provenance, found.graph, found.attachments) == ({}, None, {"photo.png": 6})


def test_a_file_that_was_not_closed_is_told_how_to_mend_it(tmp_path):
    path = write(tmp_path / "my run.mcap", closed=False)
    with pytest.raises(RecordingError, match=r"not closed.*: lodeflow recover '.*my run\.mcap'$"):
        info(path)


def test_stamps_of_any_number_take_the_same_memory(path):
    rng = np.random.default_rng(1)
    record(path, np.cumsum(rng.integers(9_000_000, 11_000_000, 50_000)))
    tracemalloc.start()
    assert info(path).streams["/heading"].count == 50_000
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < 2_500_000  # most is the summary, with an entry for each of 2000 chunks


def test_what_did_not_arrive_is_told(path):
    with McapWriter(path) as writer:
        channel = writer.channel(GAP.topic, GAP.ros, GAP.schema)
        for begin, end in ((NEVER, 7), (7, END)):
            payload = GAP.encode(in_range(begin), "s.a", "one", "two", begin, end)
            record = np.frombuffer(payload, dtype=np.uint8)[None]
            writer.write(channel, np.array([in_range(begin)]), record)
    found = info(path)
    assert found.missing == [("s.a", "one", "two", NEVER, 7), ("s.a", "one", "two", 7, END)]
    told = json.loads(json.dumps(found.as_dict(), allow_nan=False))["missing"]
    assert [(gap["begin"], gap["end"]) for gap in told] == [(None, 7), (7, None)]
