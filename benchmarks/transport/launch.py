"""Starts the processes of a peer for a task, and returns what its sink saw."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import tempfile
import time
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
CPU_SECONDS = 2.0
TICKS = os.sysconf("SC_CLK_TCK")


def launch(peer: str, task: Task, *, graph: str = "packets", cpu: bool = False) -> dict[str, Any]:
    """Run a task with a peer.

    Args:
        peer: one of PEERS.
        task: without `out`.
        graph: which of lodeflow's graphs.
        cpu: also how much CPU all processes take, from the first message on.

    Returns:
        What the sink wrote, with "start_ms" from the command to the first message, and "cpu" in
        percent of one core.
    """
    with tempfile.TemporaryDirectory(prefix="bench-") as name:
        folder = Path(name)
        task = replace(task, out=str(folder / "out.json"))
        environment = {**os.environ, "TASK": task.dumps(), "PYTHONPATH": str(HERE)}
        environment["XDG_RUNTIME_DIR"] = name
        environment.pop("PYTHONDONTWRITEBYTECODE", None)  # what is installed is compiled
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
            used = _cpu(started) if cpu else None
            _wait(Path(task.out), started, folder)
            found: dict[str, Any] = json.loads(Path(task.out).read_text())
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
    if used is not None:
        found["cpu"] = used
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


def _wait(path: Path, started: list[subprocess.Popen[bytes]], folder: Path) -> None:
    until = time.monotonic() + LIMIT
    while not path.exists():
        failed = [process.returncode for process in started if process.poll()]
        if failed or time.monotonic() > until:
            errors = "\n".join(p.read_text()[-1000:] for p in sorted(folder.glob("err*")))
            raise RuntimeError(f"no {path.name} (exit codes {failed}):\n{errors}")
        time.sleep(0.002 if path.suffix == ".first" else 0.02)


def _cpu(started: list[subprocess.Popen[bytes]]) -> float:
    """Return the CPU of all processes and what they started, in percent of one core."""
    time.sleep(0.5)
    before, begun = _ticks(started), time.monotonic()
    time.sleep(CPU_SECONDS)
    return 100.0 * (_ticks(started) - before) / TICKS / (time.monotonic() - begun)


def _ticks(started: list[subprocess.Popen[bytes]]) -> int:
    parents: dict[int, tuple[int, int]] = {}
    for entry in Path("/proc").iterdir():
        if entry.name.isdigit():
            with suppress(OSError):
                fields = (entry / "stat").read_text().rpartition(")")[2].split()
                parents[int(entry.name)] = (int(fields[1]), int(fields[11]) + int(fields[12]))
    roots = {process.pid for process in started}
    total = 0
    for pid, (_, ticks) in parents.items():
        one = pid
        while one and one not in roots:
            one = parents.get(one, (0, 0))[0]
        total += ticks if one else 0
    return total
