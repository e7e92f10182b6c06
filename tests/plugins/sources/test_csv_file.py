"""Reading CSV files: mapping, units, stamps, gaps, memory, and where a mistake is."""

import tracemalloc

import numpy as np
import pytest
from pydantic import ValidationError

from lodeflow.clock import SimClock
from lodeflow.graph import load_graph_text
from lodeflow.supervisor.run import run
from lodeflow_plugins.sources.csv_file import CsvFile

MAG = {"magnetic_field": {"columns": ["mx", "my", "mz"], "unit": "uT"}}
IMU = {
    "angular_velocity": {"columns": ["gx", "gy", "gz"], "unit": "deg/s"},
    "linear_acceleration": {"columns": ["ax", "ay", "az"], "unit": "g"},
}
TIME = {"time": {"column": "t", "unit": "ms"}}


@pytest.fixture
def read(tmp_path):
    def reading(text, start=0, **params):
        path = tmp_path / "log.csv"
        path.write_text(text, encoding="utf-8")
        parts = list(CsvFile(CsvFile.Params(file=str(path), **params)).read(SimClock(start)))
        return {
            name: None if block is None else type(block).concat([getattr(p, name) for p in parts])
            for name, block in parts[0]._asdict().items()
        }

    return reading


def test_columns_become_ports_in_si_units(read):
    text = (
        "note,t,gx,gy,gz,ax,ay,az,mx,my,mz,qx,qy,qz,qw,ok\n"
        "hello,0,180,0,-90,0,0,1,20,-1,-40,0,0,0,1,0\n"
        "world,10.5,0,0,0,0,0.5,1,21,-1,-41,0,0,nan,1,1\n"
    )
    truth = {"quaternion": ("qx", "qy", "qz", "qw"), "moving": "ok"}
    ports = read(text, **TIME, **IMU, **MAG, **truth)
    for block in ports.values():
        block.validate()
        assert block.t.tolist() == [0, 10_500_000]
    imu = ports["imu"]
    np.testing.assert_allclose(imu.angular_velocity[0], [np.pi, 0, -np.pi / 2])
    np.testing.assert_allclose(imu.linear_acceleration[1], [0, 0.5 * 9.80665, 9.80665])
    np.testing.assert_allclose(ports["mag"].magnetic_field[0], [20e-6, -1e-6, -40e-6])
    assert ports["truth"].moving.tolist() == [0, 1]
    assert np.isnan(ports["truth"].quaternion).tolist() == [
        [False] * 4,
        [False, False, True, False],
    ]


def test_unit_from_the_header(read):
    text = "t,mx [mG],my (mG),mz[ mG ]\n0,100,200,-300\n"
    ports = read(text, **TIME, magnetic_field={"columns": ["mx [mG]", "my", "mz"]})
    np.testing.assert_allclose(ports["mag"].magnetic_field[0], [1e-5, 2e-5, -3e-5])
    assert ports["imu"] is None


@pytest.mark.parametrize(
    ("cell", "unit", "t"),
    [
        ("1700000000.123456789", "s", 1_700_000_000_123_456_789),
        ("1700000000123456789", "ns", 1_700_000_000_123_456_789),
        ("1700000000123.456789", "ms", 1_700_000_000_123_456_789),
        ("-2.5e3", "us", -2_500_000),
        (" 0.0000000004", "s", 0),
    ],
)
def test_stamps_are_exact(read, cell, unit, t):
    ports = read(f"t,mx,my,mz\n{cell},1,2,3\n", time={"column": "t", "unit": unit}, **MAG)
    assert ports["mag"].t.tolist() == [t]


def test_a_rate_in_the_place_of_stamps(read):
    text = "mx,my,mz\n" + "1,2,3\n" * 2100
    ports = read(text, start=10**9, rate="0.3 kHz", **MAG)
    assert ports["mag"].t.tolist() == [10**9 + round(i * 1e9 / 300) for i in range(2100)]


def test_a_slow_sensor_leaves_its_cells_empty(read):
    text = (
        "t;gx;gy;gz;ax;ay;az;mx;my;mz\n0;1;1;1;0;0;1;1;2;3\n1;1;1;1;0;0;1;;; \n2;1;1;1;0;0;1;;5;6\n"
    )
    ports = read(text, **TIME, **IMU, **MAG, delimiter=";")
    assert ports["imu"].t.tolist() == [0, 1_000_000, 2_000_000]
    assert ports["mag"].t.tolist() == [0, 2_000_000]
    assert np.isnan(ports["mag"].magnetic_field).tolist() == [[False] * 3, [True, False, False]]


def test_nan_is_dropped_and_counted_by_the_framework(tmp_path):
    (tmp_path / "log.csv").write_text("t,mx,my,mz\n0,1,2,3\n1,nan,2,3\n2,1,2,3\n2,1,2,3\n")
    graph = load_graph_text(f"""
lodeflow: 1
name: log
nodes:
  file:
    use: csv
    params:
      file: {tmp_path / "log.csv"}
      time: {{column: t, unit: ms}}
      magnetic_field: {{columns: [mx, my, mz], unit: uT}}
""")
    summary = run(graph)
    assert summary.counters["file"].sent["mag"] == 2
    assert summary.counters["file"].lost == {"nonfinite": 1, "disorder": 1}
    assert summary.exit_code == 1


BAD = {
    "log.csv:1:my: no such column (the file has t, mx, mz)": "t,mx,mz\n0,1,3\n",
    "log.csv:1:my: no such column, did you mean 'MY'? (the file has t, mx, MY [uT], mz)": (
        "t,mx,MY [uT],mz\n0,1,2,3\n"
    ),
    "log.csv:1:mx: the header has it more than once": "t,mx,mx,my,mz\n0,1,1,2,3\n",
    "log.csv:3:my: 'two' is not a number": "t,mx,my,mz\n0,1,2,3\n1,1,two,3\n",
    "log.csv:4: 3 cells, but the header has 4": "t,mx,my,mz\n0,1,2,3\n\n1,1,3\n",
    "log.csv:3:t: 'soon' is not a time stamp": "t,mx,my,mz\n0,1,2,3\nsoon,1,2,3\n",
    "log.csv:2:t: '' is not a time stamp": "t,mx,my,mz\n,1,2,3\n",
    "log.csv:2:t: 'nan' is not a time stamp": "t,mx,my,mz\nnan,1,2,3\n",
    "log.csv:2:t: '1e300' is not a time stamp": "t,mx,my,mz\n1e300,1,2,3\n",
    "log.csv:1: empty; the first line should name the columns": "",
}


@pytest.mark.parametrize("message", BAD)
def test_a_mistake_is_told_with_its_place(read, message):
    with pytest.raises(ValueError, match=r"log\.csv") as raised:
        read(BAD[message], **TIME, **MAG)
    assert str(raised.value).endswith(message)


def test_a_wrong_unit_in_the_header_is_told_with_its_place(read):
    text = "t,mx,my [V],mz\n0,1,2,3\n"
    for unit in ({}, {"unit": "uT"}):
        with pytest.raises(ValueError, match=r"log\.csv:1:my \[V\]: 'V' is not a unit of T"):
            read(text, **TIME, magnetic_field={"columns": ["mx", "my", "mz"], **unit})


@pytest.mark.parametrize(
    ("header", "params", "why"),
    [
        ("t,mx,my [mG],mz", {**TIME, **MAG}, "my [mG]: the header says mG, the graph uT"),
        ("t (us),mx,my,mz", {**TIME, **MAG}, "t (us): the header says us, the graph ms"),
    ],
)
def test_a_unit_in_the_header_must_not_contradict_the_graph(read, header, params, why):
    with pytest.raises(ValueError, match=r"log\.csv:1:") as raised:
        read(f"{header}\n0,1,2,3\n", **params)
    assert str(raised.value).endswith(f"log.csv:1:{why}; make them equal or leave one out")


def test_two_spellings_of_one_unit_do_not_contradict(read):
    ports = read("t [ms],mx [µT],my [uT],mz\n7,1,2,3\n", **TIME, **MAG)
    np.testing.assert_allclose(ports["mag"].magnetic_field[0], [1e-6, 2e-6, 3e-6])
    assert ports["mag"].t.tolist() == [7_000_000]


def test_each_column_converts_by_the_unit_in_its_own_header(read):
    text = "t [us],mx [mG],my [nT],mz\n5,100,200,3\n"
    columns = {"columns": ["mx", "my", "mz"]}
    ports = read(text, time={"column": "t"}, magnetic_field=columns)
    np.testing.assert_allclose(ports["mag"].magnetic_field[0], [1e-5, 2e-7, 3])
    assert ports["mag"].t.tolist() == [5000]


def test_a_wrong_unit_in_the_header_of_the_stamps_is_told_with_its_place(read):
    with pytest.raises(ValueError, match=r"log\.csv:1:t \[h\]: 'h' is not a unit of time stamps"):
        read("t [h],mx,my,mz\n0,1,2,3\n", time={"column": "t"}, **MAG)


def note_stamps(reading, seen):
    for ports in reading:
        seen += ports.mag.t.tolist()


GOOD = b"t,mx,my,mz\n0,1,2,3\n1,1,2,3\n"


@pytest.mark.parametrize(
    ("bad", "why"),
    [
        (b"2,1,2\n", "4: 3 cells, but the header has 4"),
        (b"2,1,two,3\n", "4:my: 'two' is not a number"),
        (b"soon,1,2,3\n", "4:t: 'soon' is not a time stamp"),
        # By column, the last line is met first.
        (b"2,1,2,three\n3,one,2,3\n", "4:mz: 'three' is not a number"),
        (b"2,1,2,three\n3,1,2\n", "4:mz: 'three' is not a number"),
        ("2,1,2,3°\n".encode("latin-1"), "4: not UTF-8 (byte 0xb0); save it as UTF-8"),
        (b"2,1,2," + b"3" * 140_000 + b"\n", "4: field larger than field limit (131072)"),
    ],
)
@pytest.mark.parametrize("rows", [1, 2, 1000])
def test_the_rows_before_a_bad_one_pass(tmp_path, monkeypatch, bad, why, rows):
    monkeypatch.setattr(CsvFile, "rows", rows)
    path = tmp_path / "log.csv"
    path.write_bytes(GOOD + bad + b"9,1,2,3\n")
    reading = CsvFile(CsvFile.Params(file=str(path), **TIME, **MAG)).read(SimClock())
    seen = []
    with pytest.raises(ValueError, match=r"log\.csv:4:") as raised:
        note_stamps(reading, seen)
    assert str(raised.value) == f"{path}:{why}"
    assert seen == [0, 1_000_000]


def test_a_header_that_is_not_utf_8_is_told_with_its_place(tmp_path):
    path = tmp_path / "log.csv"
    params = CsvFile.Params(file=str(path), **TIME, **MAG)
    for content, byte in (("t,mx [µT],my,mz\n", "b5"), ("t,mx,my,mz\n", "ff")):
        path.write_bytes(content.encode("latin-1" if byte == "b5" else "utf-16"))
        with pytest.raises(ValueError, match=rf"log\.csv:1: not UTF-8 \(byte 0x{byte}\)"):
            list(CsvFile(params).read(SimClock()))


def test_moving_is_0_or_1(read):
    with pytest.raises(ValueError, match=r"log\.csv:3:ok: '2' should be 0 or 1"):
        read(
            "t,a,b,c,d,ok\n0,0,0,0,1,1\n1,0,0,0,1,2\n",
            **TIME, quaternion=("a", "b", "c", "d"), moving="ok",
        )  # fmt: skip


@pytest.mark.parametrize(
    ("params", "why"),
    [
        (MAG, "give one of time and rate"),
        ({**TIME, **MAG, "rate": 100}, "give one of time and rate"),
        ({**MAG, "rate": "2000 kHz"}, "less than or equal to 1000000"),
        ({**TIME, "angular_velocity": IMU["angular_velocity"]}, "imu needs both"),
        (TIME, "nothing to read"),
        ({**TIME, **MAG, "moving": "ok"}, "moving belongs to a truth"),
        ({**TIME, "magnetic_field": {**MAG["magnetic_field"], "unit": "g"}}, "'g' is not a unit"),
    ],
)
def test_parameters_that_make_no_sense_are_refused(params, why):
    with pytest.raises(ValidationError, match=why):
        CsvFile.Params(file="log.csv", **params)


def test_memory_does_not_grow_with_the_file(tmp_path):
    def peak(rows):
        path = tmp_path / f"{rows}.csv"
        path.write_text("t,mx,my,mz\n" + "".join(f"{i},1.25,2.5,3.75\n" for i in range(rows)))
        source = CsvFile(CsvFile.Params(file=str(path), **TIME, **MAG))
        tracemalloc.start()
        for _ in source.read(SimClock()):
            pass
        _, highest = tracemalloc.get_traced_memory()
        tracemalloc.stop()
        return highest

    assert peak(40_000) < 1.5 * peak(4000)
