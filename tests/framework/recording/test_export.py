"""Exported tables, read back by csv and pyarrow, hold every bit of the recording."""

import csv
import sys

import numpy as np
import pyarrow.parquet as pq
import pytest
from recordings import HEADING, IMU, write

from lodeflow.errors import RecordingError
from lodeflow.messages.cdr import layout_of
from lodeflow.messages.ros import schema_text
from lodeflow.messages.vocabulary import AttitudeTruth
from lodeflow.recording.export import export
from lodeflow.recording.mcap.writer import McapWriter
from lodeflow.recording.reader import Recording

IMU_HEADERS = [
    "t_ns",
    "angular_velocity.x [rad/s]",
    "angular_velocity.y [rad/s]",
    "angular_velocity.z [rad/s]",
    "linear_acceleration.x [m/s²]",
    "linear_acceleration.y [m/s²]",
    "linear_acceleration.z [m/s²]",
]


def rows(path):
    if path.suffix == ".csv":
        with path.open(encoding="utf-8", newline="") as file:
            header, *found = csv.reader(file)
        return header, np.array(found, dtype=float)
    table = pq.read_table(path)
    assert str(table.schema.types[0]) == "int64"
    return table.column_names, np.stack([column.to_numpy() for column in table.columns], axis=1)


@pytest.fixture
def recording(tmp_path):
    with Recording(write(tmp_path / "run.mcap")) as found:
        yield found


@pytest.mark.parametrize("form", ["csv", "parquet"])
def test_all_streams_into_a_folder(recording, tmp_path, form):
    files, unknown = export(recording, form, tmp_path / "new" / "tables")
    assert unknown == {}
    assert {topic: path.name for topic, path in files.items()} == {
        "/heading": f"heading.{form}",
        "/imu": f"imu.{form}",
    }
    header, found = rows(files["/imu"])
    assert header == IMU_HEADERS
    columns = [IMU.t[:, None], IMU.angular_velocity, IMU.linear_acceleration]
    assert np.array_equal(found, np.concatenate(columns, axis=1))
    header, found = rows(files["/heading"])
    assert header == ["t_ns", "heading [rad]"]
    assert np.array_equal(found[:, 1], HEADING.heading)  # to the last bit


@pytest.mark.parametrize("form", ["csv", "parquet"])
def test_one_stream_into_a_file(recording, tmp_path, form):
    for name in ("imu", "/imu"):
        out = tmp_path / f"one{len(name)}.{form}"
        assert export(recording, form, out, [name]) == ({"/imu": out}, {})
        assert len(rows(out)[1]) == 100
    files, _ = export(recording, form, tmp_path / "folder", ["imu"])
    assert files["/imu"].is_file()


@pytest.mark.parametrize("form", ["csv", "parquet"])
def test_gaps_integers_and_quaternions(tmp_path, form):
    quaternion = np.random.default_rng(1).standard_normal((3, 4))
    quaternion[1] = np.nan
    block = AttitudeTruth(np.array([1, 2, 2**53 + 1]), quaternion, np.array([0, 255, 7]))
    with McapWriter(tmp_path / "a.mcap") as writer:
        channel = writer.channel("/a/truth", block.ros, schema_text(AttitudeTruth))
        writer.write(channel, block.t, layout_of(AttitudeTruth).encode_block(block))
    with Recording(tmp_path / "a.mcap") as recording:
        files, _ = export(recording, form, tmp_path)
    path = tmp_path / f"a.truth.{form}"
    assert files == {"/a/truth": path}
    header, found = rows(path)
    assert header == ["t_ns", *(f"quaternion.{axis}" for axis in "xyzw"), "moving"]
    assert np.array_equal(found[:, 1:5], quaternion, equal_nan=True)
    assert found[:, 5].tolist() == [0, 255, 7]
    text = path.read_text().splitlines()[-1] if form == "csv" else str(pq.read_table(path)["t_ns"])
    assert str(2**53 + 1) in text


def test_types_that_lodeflow_does_not_know(tmp_path):
    with McapWriter(tmp_path / "a.mcap") as writer:
        writer.channel("/odd", "other_msgs/msg/Odd", "string data\n")
        writer.channel("/odd/imu", IMU.ros, schema_text(type(IMU)))
    with Recording(tmp_path / "a.mcap") as recording:
        files, unknown = export(recording, "csv", tmp_path)
        assert (list(files), list(unknown)) == (["/odd/imu"], ["/odd"])
        assert rows(files["/odd/imu"])[0] == IMU_HEADERS
        with pytest.raises(RecordingError, match="'/odd' holds other_msgs/msg/Odd, and neit"):
            export(recording, "csv", tmp_path, ["odd"])


def test_mistakes(recording, tmp_path):
    with pytest.raises(RecordingError, match=r"no stream 'imo', did you mean 'imu'\? .*heading, "):
        export(recording, "csv", tmp_path, ["imo"])
    with pytest.raises(RecordingError, match="no format 'cvs', did you mean 'csv'"):
        export(recording, "cvs", tmp_path)
    (tmp_path / "imu.csv").write_text("precious")
    with pytest.raises(RecordingError, match=r"imu\.csv: exists; remove it"):
        export(recording, "csv", tmp_path)
    assert not (tmp_path / "heading.csv").exists()
    assert (tmp_path / "imu.csv").read_text() == "precious"
    with pytest.raises(RecordingError, match=r"imu\.csv.*: cannot be written: Not a dir"):
        export(recording, "csv", tmp_path / "imu.csv" / "x")


def test_parquet_without_its_package_names_the_extra(recording, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    with pytest.raises(RecordingError, match=r"pip install 'lodeflow\[parquet\]'"):
        export(recording, "parquet", tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_row_groups_are_not_as_small_as_chunks(recording, tmp_path):
    files, _ = export(recording, "parquet", tmp_path / "out")
    assert pq.ParquetFile(files["/heading"]).num_row_groups == 1
