"""Starts the processes of a peer for a task, and returns what its sink saw."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

from task import Task

HERE = Path(__file__).parent
RAW = ("zenoh", "pyzmq", "iceoryx2")
PEERS = ("zenoh", "lodeflow", "dora-rs", "pyzmq", "iceoryx2")
LIMIT = 60.0
"""Seconds after which a measurement has failed."""
TICKS = os.sysconf("SC_CLK_TCK")


def launch(peer: str, task: Task, *, graph: str = "packets", cpu: bool = False) -> dict[str, Any]:
    """Run a task with a peer.

    Args:
        peer: one of PEERS.
        task: without `out`.
        graph: which of lodeflow's graphs.
        cpu: also how much CPU all processes take, from the first message to the last.

    Returns:
        What the sink wrote, with "start_ms" from the command to the first message, and "cpu" in
        microseconds per message.
    """
    with tempfile.TemporaryDirectory(prefix="bench-") as name:
        folder = Path(name)
        task = replace(task, out=str(folder / "out.json"))
        environment = {**os.environ, "TASK": task.dumps(), "PYTHONPATH": str(HERE)}
        environment["XDG_RUNTIME_DIR"] = name
        environment.pop("PYTHONDONTWRITEBYTECODE", None)  # what is installed is compiled
        meter = Meter(name)
        commands = _commands(peer, task, folder, graph)
        begun = time.monotonic_ns()
        started = [
            subprocess.Popen(
                command,
                cwd=folder,
                env=environment,
                stdout=subprocess.DEVNULL,
                stderr=(folder / f"err{index}").open("w"),
                start_new_session=True,
            )
            for index, command in enumerate(commands)
        ]
        try:
            _wait(Path(f"{task.out}.first"), started, folder)
            if cpu:
                before = meter.look()
            _wait(Path(task.out), started, folder, meter.look if cpu else lambda: None)
            found: dict[str, Any] = json.loads(Path(task.out).read_text())
            if cpu:
                found["cpu"] = (meter.look() - before) / task.count * 1e6
        finally:
            for process in started:
                with suppress(ProcessLookupError):
                    os.killpg(process.pid, signal.SIGTERM)
            for process in started:
                try:
                    process.wait(5.0)
                except subprocess.TimeoutExpired:
                    os.killpg(process.pid, signal.SIGKILL)
                    process.wait()
    found["start_ms"] = (found["first"] - begun) / 1e6
    return found


def _commands(peer: str, task: Task, folder: Path, graph: str) -> list[list[str]]:
    if peer in RAW:
        ends = [f"{folder}/{index}" for index in range(task.relays + 1)]
        roles = ["source", *["relay"] * task.relays, "sink"]
        ways = zip(roles, ["-", *ends], [*ends, "-"], strict=True)
        return [[sys.executable, str(HERE / "role.py"), peer, *way] for way in ways][::-1]
    if peer == "dora-rs":
        return [_dora(task, folder)]
    return [_lodeflow(task, folder, graph)]


def _dora(task: Task, folder: Path) -> list[str]:
    names = ["source", *[f"relay{index}" for index in range(task.relays)], "sink"]
    nodes = []
    for before, name in zip(["", *names], names, strict=False):
        role = name.rstrip("0123456789")
        node: dict[str, Any] = {"id": name, "path": sys.executable}
        node["args"] = f"{HERE / 'dora_node.py'} {role}"
        if before:
            node["inputs"] = {"x": {"source": f"{before}/out", "queue_size": 1_000_000}}
        if role != "sink":
            node["outputs"] = ["out"]
        nodes.append(node)
    (folder / "flow.yml").write_text(json.dumps({"nodes": nodes}))
    return [sys.executable, "-c", "import dora; dora.run('flow.yml')"]


def _lodeflow(task: Task, folder: Path, graph: str) -> list[str]:
    stream = {
        "packets": [("ticks", "Ticks"), ("stamp", "Stamp")],
        "device": [("device", "Device")],
        "blocks": [("blocks", "Blocks")],
        "imu": [("blocks", "ImuBlocks")],
        "imu samples": [("blocks", "ImuBlocks")],
    }[graph]
    sink = {"blocks": "BlockSink", "imu": "ImuBlockSink", "imu samples": "ImuSink"}
    first = [name for name, _ in stream]
    relays = [(f"relay{index}", "Relay") for index in range(task.relays)]
    stream = [*stream, *relays, ("sink", sink.get(graph, "Sink"))]
    nodes: dict[str, Any] = {}
    before = ""
    for name, kind in stream:
        nodes[name] = {"use": f"plugins:{kind}"}
        if before:
            nodes[name]["inputs"] = {"tick" if name == "stamp" else "x": before}
        before = name
    groups = {"first": first, **{name: [name] for name, _ in stream if name not in first}}
    text = json.dumps({"lodeflow": 1, "name": "bench", "nodes": nodes, "processes": groups})
    (folder / "graph.yaml").write_text(text)
    command = [sys.executable, "-m", "lodeflow.cli", "run", "graph.yaml", "--no-record"]
    paced = graph in ("packets", "imu samples")
    return [*command, "--realtime"] if paced else command


def _wait(
    path: Path,
    started: list[subprocess.Popen[bytes]],
    folder: Path,
    look: Callable[[], object] = lambda: None,
) -> None:
    until = time.monotonic() + LIMIT
    while not path.exists():
        failed = [process.returncode for process in started if process.poll()]
        if failed or time.monotonic() > until:
            errors = "\n".join(p.read_text()[-1000:] for p in sorted(folder.glob("err*")))
            raise RuntimeError(f"no {path.name} (exit codes {failed}):\n{errors}")
        look()
        time.sleep(0.002 if path.suffix == ".first" else 0.05)


class Meter:
    """The CPU of all processes that have our folder in their environment, children or not."""

    def __init__(self, folder: str) -> None:
        self._mark = f"XDG_RUNTIME_DIR={folder}".encode()
        self._seen: dict[str, int] = {}

    def look(self) -> float:
        """Return the seconds used so far, also by those that have ended since the last look."""
        for entry in Path("/proc").iterdir():
            with suppress(OSError):
                if not entry.name.isdigit():
                    continue
                if self._mark in (entry / "environ").read_bytes().split(b"\0"):
                    fields = (entry / "stat").read_text().rpartition(")")[2].split()
                    self._seen[entry.name] = int(fields[11]) + int(fields[12])
        return sum(self._seen.values()) / TICKS
