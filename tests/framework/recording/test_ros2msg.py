"""Foreign definitions of variable size, against rosbags and the mcap package."""

import tempfile
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.records import Schema
from mcap.writer import CompressionType, IndexType, Writer
from mcap_ros2.decoder import DecoderFactory
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as RosbagWriter
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

import lodeflow as lf
from lodeflow.errors import MessageError, RecordingError
from lodeflow.messages.message import Message
from lodeflow.recording.info import info
from lodeflow.recording.reader import Recording
from lodeflow.recording.recover import recover
from lodeflow.recording.ros2msg.definition import parse
from lodeflow.recording.ros2msg.translation import translation

NAME = "lodeflow_ros2msg_test/msg/Fix"


class Fix(Message, ros=NAME):
    """What lodeflow wants of a message that others fill with more."""

    latitude: lf.Scalar
    variance: lf.Vector3
    status: lf.UInt8


DECLARED = ["float64 latitude", "geometry_msgs/Vector3 variance", "uint8 status"]
NARROW = {"float64 latitude": "float32 latitude"}
PRIMITIVES = {
    "bool": st.booleans(),
    "int8": st.integers(-128, 127),
    "uint8": st.integers(0, 255),
    "int16": st.integers(-(2**15), 2**15 - 1),
    "uint16": st.integers(0, 2**16 - 1),
    "int32": st.integers(-(2**31), 2**31 - 1),
    "uint32": st.integers(0, 2**32 - 1),
    "int64": st.integers(-(2**63), 2**63 - 1),
    "uint64": st.integers(0, 2**64 - 1),
    "float32": st.floats(width=32, allow_nan=False),
    "float64": st.floats(allow_nan=False),
}
NESTED = ["std_msgs/String", "sensor_msgs/PointField", "geometry_msgs/Point32", "std_msgs/Header"]


@st.composite
def definitions(draw):
    """Return a definition that has what `Fix` needs, among members of any kind."""
    lines = ["std_msgs/Header header"]
    wanted = draw(st.permutations(DECLARED))
    for line in wanted:
        for _ in range(draw(st.integers(0, 2))):
            kind = draw(st.sampled_from([*PRIMITIVES, "string", *NESTED]))
            array = draw(st.sampled_from(["", "", "[]", "[3]", "[<=4]"]))
            bound = "<=20" if kind == "string" and draw(st.booleans()) else ""
            lines.append(f"{kind}{bound}{array} m{len(lines)}")
        lines.append(NARROW.get(line, line) if draw(st.booleans()) else line)
    lines.append(draw(st.sampled_from(["", "uint8 LAST=3", "# string[] no_member"])))
    return "\n".join(lines) + "\n"


def make_value(draw, store, kind, array):
    """Return a value as rosbags wants it, of a type in its own notation."""
    if array is not None:
        count = array or draw(st.integers(0, 4))
        values = [make_value(draw, store, kind, None) for _ in range(count)]
        return np.array(values, kind) if kind in PRIMITIVES else values
    if kind == "string":
        return draw(st.text(st.characters(codec="utf-8", exclude_characters="\0"), max_size=8))
    if kind in PRIMITIVES:
        return draw(PRIMITIVES[kind])
    fields = store.fielddefs[kind][1]
    return store.types[kind](*[fill(draw, store, described) for _, described in fields])


def fill(draw, store, described):
    """Return a value for a field as rosbags describes it: (node type, what)."""
    node, what = described[0].name, described[1]
    if node in ("ARRAY", "SEQUENCE"):
        (inner, name), size = what
        return make_value(
            draw, store, name[0] if inner.name == "BASE" else name, size if node == "ARRAY" else 0
        )
    return make_value(draw, store, what[0] if node == "BASE" else what, None)


@st.composite
def files(draw):
    """Return a store with a definition, and messages of it."""
    text = draw(definitions())
    store = get_typestore(Stores.ROS2_HUMBLE)
    store.register(get_types_from_msg(text, NAME))
    messages = []
    for number in range(draw(st.integers(1, 8))):
        message = make_value(draw, store, NAME, None)
        header = store.types["std_msgs/msg/Header"](
            store.types["builtin_interfaces/msg/Time"](*divmod(number * 10**8, 10**9)),
            draw(st.sampled_from(["gps", "gps", "", "another_frame", "µ"])),
        )
        message.header = header
        messages.append(message)
    return store, messages


OPTIONS = [
    {},
    {"chunk_size": 200},
    {"use_chunking": False},
    {"index_types": IndexType.ALL & ~IndexType.MESSAGE},
    {"index_types": IndexType.NONE, "use_summary_offsets": False},
]


def opened(path):
    """Return a path that can be read by column: the file, or what `recover` makes of it."""
    found = recover(path)
    assert (found.lost, found.damage, found.tail) == ({}, [], 0)
    if found.out is None:
        return path
    with pytest.raises(RecordingError, match="lodeflow recover"), Recording(path) as recording:
        list(recording.stream("/fix", Fix))
    return found.out


@settings(max_examples=100, deadline=None)
@given(files(), st.sampled_from(list(CompressionType)), st.sampled_from(OPTIONS))
def test_members_are_found_wherever_they_stand(made, compression, options):
    store, messages = made
    schema = store.generate_msgdef(NAME, ros_version=2)[0].encode()
    payloads = [bytes(store.serialize_cdr(message, NAME)) for message in messages]
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "in.mcap")
        writer = Writer(str(path), compression=compression, **options)
        writer.start(profile="ros2")
        number = writer.register_schema(NAME, "ros2msg", schema)
        channel = writer.register_channel("/fix", "cdr", number)
        for number, payload in enumerate(payloads):
            writer.add_message(channel, number, payload, publish_time=number)
        writer.finish()
        path = opened(path)
        with Recording(path) as recording:
            assert recording.kind("/fix") is Fix
            found = Fix.concat(list(recording.stream("/fix", Fix)))
            constants = recording.constants("/fix", Fix)
        assert info(path).streams["/fix"].unread == ""
    decode = DecoderFactory().decoder_for("cdr", Schema(1, schema, "ros2msg", NAME))
    for message in (messages, [decode(payload) for payload in payloads]):
        assert found.latitude.tolist() == [m.latitude for m in message]
        assert found.status.tolist() == [m.status for m in message]
        vectors = [[m.variance.x, m.variance.y, m.variance.z] for m in message]
        assert found.variance.tolist() == vectors
        assert found.t.tolist() == [
            m.header.stamp.sec * 10**9 + m.header.stamp.nanosec for m in message
        ]
    assert constants.frame_id == messages[0].header.frame_id


POSITION = """\
std_msgs/Header header
string source
float64[] residuals
float64 latitude
geometry_msgs/Vector3 variance
uint8 status
"""


def position(number, source="gps", frame="antenna"):
    """Return (store, message) of POSITION."""
    store = get_typestore(Stores.ROS2_HUMBLE)
    store.register(get_types_from_msg(POSITION, NAME))
    known = store.types
    stamp = known["builtin_interfaces/msg/Time"](number, 0)
    header = known["std_msgs/msg/Header"](stamp, frame)
    vector = known["geometry_msgs/msg/Vector3"](1.0, 2.0, 3.0)
    residuals = np.arange(number, dtype=np.float64)
    return store, known[NAME](header, source, residuals, 45.0 + number, vector, 200 - number)


def test_a_bag_of_rosbags_with_members_of_any_size(tmp_path, caplog):
    store, _ = position(0)
    with RosbagWriter(tmp_path / "bag", version=9, storage_plugin=StoragePlugin.MCAP) as bag:
        connection = bag.add_connection("/fix", NAME, typestore=store)
        for number in range(12):
            _, message = position(number, "s" * number, "antenna" if number < 9 else "roof")
            bag.write(connection, number, store.serialize_cdr(message, NAME))
    (path,) = (tmp_path / "bag").glob("*.mcap")
    with caplog.at_level("WARNING", "lodeflow"), Recording(path) as recording:
        found = Fix.concat(list(recording.stream("/fix", Fix)))
        later = Fix.concat(list(recording.stream("/fix", Fix, start=5, end=8)))
        assert recording.constants("/fix", Fix) == lf.StreamConstants("antenna")
    assert found.latitude.tolist() == [45.0 + number for number in range(12)]
    assert found.status.tolist() == [200 - number for number in range(12)]
    assert later == found[5:8]
    (record,) = caplog.records
    assert "frame_id differs from that of the first message, which is kept, in 3 of 12" in (
        record.getMessage()
    )


def raw(number=3):
    store, message = position(number)
    return bytes(store.serialize_cdr(message, NAME))


def translate(payload, text=POSITION):
    made = translation(Fix, NAME, text.encode())
    data, starts, sizes = made.records(payload, np.array([0]), np.array([len(payload)]))
    return data[starts[0] : starts[0] + sizes[0]]


def test_a_record_may_be_filled_up_to_four_bytes_and_no_further():
    good = raw()
    pad = -(len(good) - 4) % 4
    assert pad
    assert translate(good + bytes(pad)) == translate(good)
    for extra in range(1, 9):
        if extra != pad:
            with pytest.raises(MessageError, match=rf"has {extra} bytes too many"):
                translate(good + bytes(extra))


def test_a_record_cut_off_anywhere_is_told_with_its_member():
    good = raw()
    for size in range(len(good)):
        with pytest.raises(MessageError, match=r"truncated at |not plain"):
            translate(good[:size])


@pytest.mark.parametrize("count", [2**32 - 1, 2**31, 1000])
def test_a_length_beyond_the_record_is_told(count):
    good = raw()
    for at in (12, 24):  # frame_id, source
        wrong = good[:at] + count.to_bytes(4, "little") + good[at + 4 :]
        with pytest.raises(MessageError, match="truncated at"):
            translate(wrong)


def test_a_frame_without_end_has_a_limit():
    store, message = position(1, frame="f" * 5000)
    with pytest.raises(MessageError, match="frame_id has 5001 bytes; at most 4096 are read"):
        translate(bytes(store.serialize_cdr(message, NAME)))


@pytest.mark.parametrize(
    ("text", "why"),
    [
        (POSITION.replace("float64 latitude\n", ""), "Fix needs 'float64 latitude', which "),
        (POSITION.replace("float64 lat", "int32 lat"), "file, but 'int32 latitude'"),
        (POSITION.replace("float64 lat", "float64[] lat"), "file, but 'float64\\[\\] latitude'"),
        (POSITION.replace("uint8 status", "int8 status"), "but 'int8 status'"),
        (POSITION.replace("geometry_msgs/Vector3", "geometry_msgs/Point32"), "missing"),
        (POSITION.replace("std_msgs/Header header\n", ""), "no 'std_msgs/Header header' in this"),
        (POSITION.replace("string source", "wstring source"), "'source' is a wstring"),
        (POSITION.replace("string source", "string"), "'string' declares no member"),
        (POSITION.replace("string source", "a/B b") + "===\nMSG: a/B\nB b\n", "terms of itself"),
        (POSITION.replace("string source", "a/B b"), "the definition of a/msg/B is missing"),
        (
            POSITION.replace("string source", "a/T0 b")
            + "".join(f"===\nMSG: a/T{n}\nT{n + 1} b\n" for n in range(3000)),
            "too deep",
        ),
    ],
)
def test_what_does_not_fit_is_told_with_the_member(text, why):
    with pytest.raises(MessageError, match=why):
        translation(Fix, NAME, text.encode())


def test_defaults_constants_comments_and_short_names_are_understood():
    text = """\
# a comment
Header header   # of std_msgs
uint8 A=1
string NAME = "x # y"
float64 latitude 1.5
string note "a b"
Vector3 variance
uint8 status 7
==========
MSG: geometry_msgs/Vector3
float64 x
float64 y
float64 z
"""
    found = parse("geometry_msgs/msg/Fix", text.encode())
    assert [str(m) for m in found.members] == [
        "std_msgs/msg/Header header",
        "float64 latitude",
        "string note",
        "geometry_msgs/msg/Vector3 variance",
        "uint8 status",
    ]


def test_types_that_double_at_each_level_take_no_time():
    text = POSITION.replace("string source", "a/T0 b") + "".join(
        f"===\nMSG: a/T{n}\nT{n + 1} b\nT{n + 1} c\n" for n in range(40)
    )
    with pytest.raises(MessageError, match="truncated at"):
        translate(raw(), text + "===\nMSG: a/T40\nuint8 x\n")


LISTED = [
    ("/pose", "foxglove.PoseInFrame", "protobuf", "protobuf", "is encoded as 'protobuf' "),
    ("/scan", "foxglove.LaserScan", "jsonschema", "json", "is encoded as 'json' (foxglove.Laser"),
    ("/old", "sensor_msgs/Imu", "ros1msg", "ros1", "is encoded as 'ros1' (sensor_msgs/Imu)"),
    ("/bytes", "", "", "", "is encoded as '' (no type)"),
    ("/points", "sensor_msgs/msg/PointCloud2", "ros2msg", "cdr", "neither lodeflow nor an"),
    ("/imu", "sensor_msgs/msg/Imu", "ros2msg", "cdr", "cannot be read as Imu: "),
]


def test_what_cannot_be_read_is_listed_and_refused_in_one_sentence(tmp_path):
    path = tmp_path / "in.mcap"
    writer = Writer(str(path))
    writer.start()
    for topic, name, form, encoding, _ in LISTED:
        schema = writer.register_schema(name, form, b"uint8 x\n") if name else 0
        channel = writer.register_channel(topic, encoding, schema)
        for number in range(3):
            writer.add_message(channel, number, b"{}", publish_time=number)
    writer.finish()
    said = info(path)
    for topic, name, _, encoding, why in LISTED:
        assert (said.streams[topic].type, said.streams[topic].encoding) == (name, encoding)
        assert said.streams[topic].count == 3
        assert why in said.streams[topic].unread
        with Recording(path) as recording:
            with pytest.raises(RecordingError) as refused:
                recording.kind(topic)
            assert str(refused.value).startswith(f"{path}: '{topic}' ")
            assert why in str(refused.value)
            with pytest.raises(RecordingError, match=rf"in\.mcap: '{topic}' "):
                recording.stream(topic, lf.Imu)


def test_two_definitions_of_one_topic_are_refused(tmp_path):
    path = tmp_path / "in.mcap"
    writer = Writer(str(path))
    writer.start()
    for text in (POSITION, POSITION.replace("source", "origin")):
        schema = writer.register_schema(NAME, "ros2msg", text.encode())
        writer.register_channel("/fix", "cdr", schema)
    writer.finish()
    with Recording(path) as recording, pytest.raises(RecordingError, match="several definitions"):
        recording.stream("/fix", Fix)
