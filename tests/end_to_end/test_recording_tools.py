"""info, compare, recover and export on real recordings."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import pytest
from command_line import CommandLine, InProcess
from mcap.reader import make_reader


def make(lodeflow: CommandLine, graphs: Path, name: str, *options: object) -> str:
    lodeflow("run", graphs / "heading.yaml", "--arg", "duration=5", "--record", name, *options)
    return name


def test_a_file_without_its_end(quick: InProcess, graphs: Path) -> None:
    path = quick.folder / make(quick, graphs, "a.mcap")
    path.write_bytes(path.read_bytes()[:-100])
    for arguments in (["info"], ["export", "--to", "csv", "out"], ["compare", "a.mcap"]):
        done = quick(arguments[0], "a.mcap", *arguments[1:], code=1)
        assert "a.mcap: was not closed" in done.stderr
        assert done.stderr.endswith("mend it with: lodeflow recover a.mcap\n")
    done = quick("recover", "a.mcap")
    assert "mended to a.recovered.mcap" in done.stdout
    make(quick, graphs, "b.mcap")
    quick("compare", "a.recovered.mcap", "b.mcap")


def test_info(quick: InProcess, graphs: Path) -> None:
    make(quick, graphs, "a.mcap")
    text = quick("info", "a.mcap").stdout
    (row,) = [line.split() for line in text.splitlines() if line.startswith("vehicle.raw_mag ")]
    assert row == ["vehicle.raw_mag", "RawField", "500", "0.000000", "4.990000", "100", "Hz"]
    assert "losses: none" in text
    assert "attached graph: yes" in text
    plain = json.loads(quick("info", "a.mcap", "--json").stdout)
    assert plain["provenance"]["graph"] == "heading"
    assert plain["streams"]["/fuser"]["rate"] == pytest.approx(100)
    graph = quick.write("again.yaml", quick("info", "a.mcap", "--graph").stdout)
    quick("run", graph, "--record", "b.mcap")
    quick("compare", "a.mcap", "b.mcap")


def test_compare(quick: InProcess, graphs: Path) -> None:
    make(quick, graphs, "a.mcap")
    make(quick, graphs, "same.mcap")
    make(quick, graphs, "near.mcap", "--set", "fuser.measurement_variance=0.0010000000001")
    make(quick, graphs, "short.mcap", "--duration", 4)
    done = quick("compare", "a.mcap", "same.mcap")
    assert done.stdout.endswith("\nthe same\n")
    done = quick("compare", "a.mcap", "near.mcap", code=1)
    assert "vehicle.imu" in done.stdout
    assert "fuser: first difference: message " in done.stdout
    assert "largest difference of quaternion: " in done.stdout
    plain = json.loads(quick("compare", "a.mcap", "near.mcap", "--json", code=1).stdout)
    same = {topic for topic, stream in plain["streams"].items() if stream["same"]}
    assert {"/vehicle/imu", "/compass/attitude"} < same
    assert not {"/fuser", "/heading"} & same
    assert 0 < plain["streams"]["/fuser"]["largest_difference"]["quaternion"]["value"] < 1e-6
    done = quick("compare", "a.mcap", "near.mcap", "--tolerance", "1e-6")
    assert done.stdout.endswith("\nthe same within the tolerance\n")
    quick("compare", "a.mcap", "near.mcap", "--tolerance", "fuser.quaternion=1e-6", code=1)
    done = quick("compare", "a.mcap", "short.mcap", code=1)
    assert "heading: 100 only in A" in done.stdout
    for wrong in ("x", "fuser.quaternio=1", "heading.heading=1 m"):
        done = quick("compare", "a.mcap", "same.mcap", "--tolerance", wrong, code=2)
        assert "Error: " in done.stderr
    quick("compare", "a.mcap", "nothing.mcap", code=1)


PACKAGE = """\
import lodeflow as lf

@lf.hookimpl
def lodeflow_messages():
    return ["pressure_messages"]
"""
MESSAGES = '''\
from collections.abc import Iterator
import lodeflow as lf

class Pressure(lf.Message, ros="pressure_msgs/msg/Pressure"):
    """Air pressure."""
    pressure: lf.Scalar[lf.Dimensionless]

class Barometer(lf.Source):
    class Params(lf.Params):
        step: float = 0.5
    def read(self, clock: lf.Clock) -> Iterator[Pressure]:
        for n in range(20):
            yield Pressure(n * 1000, 100.0 + n * self.params.step)
'''


def test_types_of_an_installed_package_are_compared_by_field(lodeflow: CommandLine) -> None:
    lodeflow.write("pressure_messages.py", MESSAGES)
    graph = lodeflow.write(
        "graph.yaml", 'lodeflow: 1\nname: p\nnodes:\n  p: {use: "pressure_messages:Barometer"}\n'
    )
    lodeflow("run", graph, "--record", "a.mcap")
    lodeflow("run", graph, "--record", "b.mcap", "--set", "p.step=0.75")
    done = lodeflow("compare", "a.mcap", "b.mcap", code=1)
    assert "p: first difference: message 1, t=1000 ns: byte " in done.stdout
    assert (
        "left out: '/p' holds pressure_msgs"
        in lodeflow("export", "a.mcap", "--to", "csv", "out").stderr
    )
    lodeflow.write("pressure.py", PACKAGE)
    info = lodeflow.folder / "pressure-1.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: pressure\nVersion: 1\n")
    (info / "entry_points.txt").write_text("[lodeflow]\npressure = pressure\n")
    done = lodeflow("compare", "a.mcap", "b.mcap", code=1)
    assert "message 1, t=1000 ns: pressure is 100.5 in A, 100.75 in B" in done.stdout
    assert "p.csv" in lodeflow("export", "a.mcap", "--to", "csv", "out").stdout
    lodeflow.write("pressure_messages.py", "1 / 0\n")
    done = lodeflow("compare", "a.mcap", "a.mcap")
    assert "message types of pressure are not known: ZeroDivisionError" in done.stderr


def test_recover_of_a_damaged_file(quick: InProcess, graphs: Path) -> None:
    path = quick.folder / make(quick, graphs, "a.mcap", "--arg", "duration=60")
    assert "a.mcap is whole; nothing was written" in quick("recover", "a.mcap").stdout
    with path.open("rb") as file:
        chunk = make_reader(file).get_summary().chunk_indexes[1]
    data = bytearray(path.read_bytes())
    data[chunk.chunk_start_offset + chunk.chunk_length // 2] ^= 1
    (quick.folder / "b.mcap").write_bytes(data)
    done = quick("recover", "b.mcap", "c.mcap")
    assert "bytes lost: a chunk that" in done.stdout
    assert "data up to t=" in done.stdout
    quick("compare", "a.mcap", "c.mcap", code=1)
    assert "exists" in quick("recover", "b.mcap", "c.mcap", code=1).stderr
    quick.write("d.mcap", "no recording")
    assert "d.mcap: is no MCAP file" in quick("recover", "d.mcap", code=1).stderr


def test_export(quick: InProcess, graphs: Path) -> None:
    make(quick, graphs, "a.mcap")
    done = quick("export", "a.mcap", "--to", "csv", "tables")
    assert str(Path("tables", "compass.euler.csv")) in done.stdout.splitlines()
    with (quick.folder / "tables" / "heading.csv").open() as file:
        header, *rows = csv.reader(file)
    assert header == ["t_ns", "heading [rad]"]
    assert [int(row[0]) for row in rows] == [10_000_000 * number for number in range(500)]
    quick("export", "a.mcap", "--to", "parquet", "one.parquet", "vehicle.imu")
    assert (quick.folder / "one.parquet").read_bytes()[:4] == b"PAR1"
    done = quick("export", "a.mcap", "--to", "csv", "tables", "vehicle.imx", code=1)
    assert "did you mean 'vehicle.imu'" in done.stderr
    quick("export", "a.mcap", "--to", "xlsx", "tables", code=2)
