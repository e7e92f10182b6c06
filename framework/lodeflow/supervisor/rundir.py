"""Run directories: where running graphs are found, and the sockets that they listen on."""

from __future__ import annotations

import contextlib
import datetime
import json
import os
import re
import shutil
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from lodeflow.clock import wall_time
from lodeflow.errors import RunError

ABOUT = "run.json"
_NAME = re.compile(r".+-(\d+)")


@dataclass(frozen=True)
class Running:
    """A running graph of this user on this host.

    Attributes:
        path: its run directory.
        graph: name of the graph.
        pid: of the process that answers for it.
        groups: names of the process groups that run here; one for a graph in one process.
        nodes: nodes of each of them.
        started: wall time, ISO 8601.
    """

    path: Path
    graph: str
    pid: int
    groups: tuple[str, ...]
    nodes: tuple[tuple[str, ...], ...]
    started: str

    @property
    def endpoints(self) -> list[str]:
        """Where to look into it."""
        return [look_socket(self.path, index) for index in range(len(self.groups))]


def base() -> Path:
    """Return the folder of this user's run directories.

    Raises:
        RunError: somebody else owns it.
    """
    runtime = os.environ.get("XDG_RUNTIME_DIR")
    if runtime and Path(runtime).is_dir():
        path = Path(runtime) / "lodeflow"
    else:
        path = Path(tempfile.gettempdir()) / f"lodeflow-{os.getuid()}"
    try:
        path.mkdir(mode=0o700, exist_ok=True)
        found = path.stat()
    except OSError as error:
        raise RunError(f"{path}: cannot be made: {error.strerror}; set XDG_RUNTIME_DIR") from error
    if found.st_uid != os.getuid() or found.st_mode & 0o077:
        raise RunError(f"{path} must belong to you alone (mode 0700); set XDG_RUNTIME_DIR")
    return path


def place(graph: str) -> Path:
    """Return where the run directory of this process is to be.

    Raises:
        RunError: somebody else owns the folder.
    """
    return base() / f"{graph[:24]}-{os.getpid()}"


def begin(path: Path, graph: str, groups: Sequence[str], nodes: Sequence[Sequence[str]]) -> None:
    """Make the run directory of this process, at its place.

    Raises:
        RunError: it cannot be made.
    """
    sweep()
    started = datetime.datetime.fromtimestamp(wall_time() / 1e9, tz=datetime.UTC)
    about = {
        "graph": graph,
        "pid": os.getpid(),
        "groups": list(groups),
        "nodes": [list(names) for names in nodes],
        "started": started.isoformat(),
    }
    try:
        path.mkdir(mode=0o700)
        (path / "new").write_text(json.dumps(about))
        (path / "new").rename(path / ABOUT)
    except OSError as error:
        raise RunError(f"{path}: cannot be made: {error.strerror}") from error


def link_socket(path: Path, index: int) -> str:
    """Return the endpoint at which a group takes links. Short: a socket's path has 107 bytes."""
    return f"unixsock-stream/{path}/l{index}"


def look_socket(path: Path, index: int) -> str:
    """Return the endpoint at which a process can be looked into."""
    return f"unixsock-stream/{path}/w{index}"


def end(path: Path) -> None:
    """Remove a run directory."""
    shutil.rmtree(path, ignore_errors=True)


def running() -> Iterator[Running]:
    """Yield the running graphs of this user."""
    for path in sorted(base().iterdir()):
        with contextlib.suppress(OSError, ValueError, KeyError, TypeError):
            about: dict[str, Any] = json.loads((path / ABOUT).read_text())
            if is_alive(int(about["pid"])):
                yield Running(
                    path,
                    str(about["graph"]),
                    int(about["pid"]),
                    tuple(about["groups"]),
                    tuple(tuple(names) for names in about["nodes"]),
                    str(about["started"]),
                )


def sweep() -> None:
    """Remove what killed runs have left behind."""
    for path in base().iterdir():
        found = _NAME.fullmatch(path.name)
        if found and not is_alive(int(found.group(1))):
            end(path)


def is_alive(pid: int) -> bool:
    """Whether there is a process of that number, and not just its exit code to be fetched."""
    try:
        os.kill(pid, 0)
        stat = Path(f"/proc/{pid}/stat").read_text()
    except (ProcessLookupError, FileNotFoundError):
        return False
    except PermissionError:
        return True
    return stat.rpartition(")")[2].split()[0] != "Z"
