"""Real kills at random moments of real runs, and full disks: what is left, and what is said."""

from __future__ import annotations

import json
import random
import resource
import struct
import subprocess
import time
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

import pytest
from command_line import CommandLine, InProcess
from readers import records

from lodeflow.recording.recover import recover

PLUGINS = '''\
import os
import struct
import time
from collections.abc import Iterator
from contextlib import suppress
import numpy as np
import lodeflow as lf

class Ticks(lf.Source):
    """Angular rates at 100 Hz, without end."""

    def read(self, clock: lf.Clock) -> Iterator[lf.AngularRate]:
        random = np.random.default_rng(1)
        for first in range(0, 10**9, 200):
            time.sleep(0.01)  # 200 times real time, or there would be much to check
            t = np.arange(first, first + 200) * 10_000_000
            yield lf.AngularRate(t, random.standard_normal((200, 3)))

class Double(lf.Node):
    def step_block(self, rate: lf.AngularRate) -> lf.AngularRate:
        return rate.replace(angular_rate=2 * rate.angular_rate)

class Probe(lf.Node):
    """Writes when it has reached which stamp into a file, where a kill does not take it away."""

    def start(self) -> None:
        self.file = os.open("reached", os.O_WRONLY | os.O_CREAT)

    def reach(self, message: lf.Message) -> None:
        os.write(self.file, struct.pack("<qq", time.monotonic_ns(), message.t[-1]))

    def step_block(self, rate: lf.AngularRate) -> None:
        self.reach(rate)

class AttitudeProbe(Probe):
    def step_block(self, attitude: lf.Attitude) -> None:
        self.reach(attitude)
'''
OVERLAY = 'nodes:\n  probe: {use: "crash:AttitudeProbe", inputs: {attitude: fuser}}\n'
LIGHT = """\
lodeflow: 1
name: light
nodes:
  ticks: {use: "crash:Ticks"}
  double: {use: "crash:Double", inputs: {rate: ticks}}
  probe: {use: "crash:Probe", inputs: {rate: double}}
"""
SECOND = 1_000_000_000
STEP = SECOND // 100  # of all streams
AT_ONCE = 4


def reached(folder: Path, until: int) -> int:
    """Return the stamp that the run had passed on at a moment, -1 for none."""
    data = (folder / "reached").read_bytes() if (folder / "reached").exists() else b""
    whole = len(data) // 16 * 16
    return max((t for at, t in struct.iter_unpack("<qq", data[:whole]) if at <= until), default=-1)


def start(folder: Path, options: list[object]) -> tuple[CommandLine, subprocess.Popen[str]]:
    folder.mkdir()
    lodeflow = CommandLine(folder)
    lodeflow.write("crash.py", PLUGINS)
    lodeflow.write("probe.yaml", OVERLAY)
    lodeflow.write("light.yaml", LIGHT)
    return lodeflow, lodeflow.start("run", *options, "--record", "run.mcap")


def waited(process: subprocess.Popen[str]) -> int:
    """Return how long the threads of a process were ready to run, but did not, in ns."""
    total = 0
    for task in Path(f"/proc/{process.pid}/task").glob("*/schedstat"):
        with suppress(OSError):  # a thread that has just ended
            total += int(task.read_text().split()[1])
    return total


def has_begun(file: Path) -> bool:
    return file.exists() and file.stat().st_size > 0


def kill_at_random(
    folder: Path, options: list[object], rng: random.Random
) -> list[tuple[CommandLine, int, int]]:
    """Start some runs, and kill one before its first message and each other up to 2 s behind it.

    Returns:
        For each run its folder, when it was killed (monotonic, ns), and for how long a busy
        machine had kept it waiting by then (ns, of the last two seconds).
    """
    runs = [start(folder.with_name(f"{folder.name}.{n}"), options) for n in range(AT_ONCE)]
    try:
        waiting: list[tuple[CommandLine, subprocess.Popen[str], str, float]] = [
            (*runs[0], "run.mcap", rng.uniform(0.0, 0.1)),
            *((*run, "reached", rng.uniform(0.0, 2.0)) for run in runs[1:]),
        ]
        since: dict[subprocess.Popen[str], float] = {}
        history: dict[subprocess.Popen[str], list[tuple[float, int]]] = {}
        ended = []
        deadline = time.monotonic() + 400
        while waiting:
            assert time.monotonic() < deadline
            for lodeflow, process, mark, moment in list(waiting):
                now = time.monotonic()
                past = history.setdefault(process, [])
                past.append((now, waited(process)))
                while past[0][0] < now - 2:
                    past.pop(0)
                if process not in since and has_begun(lodeflow.folder / mark):
                    since[process] = time.monotonic()
                if process in since and time.monotonic() > since[process] + moment:
                    waiting.remove((lodeflow, process, mark, moment))
                    assert process.poll() is None, process.communicate()
                    killed = time.monotonic_ns()
                    process.kill()
                    process.communicate(timeout=30)
                    ended.append((lodeflow, killed, past[-1][1] - past[0][1]))
            time.sleep(0.005)
        return ended
    finally:
        for lodeflow, _ in runs:
            lodeflow.end()


def check_what_is_left(lodeflow: CommandLine, killed: int, held_up: int) -> int:
    """Recover what a kill left, and check it; return how many messages each stream has."""
    file = lodeflow.folder / "run.mcap"
    before = file.read_bytes()
    found = recover(file)
    assert file.read_bytes() == before
    assert found.out is not None
    assert (found.lost, found.damage) == ({}, [])
    assert 0 <= found.tail < len(before)
    kept = records(found.out)
    assert {topic: len(kept.get(topic, [])) for topic in found.kept} == found.kept
    due = reached(lodeflow.folder, killed - SECOND - held_up)
    for topic in found.kept.keys() & {"/ticks", "/double", "/vehicle/imu", "/fuser", "/heading"}:
        stamps = [t for t, _ in kept.get(topic, [])]
        last = stamps[-1] if stamps else -1
        assert stamps == [number * STEP for number in range(len(stamps))]
        assert found.until.get(topic, -1) == last
        assert last >= due, "more than the last second is missing"
    return min(found.kept.values(), default=0)


@pytest.mark.parametrize(
    ("graph", "pace", "batches"),
    [("light", ["--realtime"], 3), ("light", [], 2), ("heading", ["--realtime"], 1)],
    ids=["realtime", "fast", "heading"],
)
def test_a_killed_run_loses_at_most_its_last_second(
    tmp_path: Path, graphs: Path, graph: str, pace: list[str], batches: int
) -> None:
    """Twenty-four kills in all; a quarter falls into the start of a run, most into its midst."""
    rng = random.Random(f"{graph} {pace}")
    heading = [graphs / "heading.yaml", "--with", "probe.yaml", "--arg", "duration=1000"]
    options = [*(heading if graph == "heading" else ["light.yaml"]), *pace]
    killed = [
        run
        for batch in range(batches)
        for run in kill_at_random(tmp_path / str(batch), options, rng)
    ]
    assert len(killed) == batches * AT_ONCE
    kept = [check_what_is_left(*run) for run in killed]
    lodeflow, *_ = killed[-1]
    said = json.loads(lodeflow("info", "run.recovered.mcap", "--json").stdout)
    assert said["provenance"]["graph"] == graph
    streams = {topic: stream["count"] for topic, stream in said["streams"].items()}
    assert streams == said["recovery"]["kept"]
    assert min(streams.values()) == kept[-1]
    told = lodeflow("recover", "run.mcap", "again.mcap").stdout
    assert all(str(count) in told for count in streams.values())
    assert "bytes" in told
    lodeflow("compare", "run.recovered.mcap", "again.mcap")


@pytest.fixture
def small_disk(tmp_path: Path) -> Iterator[Path]:
    """A file system of 16 MiB, room for some blocks of all streams, where it may be mounted."""
    folder = tmp_path / "disk"
    folder.mkdir()
    command = ["mount", "-t", "tmpfs", "-o", "size=16m", "none", str(folder)]
    try:
        done = subprocess.run(command, capture_output=True, text=True, check=False)
    except OSError as error:
        pytest.skip(f"nothing to mount with: {error}")
    if done.returncode:
        pytest.skip(f"no tmpfs may be mounted: {done.stderr.strip()}")
    yield folder
    subprocess.run(["umount", str(folder)], check=True)


def check_full(quick: InProcess, path: Path, done: subprocess.CompletedProcess[str]) -> None:
    errors = [line for line in done.stderr.splitlines() if line.startswith("lodeflow: ")]
    assert len(errors) == 1, done.stderr
    assert f"{path}: cannot be written: " in errors[0]
    if "closed and readable" not in errors[0]:
        assert "mend this file with 'lodeflow recover'" in errors[0]
        path = Path(json.loads(quick("recover", path, "mended.mcap", "--json").stdout)["out"])
    found = json.loads(quick("info", path, "--json").stdout)
    assert found["provenance"]["graph"] == "heading"
    assert found["losses"] is None
    stamps = [t for t, _ in records(quick.folder / path)["/fuser"]]
    assert stamps == [number * STEP for number in range(len(stamps))]
    assert len(stamps) > 100
    quick("replay", path, "--no-record")


def test_a_full_disk_ends_the_run_with_one_error_and_a_readable_recording(
    lodeflow: CommandLine, quick: InProcess, graphs: Path, small_disk: Path
) -> None:
    path = small_disk / "run.mcap"
    done = lodeflow(
        "run", graphs / "heading.yaml", "--arg", "duration=1000", "--record", path, code=1
    )
    assert "No space left on device. The recording ends here" in done.stderr
    assert "closed and readable" in done.stderr
    check_full(quick, path, done)


def test_a_limit_on_files_does_the_same(
    lodeflow: CommandLine, quick: InProcess, graphs: Path
) -> None:
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (13_333_333, before[1]))  # processes inherit it
    try:
        done = lodeflow(
            "run", graphs / "heading.yaml", "--arg", "duration=1000", "--record", "run.mcap", code=1
        )
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    assert "File too large. The recording ends here" in done.stderr
    assert (lodeflow.folder / "run.mcap").stat().st_size <= 13_333_333
    check_full(quick, Path("run.mcap"), done)
