"""Each graph records the same in one process, one per node, on two hosts, and in a replay.

LODEFLOW_ROUNDS=20 pytest tests/end_to_end/test_same_bytes.py     # each of them so often
"""

from __future__ import annotations

import os
from pathlib import Path

import every_graph
import pytest
import yaml
from command_line import CommandLine, InProcess
from processes import free_port

from lodeflow.graph import load_graph

ROUNDS = int(os.environ.get("LODEFLOW_ROUNDS", "1"))


@pytest.mark.parametrize("name", every_graph.NAMES)
def test_same_bytes(lodeflow: CommandLine, quick: InProcess, name: str) -> None:
    graph, *arguments = every_graph.prepared(name, quick)
    run = ("run", graph, *arguments)
    # This process has had Zenoh sessions, and cannot be forked any more.
    quick(*run, "--processes", "one", "--record", "one.mcap")
    for speed in ([], ["--speed", "1e6"]):
        done = quick("replay", "one.mcap", "--check", *speed)
        assert "equal to the byte" in done.stdout
        assert "differs" not in done.stdout
    assert not (quick.folder / "recordings").exists()
    two_groups(Path(graph), lodeflow.folder / "hosts.yaml")
    for _ in range(ROUNDS):
        for before in ("split.mcap", "hosts.mcap"):
            (lodeflow.folder / before).unlink(missing_ok=True)
        lodeflow(*run, "--processes", "split", "--record", "split.mcap")
        assert "the same" in quick("compare", "one.mcap", "split.mcap").stdout
        on_two_hosts(lodeflow, *run, "--with", "hosts.yaml")
        assert "the same" in quick("compare", "one.mcap", "hosts.mcap").stdout


def two_groups(graph: Path, overlay: Path) -> None:
    """Write an overlay that puts every other node of a graph on the second host."""
    loaded = load_graph(graph)
    nodes = list(loaded.nodes)
    groups: dict[str, list[str] | None] = dict.fromkeys(loaded.processes)  # null removes
    groups |= {"here": nodes[::2], "there": nodes[1::2]}
    overlay.write_text(yaml.safe_dump({"processes": groups}))


def on_two_hosts(lodeflow: CommandLine, *run: str) -> None:
    """Run it under two supervisors, each with its own run directory, linked over TCP alone."""
    links, records = free_port(), free_port()
    run = (*run, "--record", "hosts.mcap")  # where the recorder runs; the other has to know of it
    here = lodeflow.start(
        *(*run, "--only", "here,recorder"),
        *("--listen", f"here=tcp/127.0.0.1:{links}"),
        *("--listen", f"recorder=tcp/127.0.0.1:{records}"),
    )
    there = lodeflow.start(
        *(*run, "--only", "there"),
        *("--connect", f"tcp/127.0.0.1:{links}", "--connect", f"tcp/127.0.0.1:{records}"),
    )
    for process in (there, here):
        _, errors = process.communicate(timeout=100)
        assert process.returncode == 0, errors
