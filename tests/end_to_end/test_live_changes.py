"""Nodes of a running graph are set and swapped: checked, at one stamp, and repeated by replay."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
from typing import Any

import pytest
import split_toys
from command_line import CommandLine
from processes import wait_for_recording


@pytest.mark.parametrize("way", ["one", "graph"])
def test_a_change_is_in_force_from_one_stamp_on_and_replayed(
    lodeflow: CommandLine, way: str
) -> None:
    lodeflow.write("toys.py", split_toys.MODULE)
    lodeflow.write("toy.yaml", split_toys.GRAPH)
    process = lodeflow.start("run", "toy.yaml", "--processes", way, "--realtime", "--json")
    wait_for_recording(lodeflow.folder / "out.mcap")

    done = lodeflow("set", "double.gian=3", code=1)
    assert "double.params.gian: no such parameter" in done.stderr
    assert "did you mean 'gain'?" in done.stderr
    done = lodeflow("set", "ticks.rate=3", code=1)
    assert "'ticks' is a source" in done.stderr
    done = lodeflow("swap", "double=toys:Sum", code=1)
    assert "inputs" in done.stderr

    told = json.loads(lodeflow("set", "double.gain=100", "--json").stdout)
    assert told["nodes"] == ["double"]
    both = json.loads(lodeflow("set", "double.gain=7", "triple.gain=70", "--json").stdout)
    assert sorted(both["nodes"]) == ["double", "triple"]
    assert both["t"] > told["t"]
    process.send_signal(signal.SIGINT)
    process.communicate(timeout=30)

    values: dict[str, dict[int, float]] = {}
    lodeflow("replay", "out.mcap", "--check")
    for name in ("double", "triple"):
        values[name] = gains(lodeflow, name)
    t = told["t"]
    assert {g for at, g in values["double"].items() if at < t} == {2.0}
    assert {g for at, g in values["double"].items() if t <= at < both["t"]} <= {100.0}
    assert {g for at, g in values["double"].items() if at >= both["t"]} <= {7.0}
    assert {g for at, g in values["triple"].items() if at < both["t"]} == {3.0}
    assert {g for at, g in values["triple"].items() if at >= both["t"]} <= {70.0}


def gains(lodeflow: CommandLine, name: str) -> dict[int, float]:
    """Return the gain of each message of a node behind `ticks`, by its stamp."""
    lodeflow.write("table.py", TABLE)
    done = subprocess.run(
        [sys.executable, "table.py", name], cwd=lodeflow.folder, env=lodeflow.environment,
        capture_output=True, text=True, check=True,
    )  # fmt: skip
    found: list[list[Any]] = json.loads(done.stdout)
    return {int(t): value / (t / 5e6) for t, value in found if t}


TABLE = """\
import json, sys
import toys
from lodeflow.recording.reader import Recording
with Recording("out.mcap") as recording:
    rows = [[int(t), float(v)] for b in recording.stream("/" + sys.argv[1], toys.Count)
            for t, v in zip(b.t, b.value)]
print(json.dumps(rows))
"""
