"""Looking at processes: whose children there are, and whether all have gone."""

from __future__ import annotations

import socket
import time
from pathlib import Path


def children(pid: int) -> list[int]:
    """Return the children of a process, oldest first; zombies are gone."""
    entries = [entry for entry in Path("/proc").iterdir() if entry.name.isdigit()]
    stats = [(stat, int(entry.name)) for entry in entries if (stat := _stat(entry))]
    found = [(stat[2], child) for stat, child in stats if stat[1] == pid and stat[0] != "Z"]
    return [child for _, child in sorted(found)]


def _stat(entry: Path) -> tuple[str, int, int] | None:
    """Return the state, parent and start time of a process."""
    try:
        fields = (entry / "stat").read_text().rpartition(")")[2].split()
    except OSError:
        return None
    return fields[0], int(fields[1]), int(fields[19])


def is_running(pid: int) -> bool:
    stat = _stat(Path(f"/proc/{pid}"))
    return stat is not None and stat[0] != "Z"


def gone(*pids: int, within: float = 10.0) -> bool:
    """Wait for processes to end; whether all have."""
    until = time.monotonic() + within
    while any(map(is_running, pids)):
        if time.monotonic() > until:
            return False
        time.sleep(0.01)
    return True


def wait_for_recording(path: Path, seconds: float = 60.0) -> None:
    """Wait until a recording has a chunk with data."""
    until = time.monotonic() + seconds
    while not path.exists() or path.stat().st_size < 6000:
        assert time.monotonic() < until, f"{path} did not appear"
        time.sleep(0.01)


def wait_for_run(runtime: Path, seconds: float = 60.0) -> Path:
    """Wait until a run has a directory; return where those of all runs are."""
    runs = runtime / "lodeflow"
    until = time.monotonic() + seconds
    while not runs.exists() or not list(runs.iterdir()):
        assert time.monotonic() < until, "no run has begun"
        time.sleep(0.001)
    return runs


def free_port() -> int:
    """Return a TCP port that nobody listens at."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])
