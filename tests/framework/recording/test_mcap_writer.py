"""The writer against independent readers: the mcap package and rosbags."""

import struct
import tempfile
import zlib
from pathlib import Path

import numpy as np
import pytest
import zstandard
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.reader import make_reader
from mcap.stream_reader import StreamReader
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_typestore

from lodeflow.recording.mcap.records import MAGIC, Op
from lodeflow.recording.mcap.writer import McapWriter

COMPRESSIONS = ["zstd", "lz4", ""]
MESSAGE_HEAD = 31
TYPES = get_typestore(Stores.ROS2_HUMBLE)
IMU = "sensor_msgs/msg/Imu"


def stamps(*values):
    return np.array(values, dtype=np.int64)


def numbered(count, size=5, first=0):
    """Return payloads that all differ: each holds its own number."""
    records = np.zeros((count, size), dtype=np.uint8)
    records[:, :4] = np.arange(first, first + count, dtype="<u4")[:, None].view(np.uint8)
    return records


def open_channel(writer, topic="/a"):
    return writer.channel(topic, "lodeflow_msgs/msg/Test", "float64 x\n")


def expected(t, records):
    return [(int(time), row.tobytes()) for time, row in zip(t, records, strict=True)]


def read(path):
    """Return {topic: [(log_time, payload)]} in the order of the file, with all CRCs checked."""
    found = {}
    with Path(path).open("rb") as file:
        for _ in StreamReader(file, validate_crcs=True).records:  # the CRC of the data section
            pass
        file.seek(0)
        reader = make_reader(file, validate_crcs=True)
        for _, channel, message in reader.iter_messages(log_time_order=False):
            messages = found.setdefault(channel.topic, [])
            assert message.sequence == len(messages)
            assert message.publish_time == message.log_time
            messages.append((message.log_time, message.data))
    return found


def walk(data, start=8):
    """Yield (offset, opcode, body) of the records; the last one must end where the data ends."""
    while start < len(data) and data[start:] != MAGIC:
        op, length = struct.unpack_from("<BQ", data, start)
        assert start + 9 + length <= len(data)
        yield start, op, data[start + 9 : start + 9 + length]
        start += 9 + length


def summary_of(path):
    with Path(path).open("rb") as file:
        return make_reader(file).get_summary()


@pytest.fixture
def path(tmp_path):
    return tmp_path / "out.mcap"


@pytest.fixture
def rich(path):
    """Write two channels in small chunks, with attachments and metadata before and between."""
    with McapWriter(path, library="lodeflow test", chunk_bytes=400) as writer:
        writer.metadata("provenance", {"seed": "7", "größe": "µ"})
        writer.attachment("graph.yaml", "text/yaml", b"nodes: {}\n", t=5)
        a = open_channel(writer)
        b = writer.channel("/b", "lodeflow_msgs/msg/Test", "float64 x\n", metadata={"k": "v"})
        other = writer.channel("/c", "lodeflow_msgs/msg/Test", "float64 y\n")
        for start in range(0, 60, 6):
            t = 1000 * np.arange(start, start + 6)
            writer.write(a, t, numbered(6, first=start))
            writer.write(b, t[::2] + 1, numbered(3, 9, first=start))
        writer.write(other, stamps(3), numbered(1))
        writer.attachment("empty", "", b"")
        writer.metadata("late", {})
    return path


@pytest.mark.parametrize("compression", COMPRESSIONS)
def test_messages_read_back(path, compression):
    t, records = 10 * np.arange(1000), numbered(1000, 40)
    with McapWriter(path, compression=compression, chunk_bytes=5000) as writer:
        writer.write(open_channel(writer), t, records)
    assert read(path) == {"/a": expected(t, records)}
    chunks = summary_of(path).chunk_indexes
    assert {chunk.compression for chunk in chunks} == {compression}
    step = MESSAGE_HEAD + 40
    full = 5000 // step * step
    assert [chunk.uncompressed_size for chunk in chunks[:-1]] == [full] * (1000 * step // full)


def test_header_schemas_channels_and_statistics(rich):
    with rich.open("rb") as file:
        header = make_reader(file).get_header()
    assert (header.profile, header.library) == ("ros2", "lodeflow test")
    summary = summary_of(rich)
    assert [schema.data for schema in summary.schemas.values()] == [b"float64 x\n", b"float64 y\n"]
    assert {schema.encoding for schema in summary.schemas.values()} == {"ros2msg"}
    assert {channel.message_encoding for channel in summary.channels.values()} == {"cdr"}
    by_topic = {channel.topic: channel for channel in summary.channels.values()}
    assert by_topic["/a"].schema_id == by_topic["/b"].schema_id != by_topic["/c"].schema_id
    assert by_topic["/b"].metadata == {"k": "v"}
    found = summary.statistics
    assert found.channel_message_counts == {
        by_topic["/a"].id: 60,
        by_topic["/b"].id: 30,
        by_topic["/c"].id: 1,
    }
    assert (found.message_count, found.chunk_count) == (91, len(summary.chunk_indexes))
    assert (found.message_start_time, found.message_end_time) == (0, 59000)
    assert (found.schema_count, found.channel_count) == (2, 3)
    assert (found.attachment_count, found.metadata_count) == (2, 2)


def test_attachments_and_metadata(rich):
    with rich.open("rb") as file:
        reader = make_reader(file)
        attachments, metadata = list(reader.iter_attachments()), list(reader.iter_metadata())
    assert [(a.name, a.media_type, a.data, a.log_time) for a in attachments] == [
        ("graph.yaml", "text/yaml", b"nodes: {}\n", 5),
        ("empty", "", b"", 0),
    ]
    assert [(m.name, m.metadata) for m in metadata] == [
        ("provenance", {"seed": "7", "größe": "µ"}),
        ("late", {}),
    ]
    for index, attachment in zip(summary_of(rich).attachment_indexes, attachments, strict=True):
        assert (index.name, index.data_size) == (attachment.name, len(attachment.data))


def test_seek_by_time_and_topic(rich):
    with rich.open("rb") as file:
        reader = make_reader(file, validate_crcs=True)
        found = reader.iter_messages(topics=["/b"], starting_at=20_000, ending_before=30_001)
        assert [message.log_time for _, _, message in found] == list(range(20_001, 30_001, 2000))
        times = [message.log_time for _, _, message in reader.iter_messages()]
    assert times == sorted(times)
    assert len(times) == 91


def test_crcs_that_the_mcap_package_does_not_check(rich):
    data = rich.read_bytes()
    records = list(walk(data))
    for offset, op, body in records:
        (crc,) = struct.unpack("<I", body[-4:])
        if op == Op.DATA_END:
            assert crc == zlib.crc32(data[:offset]) != 0
        elif op == Op.ATTACHMENT:
            assert crc == zlib.crc32(body[:-4])
    _, op, footer = records[-1]
    assert op == Op.FOOTER
    summary_start, _, crc = struct.unpack("<QQI", footer)
    assert crc == zlib.crc32(data[summary_start : -len(MAGIC) - 4])
    assert data.endswith(MAGIC)


def test_summary_offsets_and_lengths_point_at_what_they_say(rich):
    data = rich.read_bytes()
    at = {offset: (op, len(body) + 9) for offset, op, body in walk(data)}
    _, offsets_start, _ = struct.unpack("<QQI", data[-len(MAGIC) - 20 : -len(MAGIC)])
    groups = {}
    for offset, op, body in walk(data, offsets_start):
        if op == Op.SUMMARY_OFFSET:
            group, start, length = struct.unpack("<BQQ", body)
            groups[group] = {at[o][0] for o in at if start <= o < start + length}
            assert start + length in at
            assert offset in at
    assert groups == {op: {op} for op in (*range(3, 5), 0x08, 0x0A, 0x0B, 0x0D)}
    summary = summary_of(rich)
    for index in summary.attachment_indexes:
        assert at[index.offset] == (Op.ATTACHMENT, index.length)
    for index in summary.metadata_indexes:
        assert at[index.offset] == (Op.METADATA, index.length)
    for chunk in summary.chunk_indexes:
        assert at[chunk.chunk_start_offset] == (Op.CHUNK, chunk.chunk_length)
        lengths = [at[offset][1] for offset in chunk.message_index_offsets.values()]
        assert sum(lengths) == chunk.message_index_length


@pytest.mark.parametrize("compression", COMPRESSIONS)
def test_message_indexes_are_ordered_by_time_and_exact(path, compression):
    random = np.random.default_rng(2)
    with McapWriter(path, compression=compression, chunk_bytes=900) as writer:
        channels = [open_channel(writer, topic) for topic in ("/a", "/b")]
        for number in range(40):
            rows = int(random.integers(1, 5))
            t = random.integers(0, 50, rows)  # neither sorted nor unique
            writer.write(channels[number % 2], t, numbered(rows, 4 + number % 3, first=10 * number))
    data, seen = path.read_bytes(), 0
    decompress = {"zstd": zstandard.decompress, "": bytes}
    if compression == "lz4":
        decompress["lz4"] = pytest.importorskip("lz4.frame").decompress
    for chunk in summary_of(path).chunk_indexes:
        end = chunk.chunk_start_offset + chunk.chunk_length
        raw = decompress[compression](data[end - chunk.compressed_size : end])
        starts = {offset: body for offset, _, body in walk(raw, 0)}
        for channel, offset in chunk.message_index_offsets.items():
            (found,) = struct.unpack_from("<H", data, offset + 9)
            (size,) = struct.unpack_from("<I", data, offset + 11)
            entries = list(struct.iter_unpack("<QQ", data[offset + 15 : offset + 15 + size]))
            assert found == channel
            assert entries == sorted(entries)
            seen += len(entries)
            for time, place in entries:
                assert struct.unpack_from("<H4xQ", starts[place]) == (channel, time)
    assert seen == summary_of(path).statistics.message_count


def imu(number):
    """Return a message whose every value differs from all others."""
    known = TYPES.types
    vector, values = known["geometry_msgs/msg/Vector3"], number + np.arange(37) / 64
    return known[IMU](
        known["std_msgs/msg/Header"](
            known["builtin_interfaces/msg/Time"](number, 7 * number), "base_link"
        ),
        known["geometry_msgs/msg/Quaternion"](*values[:4]),
        values[4:13],
        vector(*values[13:16]),
        values[16:25],
        vector(*values[25:28]),
        values[28:37],
    )


def test_rosbags_decodes_imu(path):
    schema, _ = TYPES.generate_msgdef(IMU, ros_version=2)
    sent = [imu(number) for number in range(50)]
    encoded = [np.frombuffer(TYPES.serialize_cdr(message, IMU), np.uint8) for message in sent]
    t = 10**9 * np.arange(50)
    with McapWriter(path, chunk_bytes=4000) as writer:
        writer.write(writer.channel("/imu", IMU, schema), t, np.stack(encoded))
    with AnyReader([path]) as reader:
        assert [(c.topic, c.msgtype, c.msgcount) for c in reader.connections] == [("/imu", IMU, 50)]
        got = [
            (time, reader.deserialize(raw, connection.msgtype))
            for connection, time, raw in reader.messages()
        ]
        assert (reader.start_time, reader.end_time) == (0, 49 * 10**9 + 1)
    assert [time for time, _ in got] == t.tolist()
    for (_, found), message in zip(got, sent, strict=True):
        again = TYPES.serialize_cdr(TYPES.types[IMU](*_values(found)), IMU)
        assert again == TYPES.serialize_cdr(message, IMU)


def _values(message):
    return [getattr(message, name) for name in message.__dataclass_fields__ if name[0] != "_"]


@settings(max_examples=60, deadline=None)
@given(
    lengths=st.lists(st.integers(0, 40), min_size=1, max_size=3),
    size=st.integers(0, 90),
    cuts=st.randoms(use_true_random=False),
    chunk_bytes=st.integers(1, 3000),
    compression=st.sampled_from(COMPRESSIONS),
    flush=st.booleans(),
)
def test_any_split_and_interleaving_gives_the_same_streams(
    lengths, size, cuts, chunk_bytes, compression, flush
):
    random = np.random.default_rng(size)
    blocks = {
        f"/{number}": (
            np.sort(random.integers(0, 10**18, rows)),
            random.integers(0, 256, (rows, size), dtype=np.uint8),
        )
        for number, rows in enumerate(lengths)
    }
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "out.mcap")
        with McapWriter(path, compression=compression, chunk_bytes=chunk_bytes) as writer:
            left = {topic: (open_channel(writer, topic), 0) for topic in blocks}
            while left:
                topic = cuts.choice(list(left))
                channel, done = left[topic]
                t, records = blocks[topic]
                end = cuts.randint(done, len(t))
                writer.write(channel, t[done:end], records[done:end])
                left[topic] = channel, end
                if end == len(t):
                    del left[topic]
                if flush and cuts.random() < 0.2:
                    writer.flush_chunk()
        found = read(path)
        for topic, (t, records) in blocks.items():
            assert found.get(topic, []) == expected(t, records)
        counts = summary_of(path).statistics.channel_message_counts
        assert list(counts.values()) == lengths


@pytest.mark.parametrize("topics", [[], ["/a", "/b"]])
def test_an_empty_recording_is_readable(path, topics):
    with McapWriter(path) as writer:
        for topic in topics:
            open_channel(writer, topic)
    assert read(path) == {}
    found = summary_of(path).statistics
    assert (found.message_count, found.channel_count, found.chunk_count) == (0, len(topics), 0)
    assert (found.message_start_time, found.message_end_time) == (0, 0)
    with AnyReader([path]) as reader:
        assert sorted(connection.topic for connection in reader.connections) == topics
        assert list(reader.messages()) == []


def test_a_message_larger_than_a_chunk_has_its_own(path):
    with McapWriter(path, chunk_bytes=200) as writer:
        channel = open_channel(writer)
        for number, size in enumerate([50, 50, 1000, 50, 50, 50]):
            writer.write(channel, stamps(number), numbered(1, size, first=number))
    sizes = [chunk.uncompressed_size for chunk in summary_of(path).chunk_indexes]
    assert sizes == [2 * 81, MESSAGE_HEAD + 1000, 2 * 81, 81]
    assert [len(data) for _, data in read(path)["/a"]] == [50, 50, 1000, 50, 50, 50]


def test_equal_calls_give_equal_bytes_and_records_need_not_be_contiguous(tmp_path):
    t, wide = np.arange(200), numbered(200, 64)
    wide[:, 4:] = np.random.default_rng(1).integers(0, 256, (200, 60))
    files = []
    for name, records in (("a", wide[:, :32]), ("b", wide[:, :32].copy())):
        with McapWriter(tmp_path / name, chunk_bytes=2000) as writer:
            writer.write(open_channel(writer), t, records)
        files.append((tmp_path / name).read_bytes())
    assert files[0] == files[1]
    assert read(tmp_path / "a") == {"/a": expected(t, wide[:, :32])}
