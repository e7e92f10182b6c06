"""Plugins and packages that misbehave: one clear line, a closed recording, nobody else harmed."""

from __future__ import annotations

import signal
import time
from pathlib import Path

import pytest
from command_line import CommandLine
from mcap.reader import make_reader
from readers import records

GRAPH = """\
lodeflow: 1
name: odd
nodes:
  vehicle: {use: simulated_vehicle, params: {duration: 2}}
  odd: {use: "odd:Odd", inputs: {imu: vehicle.imu}}
record: {to: out.mcap}
"""
NODE = """\
import sys
import lodeflow as lf

class Odd(lf.Node):
    def __init__(self, *args, **named):
        super().__init__(*args, **named)
        #init
    def start(self):
        self.count = 0
        #start
    def step(self, imu: lf.Imu) -> lf.Imu:
        self.count += 1
        if self.count == 50:
            pass
            #step
        return imu
    def finish(self) -> None:
        pass
        #finish
"""


def odd(lodeflow: CommandLine, where: str, what: str) -> CommandLine:
    lodeflow.write("odd.py", NODE.replace(f"#{where}", what))
    lodeflow.write("odd.yaml", GRAPH)
    return lodeflow


@pytest.mark.parametrize("what", ["sys.exit(7)", "raise OSError('gone')", "raise SystemExit"])
@pytest.mark.parametrize(
    ("where", "told"),
    [
        ("init", "Odd.__init__) failed before its first message"),
        ("start", "Odd.start) failed before its first message"),
        ("step", "Odd.step) failed at t=490000000"),
        ("finish", "Odd.finish) failed at t=1990000000"),
    ],
)
def test_a_plugin_that_raises_or_exits(
    lodeflow: CommandLine, where: str, told: str, what: str
) -> None:
    done = odd(lodeflow, where, what)("run", "odd.yaml", code=1)
    assert told in done.stderr
    assert "(odd.py:" in done.stderr
    if where != "init":
        found = records(lodeflow.folder / "out.mcap")
        assert len(found.get("/vehicle/imu", [])) == (0 if where == "start" else 200)


def test_a_plugin_that_exits_at_import(lodeflow: CommandLine) -> None:
    lodeflow.write("odd.py", "import sys\nsys.exit(3)\n")
    lodeflow.write("odd.yaml", GRAPH)
    done = lodeflow("run", "odd.yaml", code=2)
    assert "'odd:Odd' cannot be imported: SystemExit: 3" in done.stderr


def test_a_live_source_that_exits_is_no_good_end(lodeflow: CommandLine) -> None:
    lodeflow.write(
        "odd.py",
        "import sys\nfrom collections.abc import Iterator\nimport lodeflow as lf\n\n"
        "class Odd(lf.Source):\n    max_delay = lf.seconds(0.01)\n"
        "    def read(self, clock: lf.Clock) -> Iterator[lf.Heading]:\n"
        "        yield lf.Heading(clock.now(), 1.0)\n        sys.exit('device gone')\n",
    )
    lodeflow.write("odd.yaml", 'lodeflow: 1\nname: odd\nnodes:\n  odd: {use: "odd:Odd"}\n')
    done = lodeflow("run", "odd.yaml", code=1)
    assert "SystemExit: device gone" in done.stderr


@pytest.mark.parametrize(
    "module",
    ["raise ImportError('no such library')", "import lodeflow as lf\n\n@lf.hookimpl\n"
     "def lodeflow_nodes():\n    return ['no', 'mapping', 'at all']\n"],
)  # fmt: skip
def test_a_broken_package_is_named_and_the_others_go_on(
    lodeflow: CommandLine, graphs: Path, module: str
) -> None:
    info = lodeflow.folder / "broken-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: broken\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text("[lodeflow]\nbroken = broken_plugins\n")
    lodeflow.write("broken_plugins.py", module)
    lodeflow("check", graphs / "heading.yaml")
    done = lodeflow("nodes")
    assert "quaternion_kalman" in done.stdout
    assert "package broken is broken and left out" in done.stderr
    lodeflow.write("uses.yaml", "lodeflow: 1\nname: uses\nnodes:\n  x: {use: brokn}\n")
    assert "package broken is broken" in lodeflow("check", "uses.yaml", code=1).stderr


@pytest.mark.parametrize("delay", [0.35, 0.45, 0.5, 0.55, 0.6, 0.7])
def test_ctrl_c_at_start_leaves_no_open_recording(
    lodeflow: CommandLine, graphs: Path, delay: float
) -> None:
    process = lodeflow.start(
        "run", graphs / "heading.yaml", "--arg", "duration=100000", "--record", "out.mcap"
    )
    time.sleep(delay)
    process.send_signal(signal.SIGINT)
    process.communicate(timeout=30)
    path = lodeflow.folder / "out.mcap"
    if path.exists():
        with path.open("rb") as file:
            assert make_reader(file, validate_crcs=True).get_summary() is not None


def test_names_with_brackets_are_shown_as_they_are(lodeflow: CommandLine, graphs: Path) -> None:
    done = lodeflow("run", graphs / "heading.yaml", "--duration", 1, "--record", "rec[a].mcap")
    assert "recorded to rec[a].mcap" in done.stdout


@pytest.mark.parametrize("duration", ["nan", "inf", "1e300", "0", "-1"])
def test_an_impossible_duration_is_refused(
    lodeflow: CommandLine, graphs: Path, duration: str
) -> None:
    code = 2 if duration in ("0", "-1") else 1
    done = lodeflow("run", graphs / "heading.yaml", "--duration", duration, code=code)
    assert "duration" in done.stderr
    assert not (lodeflow.folder / "recordings").exists()


def test_a_file_that_a_plugin_leaves_open_is_written(lodeflow: CommandLine) -> None:
    # In a cycle of references, where only a collection of garbage finds it.
    leave = (
        "import warnings; warnings.simplefilter('ignore', ResourceWarning); "
        "self.me, self.file = self, open('left.txt', 'w'); self.file.write('here')"
    )
    odd(lodeflow, "start", leave)("run", "odd.yaml")
    assert (lodeflow.folder / "left.txt").read_text() == "here"
