"""Sessions: how Zenoh is asked to work, seen from outside."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

PROGRAM = """
import sys
from pathlib import Path
from lodeflow.transport.session import close_session, open_session

session = open_session(listen=[f"unixsock-stream/{sys.argv[1]}/socket"])
print(*[task.read_text().strip() for task in Path("/proc/self/task").glob("*/comm")])
close_session(session)
"""
BUSY = {"rx", "acc", "net"}
"""Zenoh's threads between a socket and a queue, without their numbers."""


def threads(folder: Path, runtime: str | None) -> list[str]:
    """Return the names of those threads of a process with an open session."""
    environment = {"PATH": "/usr/bin:/bin"} | (
        {} if runtime is None else {"ZENOH_RUNTIME": runtime}
    )
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM, str(folder)],
        env=environment,
        capture_output=True,
        text=True,
        check=True,
    )
    return sorted(name for name in done.stdout.split() if name.rpartition("-")[0] in BUSY)


@pytest.mark.skipif(not Path("/proc/self/task").exists(), reason="needs /proc")
def test_one_thread_brings_in_what_comes(tmp_path: Path) -> None:
    assert threads(tmp_path, None) == ["rx-0"]


@pytest.mark.skipif(not Path("/proc/self/task").exists(), reason="needs /proc")
def test_who_has_set_up_zenohs_threads_keeps_them(tmp_path: Path) -> None:
    assert "acc-0" in threads(tmp_path, "(rx: (worker_threads: 3))")
