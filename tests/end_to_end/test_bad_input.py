"""Bad input: one clear message, or counted and reported; nothing recorded is lost."""

from __future__ import annotations

import json
import os
import threading
from pathlib import Path

import pytest
from command_line import CommandLine
from readers import records

CSV_GRAPH = """\
lodeflow: 1
name: table
nodes:
  sensors:
    use: csv
    params:
      file: sensors.csv
      time: {column: t, unit: ms}
      angular_velocity: {columns: [gx, gy, gz], unit: deg/s}
      linear_acceleration: {columns: [ax, ay, az], unit: g}
  watch: {use: "watching:Watch", inputs: {imu: sensors.imu}}
record: {to: out.mcap}
"""
WATCHING = """\
import lodeflow as lf

class Watch(lf.Node):
    '''Fails where the angular rate is above a limit.'''
    def step(self, imu: lf.Imu) -> lf.AngularRate:
        if imu.angular_velocity[0] > 1.0:
            raise ArithmeticError("too fast")
        return lf.AngularRate(imu.t, imu.angular_velocity)
"""
HEADER = "t,gx,gy,gz,ax,ay,az\n"


@pytest.fixture
def table(lodeflow: CommandLine) -> CommandLine:
    lodeflow.write("watching.py", WATCHING)
    lodeflow.write("graph.yaml", CSV_GRAPH)
    return lodeflow


def rows(*cells: str) -> str:
    return HEADER + "".join(f"{row}\n" for row in cells)


def test_good_rows_pass_in_si_units(table: CommandLine) -> None:
    table.write("sensors.csv", rows("0,45,0,0,0,0,1", "10,0,0,0,0,0,1"))
    summary = json.loads(table("run", "graph.yaml", "--json").stdout)
    assert summary["streams"] == {
        "sensors.imu": 2,
        "sensors.mag": 0,
        "sensors.truth": 0,
        "watch": 2,
    }
    assert [t for t, _ in records(table.folder / "out.mcap")["/watch"]] == [0, 10_000_000]


@pytest.mark.parametrize(
    ("second", "why"),
    [
        ("10,nan,0,0,0,0,1", "nonfinite"),
        ("10,inf,0,0,0,0,1", "nonfinite"),
        ("10,,0,0,0,0,1", "nonfinite"),
        ("0,1,0,0,0,0,1", "disorder"),
        ("-5,1,0,0,0,0,1", "disorder"),
    ],
)
def test_bad_samples_are_dropped_counted_and_fail_the_run_unless_allowed(
    table: CommandLine, second: str, why: str
) -> None:
    table.write("sensors.csv", rows("0,1,0,0,0,0,1", second, "20,1,0,0,0,0,1"))
    done = table("run", "graph.yaml", code=1)
    assert f"sensors: LOST 1 ({why})" in done.stdout
    found = records(table.folder / "out.mcap")
    assert [t for t, _ in found["/watch"]] == [0, 20_000_000]
    allowed = CSV_GRAPH.replace("use: csv", f"use: csv\n    allow: [{why}]")
    table.write("allowed.yaml", allowed.replace("out.mcap", "allowed.mcap"))
    done = table("run", "allowed.yaml")
    assert f"sensors: LOST 1 ({why})" in done.stdout


@pytest.mark.parametrize(
    ("content", "expected"),
    [
        (rows("0,1,0,0,0,0,one"), "sensors.csv:2:az: 'one' is not a number"),
        (rows("0,1,0,0"), "sensors.csv:2: 4 cells, but the header has 7"),
        (rows("0,1,0,0,0,0,1").replace("gx", "gX"), "sensors.csv:1:gx: no such column"),
        (
            rows("0,1,0,0,0,0,1").replace("gx", "gx [rad/s]"),
            "sensors.csv:1:gx [rad/s]: the header says rad/s, the graph deg/s; make them equal or "
            "leave one out",
        ),
        (rows("0,1,0,0,0,0,1").replace("ax", "ax [uT]"), "1:ax [uT]: 'uT' is not a unit of m/s²"),
        ("", "sensors.csv:1: empty"),
        (rows("soon,1,0,0,0,0,1"), "sensors.csv:2:t: 'soon' is not a time stamp"),
    ],
)
def test_a_wrong_table_is_told_with_its_place(
    table: CommandLine, content: str, expected: str
) -> None:
    table.write("sensors.csv", content)
    done = table("run", "graph.yaml", code=1)
    assert expected in done.stderr
    assert "node 'sensors' (CsvFile.read) failed" in done.stderr


def test_a_wrong_unit_in_the_graph_is_told_with_its_place(table: CommandLine) -> None:
    table.write("sensors.csv", rows("0,1,0,0,0,0,1"))
    table.write("graph.yaml", CSV_GRAPH.replace("unit: g}", "unit: LSB}"))
    done = table("run", "graph.yaml", code=2)
    line = 1 + CSV_GRAPH.splitlines().index(
        "      linear_acceleration: {columns: [ax, ay, az], unit: g}"
    )
    assert f"graph.yaml:{line}:" in done.stderr
    assert "'LSB' is not a unit of m/s²" in done.stderr


def test_the_rows_before_a_bad_one_are_recorded(table: CommandLine) -> None:
    table.write("sensors.csv", rows("0,1,0,0,0,0,1", "10,1,0,0,0,0,1", "20,1,0,0,0,0,one"))
    done = table("run", "graph.yaml", code=1)
    assert "sensors.csv:4:az: 'one' is not a number" in done.stderr
    assert [t for t, _ in records(table.folder / "out.mcap")["/watch"]] == [0, 10_000_000]


def test_an_unreadable_file(table: CommandLine) -> None:
    done = table("run", "graph.yaml", code=1)
    assert "No such file or directory: 'sensors.csv'" in done.stderr


def test_a_plugin_that_raises_is_named_with_stamp_and_input_and_the_recording_is_closed(
    table: CommandLine,
) -> None:
    table.write("sensors.csv", rows("0,1,0,0,0,0,1", "10,1,0,0,0,0,1", "20,99,0,0,0,0,1"))
    done = table("run", "graph.yaml", code=1)
    assert (
        "node 'watch' (Watch.step) failed at t=20000000 on imu=sensors.imu: "
        "ArithmeticError: too fast" in done.stderr
    )
    found = records(table.folder / "out.mcap")
    assert len(found["/sensors/imu"]) == 3


def test_a_parameter_out_of_range_is_told_with_its_place(
    lodeflow: CommandLine, graphs: Path
) -> None:
    done = lodeflow("run", graphs / "heading.yaml", "--set", "fuser.gyro_noise=-1", code=2)
    assert "--set fuser.gyro_noise=-1" in done.stderr
    assert "should be at least 0 rad/s, got -1" in done.stderr


def test_a_typing_error_in_an_option_is_told(lodeflow: CommandLine, graphs: Path) -> None:
    done = lodeflow("run", graphs / "heading.yaml", "--set", "fuser.gyro_nois=1", code=2)
    assert "did you mean 'gyro_noise'?" in done.stderr
    done = lodeflow("run", graphs / "heading.yaml", "--swap", "fuser=chu_fusr", code=2)
    assert "did you mean 'chu_fuser'?" in done.stderr
    lodeflow("run", graphs / "heading.yaml", "--no-such-option", code=2)
    lodeflow("run", "missing.yaml", code=2)


def test_check_prints_all_problems_and_exits_1(lodeflow: CommandLine, graphs: Path) -> None:
    text = (graphs / "heading.yaml").read_text().replace("mag_calibrator", "mag_calibrater")
    lodeflow.write("bad.yaml", text.replace("heading_from_attitude", "heading_of_attitude"))
    done = lodeflow("check", "bad.yaml", code=1)
    assert "bad.yaml:15:10: nodes.mag_cal.use: no plugin 'mag_calibrater'" in done.stderr
    assert "did you mean 'mag_calibrator'?" in done.stderr
    assert "did you mean 'heading_from_attitude'?" in done.stderr
    assert "good" in lodeflow("check", graphs / "heading.yaml").stdout


def test_a_graph_in_a_pipe_is_checked_as_in_a_file(lodeflow: CommandLine, graphs: Path) -> None:
    os.mkfifo(lodeflow.folder / "pipe")
    text = (graphs / "heading.yaml").read_bytes()
    writer = threading.Thread(target=(lodeflow.folder / "pipe").write_bytes, args=(text,))
    writer.start()
    assert "pipe: " in lodeflow("check", "pipe").stdout
    writer.join()
