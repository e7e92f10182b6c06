"""Ctrl-C and SIGTERM at any moment: a quick end, and a closed, readable recording."""

from __future__ import annotations

import random
import signal
import time
from pathlib import Path

import pytest
from command_line import CommandLine
from mcap.reader import make_reader

SLOW = """\
import time
import lodeflow as lf

class Slow(lf.Node):
    def step(self, imu: lf.Imu) -> lf.Imu:
        time.sleep(30)
        return imu
"""


def wait_for(path: Path, seconds: float = 30.0) -> None:
    """Wait until a file is there and has more in it than its header."""
    for _ in range(int(seconds / 0.01)):
        if path.exists() and path.stat().st_size > 100:
            return
        time.sleep(0.01)
    raise AssertionError(f"{path} did not appear")


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("pace", ["--realtime", "--json", "compiling"])
def test_ctrl_c_leaves_a_closed_recording(
    lodeflow: CommandLine, graphs: Path, seed: int, pace: str
) -> None:
    delay = random.Random(seed).uniform(0.0, 0.8)
    overlay = lodeflow.write("few.yaml", "record: {to: out.mcap, streams: [heading, score]}\n")
    if pace == "compiling":  # for the first time, and for seconds: numba finds nothing of before
        lodeflow.environment["NUMBA_CACHE_DIR"] = str(lodeflow.folder / "numba")
        pace, delay = "--realtime", 4 * delay
    process = lodeflow.start(
        "run", graphs / "heading.yaml", "--arg", "duration=100000", "--with", overlay, pace
    )
    path = lodeflow.folder / "out.mcap"
    wait_for(path)
    time.sleep(delay)
    process.send_signal([signal.SIGINT, signal.SIGTERM][seed % 2])
    output, errors = process.communicate(timeout=20)
    assert process.returncode == 130, errors
    assert "Traceback" not in errors, errors
    assert "out.mcap" in output
    with path.open("rb") as file:
        reader = make_reader(file, validate_crcs=True)
        counts = reader.get_summary().statistics.channel_message_counts
        assert sum(counts.values()) == sum(1 for _ in reader.iter_messages())


@pytest.mark.parametrize("processes", ["one", "split"])
def test_a_node_that_does_not_come_back_is_interrupted(
    lodeflow: CommandLine, processes: str
) -> None:
    """And what is lost with it is told, also by the exit code."""
    lodeflow.write("slow.py", SLOW)
    lodeflow.write(
        "slow.yaml",
        "lodeflow: 1\nname: slow\nnodes:\n"
        "  vehicle: {use: simulated_vehicle}\n"
        '  slow: {use: "slow:Slow", inputs: {imu: vehicle.imu}}\n'
        "record: {to: out.mcap}\n",
    )
    process = lodeflow.start("run", "slow.yaml", "--processes", processes)
    wait_for(lodeflow.folder / "out.mcap")
    time.sleep(1.0)
    process.send_signal(signal.SIGINT)
    _, errors = process.communicate(timeout=20)
    assert process.returncode == 1, errors
    assert "node 'slow' (Slow.step) did not end when it was to stop" in errors
    with (lodeflow.folder / "out.mcap").open("rb") as file:
        assert make_reader(file).get_summary() is not None
    assert (
        "MISSING at recorder, owed by slow: 'slow' from the start to the end"
        in lodeflow("info", "out.mcap").stdout
    )
    lodeflow.write("slow.py", SLOW.replace("30", "0"))
    lodeflow("replay", "out.mcap", "--check")
