"""Split runs end as a whole, whatever ends first: no process, no file, a recording that reads.

pytest -n0 -rP tests/end_to_end/test_split_stop.py | grep gone    # how long it took, each time
"""

from __future__ import annotations

import json
import os
import random
import signal
import time
from pathlib import Path

import pytest
import split_toys
from command_line import CommandLine
from processes import children, is_running, wait_for_recording, wait_for_run

WAYS = ("SIGINT", "SIGTERM", "a child", "the supervisor", "the recorder")
PATIENCE = 10.0
"""Seconds in which everything is to be gone. It takes two at most where nothing else runs."""


@pytest.mark.parametrize("seed", range(int(os.environ.get("LODEFLOW_ROUNDS", "2"))))
@pytest.mark.parametrize("way", WAYS)
def test_everything_ends(lodeflow: CommandLine, way: str, seed: int) -> None:
    lodeflow.write("toys.py", split_toys.MODULE)
    lodeflow.write("toy.yaml", split_toys.GRAPH)
    process = lodeflow.start("run", "toy.yaml", "--realtime", "--json")
    wait_for_recording(lodeflow.folder / "out.mcap")
    rng = random.Random(seed)
    time.sleep(rng.uniform(0.0, 0.3))
    started = children(process.pid)  # janitor, source, gains, ends, recorder
    assert len(started) == 5
    shared = {path for pid in started for path in shared_memory(pid)}
    victim = {"the supervisor": process.pid, "the recorder": started[4]}.get(
        way, rng.choice(started[1:4])
    )
    begun = time.monotonic()
    if way.startswith("SIG"):
        process.send_signal(signal.Signals[way])
    else:
        os.kill(victim, signal.SIGKILL)
    _, errors = process.communicate(timeout=20)
    while any(map(is_running, started)) and time.monotonic() - begun < 10:
        time.sleep(0.01)
    took = time.monotonic() - begun
    print(f"{way}: gone after {took:.2f} s")
    assert [pid for pid in started if is_running(pid)] == []
    assert took < PATIENCE, errors
    assert list((lodeflow.runtime / "lodeflow").iterdir()) == []
    assert [path for path in shared if path.exists()] == []
    expected = {"SIGINT": 130, "SIGTERM": 130, "the supervisor": -signal.SIGKILL}
    assert process.returncode == expected.get(way, 1), errors
    if way == "the recorder":
        lodeflow("recover", "out.mcap")
        lodeflow("info", "out.recovered.mcap")
    else:
        missing = json.loads(lodeflow("info", "out.mcap", "--json").stdout)["missing"]
        assert bool(missing) == (way == "a child")  # all others end in order


@pytest.mark.parametrize("seed", range(int(os.environ.get("LODEFLOW_ROUNDS", "2"))))
@pytest.mark.parametrize("way", ["SIGINT", "SIGTERM", "SIGKILL"])
def test_what_has_hardly_begun_ends(lodeflow: CommandLine, way: str, seed: int) -> None:
    lodeflow.write("toys.py", split_toys.MODULE)
    lodeflow.write("toy.yaml", split_toys.GRAPH)
    process = lodeflow.start("run", "toy.yaml", "--realtime", "--json")
    runs = wait_for_run(lodeflow.runtime)
    time.sleep(random.Random(seed).uniform(0.0, 0.5))
    begun = time.monotonic()
    process.send_signal(signal.Signals[way])
    output, errors = process.communicate(timeout=20)
    while list(runs.iterdir()) and time.monotonic() - begun < PATIENCE:
        time.sleep(0.01)
    took = time.monotonic() - begun
    print(f"{way} early: gone after {took:.2f} s")
    assert took < PATIENCE, errors
    assert "ended by" not in errors
    expected = -signal.SIGKILL if way == "SIGKILL" else 130
    assert process.returncode == expected, output + errors
    if (lodeflow.folder / "out.mcap").exists():
        lodeflow("info", "out.mcap")


@pytest.mark.parametrize("seed", range(int(os.environ.get("LODEFLOW_ROUNDS", "1"))))
def test_what_compiles_ends(lodeflow: CommandLine, graphs: Path, seed: int) -> None:
    """Nothing is lost: no data comes before numba is done in all processes."""
    lodeflow.environment["NUMBA_CACHE_DIR"] = str(lodeflow.folder / "numba")
    process = lodeflow.start("run", graphs / "heading.yaml", "--realtime", "--json",
                             "--processes", "split", "--record", "out.mcap")  # fmt: skip
    wait_for_run(lodeflow.runtime)
    time.sleep(random.Random(seed).uniform(0.5, 6.0))
    begun = time.monotonic()
    process.send_signal(signal.SIGTERM)
    output, errors = process.communicate(timeout=20)
    took = time.monotonic() - begun
    print(f"compiling: gone after {took:.2f} s")
    assert took < PATIENCE, errors
    assert process.returncode == 130, output + errors
    lodeflow("replay", "out.mcap", "--check")


def shared_memory(pid: int) -> set[Path]:
    """Return the files of shared memory that a process has mapped."""
    maps = (Path("/proc") / str(pid) / "maps").read_text()
    return {Path(line.split()[-1]) for line in maps.splitlines() if "/dev/shm/" in line}
