"""Compare on what does not stand in declared fields: definitions, undeclared members, hosts."""

import json

import numpy as np
from recordings import random_block, record

from lodeflow.messages.cdr import StreamConstants, layout_of
from lodeflow.messages.ros import schema_text
from lodeflow.messages.vocabulary import Heading, Imu
from lodeflow.recording.compare import compare
from lodeflow.recording.mcap.writer import McapWriter

IMU = random_block(Imu, range(0, 4000, 10))


def test_what_a_type_does_not_declare_counts_too(tmp_path):
    block = IMU[:6]
    constants = StreamConstants.of(Imu)
    frame = StreamConstants("imu_link", constants.values)
    values = tuple(
        (path, (0.5,) * 9 if path == "angular_velocity_covariance" else value)
        for path, value in constants.values
    )
    files = []
    for name, chosen in {
        "a": constants,
        "frame": frame,
        "values": StreamConstants(constants.frame_id, values),
    }.items():
        files.append(tmp_path / f"{name}.mcap")
        with McapWriter(files[-1]) as writer:
            channel = writer.channel("/imu", Imu.ros, schema_text(Imu))
            writer.write(channel, block.t, layout_of(Imu, chosen).encode_block(block))
    a, other_frame, other_values = files
    first = compare(a, other_frame, tolerance=1).streams["/imu"].first
    assert (first.field, first.a, first.b) == ("header.frame_id", "body", "imu_link")
    found = compare(a, other_values, tolerance=1).streams["/imu"]
    assert (found.first.field, found.beyond) == ("angular_velocity_covariance", 6)


def test_the_definition_counts_without_its_comments(tmp_path):
    block = random_block(Heading, range(4))
    text = schema_text(Heading)
    paths = []
    for name, schema in {
        "a": text,
        "comment": "# Another word.\n" + text.replace("float64 heading", "float64   heading  # !"),
        "member": text.replace("float64 heading", "float64 bearing"),
        "constant": "uint8 NORTH=0\n" + text,
    }.items():
        paths.append(tmp_path / f"{name}.mcap")
        with McapWriter(paths[-1]) as writer:
            channel = writer.channel("/heading", Heading.ros, schema)
            writer.write(channel, block.t, layout_of(Heading).encode_block(block))
    a, comment, member, constant = paths
    assert compare(a, comment).same
    for other in (member, constant):
        assert compare(a, other).streams["/heading"].verdict == "another definition"


def bytes_of(path, messages):
    with McapWriter(path) as writer:
        channel = writer.channel("/foreign", "other_msgs/msg/Text", "string data\n")
        for t, data in messages:
            row = np.frombuffer(data, dtype=np.uint8)[None]
            writer.write(channel, np.array([t]), row)
    return path


def test_types_that_lodeflow_does_not_know_are_compared_by_bytes(tmp_path):
    a = bytes_of(tmp_path / "a.mcap", [(1, b"one"), (2, b"four"), (3, b"three")])
    b = bytes_of(tmp_path / "b.mcap", [(1, b"one"), (2, b"fore"), (3, b"thirteen")])
    assert compare(a, a).same
    stream = compare(a, b, tolerance=100).streams["/foreign"]
    assert (stream.beyond, stream.largest) == (2, {})
    assert (stream.first.number, stream.first.field) == (1, "byte 2")
    assert (stream.first.a, stream.first.b) == (ord("u"), ord("r"))


def test_log_times_that_repeat_are_paired_by_number(tmp_path):
    a = bytes_of(tmp_path / "a.mcap", [(1, b"a"), (1, b"b"), (1, b"c"), (4, b"d")])
    b = bytes_of(tmp_path / "b.mcap", [(1, b"a"), (1, b"c"), (1, b"c"), (5, b"d"), (5, b"e")])
    stream = compare(a, a).streams["/foreign"]
    assert (stream.same, stream.paired, stream.shared) == (True, "number", 4)
    stream = compare(a, b).streams["/foreign"]
    assert (stream.unequal, stream.lone) == (2, [0, 1])
    assert (stream.first.number, stream.first.field) == (1, "byte 0")


def test_other_cpu_features_and_versions_are_said_where_streams_differ(tmp_path):
    other = IMU.replace(angular_velocity=IMU.angular_velocity + 1e-15)
    kinds = {"cpu_features": "AVX2 SSE", "versions": json.dumps({"numpy": "2.0"})}
    a = record(tmp_path / "a.mcap", {"/imu": IMU}, provenance=kinds)
    kinds = {"cpu_features": "AVX512F SSE", "versions": json.dumps({"numpy": "2.4"})}
    b = record(tmp_path / "b.mcap", {"/imu": other}, provenance=kinds)
    c = record(tmp_path / "c.mcap", {"/imu": IMU}, provenance=kinds)
    d = record(tmp_path / "d.mcap", {"/imu": IMU[:5]})
    notes = compare(a, b).notes
    assert notes[0].startswith("the CPU features differ (only A: AVX2; only B: AVX512F)")
    assert notes[1] == "versions differ: numpy 2.0 / 2.4"
    assert compare(a, c).notes == compare(b, c).notes == compare(a, d).notes == []
