"""The reader against independent writers and readers, and against damage."""

import tempfile
from pathlib import Path
from random import Random

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.reader import make_reader
from recordings import random_block, read
from rosbags.highlevel import AnyReader

from lodeflow.errors import RecordingError
from lodeflow.messages.cdr import layout_of
from lodeflow.messages.ros import schema_text
from lodeflow.messages.vocabulary import (
    Attitude,
    AttitudeTruth,
    Heading,
    Imu,
    MagneticField,
    Mode,
)
from lodeflow.recording.mcap.records import INDEX_LAYOUT
from lodeflow.recording.mcap.writer import McapWriter
from lodeflow.recording.reader import Recording

COMPRESSIONS = ["zstd", "lz4", ""]
KINDS = [Imu, MagneticField, AttitudeTruth, Mode, Heading]


def put(writer, blocks, channels=None):
    """Write blocks by topic; return the channels."""
    channels = {} if channels is None else channels
    for topic, block in blocks.items():
        kind = type(block)
        if topic not in channels:
            channels[topic] = writer.channel(topic, kind.ros, schema_text(kind))
        writer.write(channels[topic], block.t, layout_of(kind).encode_block(block))
    return channels


def of_package(path, topics=None, **span):
    """Return what the mcap package reads, {topic: [(log_time, data)]}."""
    found = {}
    with path.open("rb") as file:
        reader = make_reader(file, validate_crcs=True)
        for _, channel, message in reader.iter_messages(topics, **span):
            found.setdefault(channel.topic, []).append((message.log_time, message.data))
    return found


def encoded(block):
    records = layout_of(type(block)).encode_block(block)
    return [(t, row.tobytes()) for t, row in zip(block.t.tolist(), records, strict=True)]


@pytest.fixture
def path(tmp_path):
    return tmp_path / "in.mcap"


@pytest.fixture
def small(path):
    """A closed file of two topics in several chunks."""
    blocks = {
        "/imu": random_block(Imu, range(0, 40, 2)),
        "/mag": random_block(MagneticField, range(1, 41, 2)),
    }
    with McapWriter(path, chunk_bytes=3000) as writer:
        writer.metadata("lodeflow.provenance", {"graph": "test", "größe": "µ"})
        writer.attachment("graph.yaml", "application/yaml", b"nodes: {}\n")
        put(writer, blocks)
    return path


SMALL = {"/imu": Imu, "/mag": MagneticField}


@pytest.mark.parametrize("compression", COMPRESSIONS)
def test_columns_come_back_as_they_were(path, compression):
    blocks = {f"/{kind.__name__}": random_block(kind, range(0, 7000, 7)) for kind in KINDS}
    with McapWriter(path, compression=compression, chunk_bytes=30_000) as writer:
        channels = {}
        for first in range(0, 1000, 100):
            put(writer, {k: b[first : first + 100] for k, b in blocks.items()}, channels)
    assert read(path, {topic: type(block) for topic, block in blocks.items()}) == blocks
    with Recording(path) as recording:
        assert dict(recording.topics) == {
            topic: (type(block).ros, 1000) for topic, block in blocks.items()
        }
        for topic, block in blocks.items():
            parts = list(recording.stream(topic, type(block)))
            assert len(parts) > 1
            assert type(block).concat(parts) == block


@settings(max_examples=80, deadline=None)
@given(
    kinds=st.lists(st.sampled_from(KINDS), min_size=1, max_size=4),
    seed=st.integers(0, 10**6),
    chunk_bytes=st.integers(1, 5000),
    compression=st.sampled_from(COMPRESSIONS),
    span=st.none() | st.tuples(st.integers(-5, 300), st.integers(-5, 300)),
)
def test_any_streams_and_chunks_read_as_the_mcap_package_reads_them(
    kinds, seed, chunk_bytes, compression, span
):
    random, cuts = np.random.default_rng(seed), Random(seed)
    blocks = {}
    for number, kind in enumerate(kinds):
        t = np.cumsum(random.integers(1, 20, random.integers(0, 30)))
        blocks[f"/{number}"] = random_block(kind, t, seed)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "in.mcap")
        with McapWriter(path, compression=compression, chunk_bytes=chunk_bytes) as writer:
            channels = put(writer, {topic: block[:0] for topic, block in blocks.items()})
            left = dict.fromkeys(blocks, 0)
            while left:
                topic = cuts.choice(list(left))
                start, block = left[topic], blocks[topic]
                left[topic] = end = cuts.randint(start, len(block))
                put(writer, {topic: block[start:end]}, channels)
                if end == len(block):
                    del left[topic]
                if cuts.random() < 0.2:
                    writer.flush_chunk()
        wanted = {topic: type(block) for topic, block in blocks.items()}
        expected = of_package(path)
        found = read(path, wanted)
        assert found == blocks
        if span is not None:
            start, end = min(span), max(span)
            found = read(path, wanted, start=start, end=end)
            expected = of_package(path, starting_at=start, ending_before=end)
        assert {k: encoded(b) for k, b in found.items() if len(b)} == expected


def test_start_and_end_are_half_open_and_each_may_stand_alone(small):
    wanted = {"/imu": Imu}
    assert read(small, wanted, start=10, end=20)["/imu"].t.tolist() == [10, 12, 14, 16, 18]
    assert read(small, wanted, start=34)["/imu"].t.tolist() == [34, 36, 38]
    assert read(small, wanted, end=3)["/imu"].t.tolist() == [0, 2]
    assert len(read(small, wanted, start=39)["/imu"]) == 0
    assert len(read(small, wanted, start=9, end=9)["/imu"]) == 0


def test_metadata_and_attachments(small):
    with Recording(small) as recording:
        assert recording.metadata("lodeflow.provenance") == {"graph": "test", "größe": "µ"}
        assert recording.attachment("graph.yaml") == b"nodes: {}\n"
        with pytest.raises(RecordingError, match=r"no attachment 'graph.yml', did you mean 'graph"):
            recording.attachment("graph.yml")
        with pytest.raises(RecordingError, match=r"no metadata 'x' \(there is: lodeflow.prov"):
            recording.metadata("x")


def test_a_recording_without_messages(path):
    with McapWriter(path) as writer:
        put(writer, {"/imu": Imu.empty()})
    assert len(read(path, {"/imu": Imu})["/imu"]) == 0
    with Recording(path) as recording, pytest.raises(RecordingError, match="nothing"):
        recording.attachment("graph.yaml")


def test_chunks_of_unwanted_topics_are_not_unpacked(path, monkeypatch):
    with McapWriter(path) as writer:
        channels = put(writer, {"/imu": random_block(Imu, range(9))})
        writer.flush_chunk()
        put(writer, {"/mag": random_block(MagneticField, range(9))}, channels)
        writer.flush_chunk()
        put(writer, {"/imu": random_block(Imu, range(9, 12))}, channels)
        put(writer, {"/mag": random_block(MagneticField, range(9, 12))}, channels)
    with Recording(path) as recording:
        unpacked = []
        unpack = recording._file._unpack
        monkeypatch.setattr(
            recording._file, "_unpack", lambda place: unpacked.append(place) or unpack(place)
        )
        assert len(list(recording.blocks({"/mag": MagneticField}))) == 2
        assert len(unpacked) == 2
        unpacked.clear()
        assert len(list(recording.blocks(SMALL))) == 3
        assert len(unpacked) == 3  # the last holds both topics, and is unpacked once


def test_rosbags_decodes_what_the_columns_hold(small):
    columns = read(small, SMALL)
    with AnyReader([small]) as reader:
        for topic in SMALL:
            (connection,) = [c for c in reader.connections if c.topic == topic]
            messages = [
                reader.deserialize(raw, connection.msgtype)
                for _, _, raw in reader.messages([connection])
            ]
            block = columns[topic]
            assert [m.header.stamp.nanosec for m in messages] == block.t.tolist()
            name = block.field_names[-1]
            vectors = [getattr(m, name) for m in messages]
            assert [[v.x, v.y, v.z] for v in vectors] == getattr(block, name).tolist()


# Mistakes of a user.


def test_an_unknown_topic(small):
    with Recording(small) as recording, pytest.raises(RecordingError) as caught:
        recording.blocks({"/imo": Imu})
    assert str(caught.value) == (
        f"{small}: no topic '/imo', did you mean '/imu'? (topics: /imu (sensor_msgs/msg/Imu), "
        "/mag (sensor_msgs/msg/MagneticField))"
    )


def test_a_topic_of_another_type(small):
    with Recording(small) as recording:
        with pytest.raises(RecordingError) as caught:
            recording.stream("/mag", Imu)
        assert str(caught.value) == (
            f"{small}: '/mag' holds sensor_msgs/msg/MagneticField, not sensor_msgs/msg/Imu (Imu); "
            "topics with that: /imu"
        )
        with pytest.raises(RecordingError, match="topics with that: none"):
            recording.stream("/mag", Attitude)


def test_another_definition_of_the_same_type(path):
    text = schema_text(Heading).replace("float64 heading", "float64 bearing")
    with McapWriter(path) as writer:
        channel = writer.channel("/heading", Heading.ros, text)
        block = random_block(Heading, range(5))
        writer.write(channel, block.t, layout_of(Heading).encode_block(block))
    with pytest.raises(RecordingError, match="Heading needs 'float64 heading', which "):
        read(path, {"/heading": Heading})


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "is empty"),
        (b"\x89MC", "was not closed"),
        (b"\x89PNG\r\n\x1a\n" * 20, "is no MCAP file"),
        (b"t,x,y\n", "is no MCAP file"),
    ],
)
def test_files_that_are_no_recording(path, content, message):
    path.write_bytes(content)
    with pytest.raises(RecordingError, match=rf"in\.mcap: {message}"):
        Recording(path)


def test_no_file(tmp_path):
    with pytest.raises(RecordingError, match=r"nothing\.mcap: cannot be read: No such file"):
        Recording(tmp_path / "nothing.mcap")
    with pytest.raises(RecordingError, match="cannot be read: Is a directory"):
        Recording(tmp_path)


def test_a_recording_that_was_closed_by_its_user(small):
    with Recording(small) as recording:
        pass
    with pytest.raises(RecordingError, match=r"in\.mcap: cannot be read: .*closed file"):
        recording.attachment("graph.yaml")


# Damage.


def test_a_file_that_was_not_closed(path):
    writer = McapWriter(path)
    put(writer, {"/imu": random_block(Imu, range(5))})
    writer.flush_chunk()
    with pytest.raises(RecordingError, match=r"in\.mcap: was not closed: its end is missing"):
        Recording(path)
    writer.close()
    assert len(read(path, {"/imu": Imu})["/imu"]) == 5


def test_a_file_cut_off_anywhere_is_refused(small):
    data = small.read_bytes()
    for size in [*range(0, len(data), 5), len(data) - 1]:
        small.write_bytes(data[:size])
        with pytest.raises(RecordingError, match=r"is empty|was not closed"):
            Recording(small)


@pytest.mark.parametrize("compression", COMPRESSIONS)
def test_any_wrong_byte_is_found_or_does_no_harm(path, compression):
    blocks = {"/mode": random_block(Mode, range(6)), "/heading": random_block(Heading, range(6))}
    with McapWriter(path, compression=compression, chunk_bytes=400) as writer:
        put(writer, blocks)
        writer.attachment("a", "", b"precious")
    data = path.read_bytes()
    found = 0
    for place in range(len(data)):
        path.write_bytes(data[:place] + bytes([data[place] ^ 0x41]) + data[place + 1 :])
        try:
            assert read(path, {"/mode": Mode, "/heading": Heading}) == blocks
            with Recording(path) as recording:
                assert recording.attachment("a") == b"precious"
        except RecordingError:
            found += 1
    assert found > len(data) // 2


def test_an_index_that_points_at_other_messages(path):
    mode, heading = random_block(Mode, range(3)), random_block(Heading, range(3))
    with McapWriter(path, compression="") as writer:
        put(writer, {"/mode": mode, "/heading": heading})
    data = path.read_bytes()
    indexes = {}
    with path.open("rb") as file:
        (chunk,) = make_reader(file).get_summary().chunk_indexes
    for channel, at in chunk.message_index_offsets.items():
        entries = data[at + 15 : at + 15 + 3 * 16]
        indexes[channel] = (at + 15, np.frombuffer(entries, INDEX_LAYOUT).copy())
    (at, right), (_, other) = indexes.values()
    swapped, foreign, beyond, inside = right.copy(), right.copy(), right.copy(), right.copy()
    swapped["offset"][:2] = right["offset"][1::-1]
    foreign["offset"] = other["offset"]
    beyond["offset"][2] = 2**63
    inside["offset"][1] += 3
    for wrong in (swapped, foreign, beyond, inside):
        path.write_bytes(data[:at] + wrong.tobytes() + data[at + 48 :])
        with pytest.raises(RecordingError, match=r"'/mode' in .*: the message index is damaged"):
            read(path, {"/mode": Mode})
        assert read(path, {"/heading": Heading})["/heading"] == heading


def test_a_chunk_whose_crc_differs_is_named(path):
    with McapWriter(path, compression="") as writer:
        put(writer, {"/imu": random_block(Imu, range(6))})
    data = bytearray(path.read_bytes())
    data[data.index(b"body") + 60] ^= 1
    path.write_bytes(data)
    with pytest.raises(RecordingError, match=r"the chunk at byte \d+ is damaged: its CRC differs"):
        read(path, {"/imu": Imu})
