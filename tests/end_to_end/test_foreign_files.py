"""Files that others wrote, and files that are damaged, at the command line."""

from __future__ import annotations

import json
import random
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from command_line import InProcess
from mcap.writer import Writer
from readers import records
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as RosbagWriter
from rosbags.typesys import Stores, get_typestore

TYPES = get_typestore(Stores.ROS2_HUMBLE)
GRAPH = """\
lodeflow: 1
name: drive
nodes:
  s: {use: recorded_sensors, params: {file: drive.mcap, imu: /imu, mag: /mag}}
  f: {use: "forwarding:Forward", inputs: {imu: s.imu}}
record: {to: run.mcap}
"""
FORWARDING = """\
import lodeflow as lf

class Forward(lf.Node):
    def step_block(self, imu: lf.Imu) -> lf.Imu:
        return imu
"""


def stamped(name: str, t: int, frame: str, *values: Any) -> bytes:
    known = TYPES.types
    stamp = known["builtin_interfaces/msg/Time"](*divmod(t, 10**9))
    header = known["std_msgs/msg/Header"](stamp, frame)
    return bytes(TYPES.serialize_cdr(known[name](header, *values), name))


def imu(t: int, frame: str = "imu_link", covariance: float = 0.25) -> bytes:
    known = TYPES.types
    vector = known["geometry_msgs/msg/Vector3"]
    return stamped(
        "sensor_msgs/msg/Imu", t, frame,
        known["geometry_msgs/msg/Quaternion"](0.0, 0.0, 0.6, 0.8), np.full(9, covariance),
        vector(0.1, t * 1e-9, 0.3), np.arange(9.0), vector(0.0, 0.1, 9.81), np.arange(9.0) / 7,
    )  # fmt: skip


def field(t: int) -> bytes:
    vector = TYPES.types["geometry_msgs/msg/Vector3"](2e-5, 0.0, -4e-5)
    return stamped("sensor_msgs/msg/MagneticField", t, "mag_é", vector, np.eye(3).ravel() * 1e-12)


def write_bag(folder: Path, varying: bool = False) -> Path:
    """Write a bag of rosbags, and return its file under the name that the graph has for it."""
    with RosbagWriter(folder / "bag", version=9, storage_plugin=StoragePlugin.MCAP) as bag:
        kinds = {"/imu": "sensor_msgs/msg/Imu", "/mag": "sensor_msgs/msg/MagneticField"}
        made = {topic: bag.add_connection(topic, k, typestore=TYPES) for topic, k in kinds.items()}
        for number in range(100):
            t = 10**9 + number * 10**7
            strange = varying and number >= 90
            frame, covariance = ("roof", 1.0) if strange else ("imu_link", 0.25)
            bag.write(made["/imu"], t, imu(t, frame, covariance))
            bag.write(made["/mag"], t, field(t))
    (path,) = (folder / "bag").glob("*.mcap")
    return path.rename(folder / "drive.mcap")


@pytest.fixture
def drive(quick: InProcess, monkeypatch: pytest.MonkeyPatch) -> InProcess:
    monkeypatch.syspath_prepend(str(quick.folder))
    quick.write("forwarding.py", FORWARDING)
    quick.write("graph.yaml", GRAPH)
    return quick


def test_frames_and_covariances_go_through_a_run_and_its_replay(drive: InProcess) -> None:
    bag = records(write_bag(drive.folder))
    drive("run", "graph.yaml")
    drive("replay", "run.mcap", "--record", "again.mcap")
    for name in ("run.mcap", "again.mcap"):
        found = records(drive.folder / name)
        assert found["/s/imu"] == bag["/imu"]  # to the byte, as rosbags wrote them
        assert found["/s/mag"] == bag["/mag"]
        assert found["/f"] != bag["/imu"]  # what is computed has the defaults of its type
    drive("compare", "run.mcap", "again.mcap")
    assert "equal to the byte" in drive("replay", "run.mcap", "--check").stdout


def test_what_varies_is_counted(drive: InProcess) -> None:
    write_bag(drive.folder, varying=True)
    told = drive("run", "graph.yaml").stderr
    assert (
        "'/imu': frame_id differs from that of the first message, which is kept, in 10 of 100"
        in (told)
    )
    drive("replay", "run.mcap", "--check")
    first = records(drive.folder / "run.mcap")["/s/imu"]
    assert first == [(t, imu(t)) for t, _ in first]


def test_other_encodings_are_listed_and_refused_in_one_sentence(drive: InProcess) -> None:
    writer = Writer(str(drive.folder / "drive.mcap"))
    writer.start()
    kinds = [
        ("/imu", "foxglove.Imu", "protobuf", "protobuf"),
        ("/pose", "foxglove.PoseInFrame", "jsonschema", "json"),
        ("/points", "sensor_msgs/msg/PointCloud2", "ros2msg", "cdr"),
    ]
    for topic, name, form, encoding in kinds:
        schema = writer.register_schema(name, form, b"uint8 x\n")
        channel = writer.register_channel(topic, encoding, schema)
        writer.add_message(channel, 1, b"\0", 1)
    writer.finish()
    text = drive("info", "drive.mcap").stdout
    assert "foxglove.Imu (protobuf)" in text
    assert "listed only: 'pose' is encoded as 'json' (foxglove.PoseInFrame); only 'cdr'" in text
    assert "listed only: 'points' holds sensor_msgs/msg/PointCloud2, and neither lodeflow" in text
    told = drive("run", "graph.yaml", code=1).stderr
    assert "'/imu' is encoded as 'protobuf' (foxglove.Imu); only 'cdr' (ROS 2) can be read" in told
    assert not (drive.folder / "run.mcap").exists()
    told = drive("export", "drive.mcap", "--to", "csv", "out", "pose", code=1).stderr
    assert "drive.mcap: '/pose' is encoded as 'json'" in told
    assert "equal" in drive("compare", "drive.mcap", "drive.mcap").stdout


def test_no_command_breaks_on_a_damaged_file(drive: InProcess) -> None:
    write_bag(drive.folder)
    drive("run", "graph.yaml")
    good = (drive.folder / "run.mcap").read_bytes()
    rng = random.Random(3)
    codes = set()
    for number in range(40):
        data = bytearray(good)
        for _ in range(rng.randint(1, 3)):
            at = rng.randrange(len(data))
            match rng.randrange(4):
                case 0:
                    data[at] ^= 1 << rng.randrange(8)
                case 1:
                    del data[at:]
                case 2:
                    del data[at : at + rng.randrange(100)]
                case _:
                    data[at : at + 8] = b"\xff" * 8
            data = data or bytearray(b"\x89")
        (drive.folder / "bad.mcap").write_bytes(data)
        for arguments in (
            ["info", "bad.mcap"],
            ["info", "--json", "bad.mcap"],
            ["compare", "bad.mcap", "run.mcap"],
            ["export", "bad.mcap", "--to", "csv", f"tables{number}"],
            ["replay", "bad.mcap", "--no-record"],
            ["recover", "bad.mcap", f"mended{number}.mcap"],
        ):
            done = drive.attempt(*arguments)
            codes.add(done.returncode)
            assert done.returncode in (0, 1, 2)
            assert done.returncode == 0 or "bad.mcap" in done.stderr + done.stdout
            assert "lodeflow itself failed" not in done.stderr
        mended = drive.folder / f"mended{number}.mcap"
        if mended.exists():
            assert json.loads(drive("info", mended, "--json").stdout)["recovery"]
    assert {0, 1} <= codes
