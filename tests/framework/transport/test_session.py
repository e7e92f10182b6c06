"""Sessions: how Zenoh is asked to work, seen from outside."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

PROGRAM = """
import sys
import time
from pathlib import Path
from lodeflow.transport.session import close_session, open_session

where = f"unixsock-stream/{sys.argv[1]}/socket"
sessions = [open_session(listen=[where]), open_session(connect=[where])]
until = time.monotonic() + 20
while not all(session.info.peers_zid() for session in sessions) and time.monotonic() < until:
    time.sleep(0.01)
time.sleep(0.2)  # a thread gives itself its name
print(*[task.read_text().strip() for task in Path("/proc/self/task").glob("*/comm")])
for session in sessions:
    close_session(session)
"""
BUSY = {"rx", "acc", "net"}
"""The kinds of Zenoh's threads between a socket and a queue."""


def threads(folder: Path, runtime: str | None) -> set[str]:
    """Return the kinds of those threads in a process with linked sessions.

    Of one kind there may be more than work: some are there to wait for a file or a name.
    """
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
    return {name.rpartition("-")[0] for name in done.stdout.split()} & BUSY


@pytest.mark.skipif(not Path("/proc/self/task").exists(), reason="needs /proc")
def test_one_kind_of_threads_brings_in_what_comes(tmp_path: Path) -> None:
    assert threads(tmp_path, None) == {"rx"}


@pytest.mark.skipif(not Path("/proc/self/task").exists(), reason="needs /proc")
def test_who_has_set_up_zenohs_threads_keeps_them(tmp_path: Path) -> None:
    assert "acc" in threads(tmp_path, "(rx: (worker_threads: 3))")
