"""The reader on files that others wrote: other frames, orders, publishers and indexes."""

import logging

import numpy as np
import pytest
from mcap.writer import CompressionType, IndexType, Writer
from recordings import random_block, read
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as RosbagWriter
from rosbags.typesys import Stores, get_typestore

import lodeflow as lf
from lodeflow.errors import RecordingError
from lodeflow.messages.cdr import StreamConstants, layout_of
from lodeflow.messages.message import Message
from lodeflow.messages.ros import schema_text
from lodeflow.messages.vocabulary import Imu, Mode
from lodeflow.recording.mcap.writer import McapWriter

TYPES = get_typestore(Stores.ROS2_HUMBLE)


class Foreign:
    """A file written by the mcap package, message by message."""

    def __init__(self, path, **options):
        self.writer = Writer(str(path), **{"chunk_size": 2000, **options})
        self.writer.start(profile="ros2")

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.writer.finish()

    def channel(self, topic, name=Imu.ros, text=None, *, encoding="cdr", schema="ros2msg"):
        text = TYPES.generate_msgdef(name, ros_version=2)[0] if text is None else text
        number = self.writer.register_schema(name, schema, text.encode())
        return self.writer.register_channel(topic, encoding, number)

    def add(self, channel, log_time, data):
        self.writer.add_message(channel, log_time, data, publish_time=log_time)


def ros_imu(t, frame="body", rate=0.0, covariance=0.0):
    """Return a message as rosbags encodes it."""
    known = TYPES.types
    vector = known["geometry_msgs/msg/Vector3"]
    stamp = known["builtin_interfaces/msg/Time"](*divmod(int(t), 10**9))
    message = known[Imu.ros](
        known["std_msgs/msg/Header"](stamp, frame),
        known["geometry_msgs/msg/Quaternion"](0.0, 0.0, 0.0, 1.0),
        np.full(9, covariance),
        vector(rate, 2.0, 3.0),
        np.zeros(9),
        vector(4.0, 5.0, 9.81),
        np.zeros(9),
    )
    return bytes(TYPES.serialize_cdr(message, Imu.ros))


@pytest.fixture
def path(tmp_path):
    return tmp_path / "in.mcap"


@pytest.mark.parametrize("compression", list(CompressionType))
def test_a_file_of_the_mcap_package(path, compression):
    with Foreign(path, compression=compression) as file:
        imu = file.channel("/imu")
        for number in range(30):
            file.add(imu, 1000 + number, ros_imu(10**9 + number, "imu_link", rate=number))
    found = read(path, {"/imu": Imu})["/imu"]
    assert found.t.tolist() == list(range(10**9, 10**9 + 30))
    assert found.angular_velocity[:, 0].tolist() == list(range(30))
    assert found.linear_acceleration[7].tolist() == [4, 5, 9.81]
    assert read(path, {"/imu": Imu}, start=1004, end=1006)["/imu"].t.tolist() == [
        10**9 + 4,
        10**9 + 5,
    ]


def test_a_bag_of_rosbags(tmp_path):
    with RosbagWriter(tmp_path / "bag", version=9, storage_plugin=StoragePlugin.MCAP) as bag:
        connection = bag.add_connection("/imu", Imu.ros, typestore=TYPES)
        for number in range(25):
            bag.write(connection, 5 + number, ros_imu(number, "base_link", rate=number))
    (path,) = (tmp_path / "bag").glob("*.mcap")
    found = read(path, {"/imu": Imu})["/imu"]
    assert found.t.tolist() == list(range(25))
    assert found.angular_velocity[:, 0].tolist() == list(range(25))


def test_frames_of_any_length_are_read_and_counted(path, caplog):
    frames = ["imu", "imu", "a_longer_name", "", "imv", "imu", "ab", "abcd", "imu_12"]
    with Foreign(path) as file:
        channel = file.channel("/imu")
        for number, frame in enumerate(frames * 5):
            file.add(channel, number, ros_imu(number, frame, rate=number))
    with caplog.at_level(logging.WARNING, "lodeflow"):
        found = read(path, {"/imu": Imu})["/imu"]
    assert found.t.tolist() == list(range(45))
    assert found.angular_velocity[:, 0].tolist() == list(range(45))
    (record,) = caplog.records
    assert record.getMessage() == (
        f"{path}: '/imu': frame_id differs from that of the first message, which is kept, in 30 of "
        "45 messages"
    )


def test_members_that_are_not_kept_are_counted(path, caplog):
    with Foreign(path) as file:
        channel = file.channel("/imu")
        for number in range(20):
            file.add(channel, number, ros_imu(number, covariance=float(number > 12)))
    with caplog.at_level(logging.WARNING, "lodeflow"):
        assert len(read(path, {"/imu": Imu})["/imu"]) == 20
    (record,) = caplog.records
    assert "members that Imu does not declare differ" in record.getMessage()
    assert "in 7 of 20 messages" in record.getMessage()


@pytest.mark.parametrize("length", range(10))
def test_members_without_alignment_stand_right_behind_any_frame(path, length):
    block = random_block(Mode, range(20))
    layout = layout_of(Mode, StreamConstants("f" * length))
    with McapWriter(path) as writer:
        channel = writer.channel("/mode", Mode.ros, schema_text(Mode))
        writer.write(channel, block.t[:10], layout_of(Mode).encode_block(block[:10]))
        writer.write(channel, block.t[10:], layout.encode_block(block[10:]))
    assert read(path, {"/mode": Mode})["/mode"] == block


class Flagged(Message, ros="lodeflow_test/msg/Flagged"):
    """Frames of 3 and 4 letters give records of one size, with the flag at another place."""

    flag: lf.UInt8
    value: lf.Int64


def test_records_of_one_size_may_have_their_members_at_different_places(path):
    block = random_block(Flagged, range(20))
    layouts = [layout_of(Flagged, StreamConstants(frame)) for frame in ("abc", "abcd")]
    assert layouts[0].size == layouts[1].size
    with McapWriter(path) as writer:
        channel = writer.channel("/flag", Flagged.ros, schema_text(Flagged))
        for row in range(20):
            one = block[row : row + 1]
            writer.write(channel, one.t, layouts[row % 2].encode_block(one))
    assert read(path, {"/flag": Flagged})["/flag"] == block


def test_messages_out_of_order_inside_a_chunk_are_sorted(path):
    order = np.random.default_rng(3).permutation(30)
    with Foreign(path, chunk_size=1 << 20) as file:
        channel = file.channel("/imu")
        for number in order.tolist():
            file.add(channel, number, ros_imu(1000 - number, rate=number))
    found = read(path, {"/imu": Imu})["/imu"]
    assert found.t.tolist() == list(range(971, 1001))
    assert found.angular_velocity[:, 0].tolist() == list(range(29, -1, -1))
    found = read(path, {"/imu": Imu}, start=10, end=20)["/imu"]
    assert found.angular_velocity[:, 0].tolist() == list(range(19, 9, -1))


def test_two_publishers_of_one_topic_are_one_stream(path):
    with Foreign(path) as file:
        channels = [file.channel("/imu"), file.channel("/imu")]
        assert channels[0] != channels[1]
        for number in range(30):
            file.add(channels[number % 3 == 0], number, ros_imu(number, rate=number))
    assert read(path, {"/imu": Imu})["/imu"].angular_velocity[:, 0].tolist() == list(range(30))


def test_a_stamp_that_goes_back_beyond_its_chunk(path):
    with Foreign(path) as file:
        channel = file.channel("/imu")
        for number in [*range(20), 7.5, *range(20, 30)]:
            file.add(channel, int(number * 10), ros_imu(number * 10))
    with pytest.raises(
        RecordingError, match=r"in\.mcap: '/imu' in the chunk at byte \d+: the stam"
    ):
        read(path, {"/imu": Imu})


def test_a_stamp_that_repeats(path):
    with Foreign(path) as file:
        channel = file.channel("/imu")
        for number in [1, 2, 3, 3, 4]:
            file.add(channel, number, ros_imu(number))
    with pytest.raises(RecordingError, match="two messages have the stamp 3 ns"):
        read(path, {"/imu": Imu})


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"use_chunking": False}, "'/imu' has 9 messages, but the index leads to 0"),
        (
            {"index_types": IndexType.ALL & ~IndexType.MESSAGE},
            "'/imu' has 9 messages, but the index leads to 0.*; mend it with: lodeflow recover ",
        ),
        ({"use_statistics": False}, "its summary has no statistics"),
        ({"repeat_channels": False}, "its summary lacks channels"),
        ({"repeat_schemas": False}, "its summary lacks channels"),
        (
            {
                "use_chunking": False,
                "use_statistics": False,
                "repeat_channels": False,
                "repeat_schemas": False,
                "use_summary_offsets": False,
            },
            "has no summary",
        ),
    ],
)
def test_files_that_lack_what_columns_need(path, options, message):
    with Foreign(path, **options) as file:
        channel = file.channel("/imu")
        for number in range(9):
            file.add(channel, number, ros_imu(number))
    with pytest.raises(RecordingError, match=message):
        read(path, {"/imu": Imu})


def test_other_encodings(path):
    with Foreign(path) as file:
        file.add(file.channel("/a", encoding="ros1"), 1, b"x" * 60)
        file.add(file.channel("/b"), 1, ros_imu(1).replace(b"\0\1\0\0", b"\0\0\0\0", 1))
        file.add(file.channel("/c"), 1, ros_imu(1)[:100])
        file.add(file.channel("/d"), 1, ros_imu(1)[:9])
        file.add(file.channel("/e"), 1, ros_imu(1) + b"\0")
        file.add(file.channel("/f"), 1, ros_imu(1).replace(b"\5\0\0\0body", b"\0\0\0\0body", 1))
    for topic, message in {
        "/a": r"'/a' is encoded as 'ros1' \(sensor_msgs/msg/Imu\); only 'cdr'",
        "/b": "'/b' in the chunk at byte .*: a message is not plain little-endian CDR",
        "/c": "truncated at",
        "/d": "a message is cut off",
        "/e": "1 bytes too many",
        "/f": "too many|terminating zero",
    }.items():
        with pytest.raises(RecordingError, match=message):
            read(path, {topic: Imu})
