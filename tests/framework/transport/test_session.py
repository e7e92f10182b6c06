"""Sessions: how Zenoh is asked to work, seen from outside."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

PROGRAM = """
import json
import sys
import time
from pathlib import Path
from zenoh.handlers import FifoChannel
from lodeflow.transport.session import close_session, open_session

def sleeps():
    found = {}
    for task in Path("/proc/self/task").iterdir():
        status = dict(line.split(":", 1) for line in (task / "status").read_text().splitlines())
        found[status["Name"].strip()] = int(status["voluntary_ctxt_switches"])
    return found

where = f"unixsock-stream/{sys.argv[1]}/socket"
sessions = [open_session(listen=[where]), open_session(connect=[where])]
subscriber = sessions[0].declare_subscriber("lane", FifoChannel(16))
publisher = sessions[1].declare_publisher("lane")
while not publisher.matching_status.matching:
    time.sleep(0.01)
before = sleeps()
for _ in range(100):
    publisher.put(b"x")
    subscriber.recv()
    time.sleep(0.001)
print(json.dumps({name: count - before.get(name, 0) for name, count in sleeps().items()}))
for session in sessions:
    close_session(session)
"""
BUSY = {"rx", "acc", "net"}
"""The kinds of Zenoh's threads between a socket and a queue."""


def threads(folder: Path, runtime: str | None) -> dict[str, int]:
    """Return those threads of a process that sends itself 100 messages, and how often each slept.

    Some are there to wait for a file or a name, and never sleep for a message.
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
        timeout=60,
    )
    found = json.loads(done.stdout)
    return {name: count for name, count in found.items() if name.rpartition("-")[0] in BUSY}


@pytest.mark.skipif(not Path("/proc/self/task").exists(), reason="needs /proc")
def test_one_thread_brings_in_what_comes(tmp_path: Path) -> None:
    found = threads(tmp_path, None)
    assert {name for name, slept in found.items() if slept} == {"rx-0"}
    assert found["rx-0"] >= 50
    assert {name.rpartition("-")[0] for name in found} == {"rx"}


@pytest.mark.skipif(not Path("/proc/self/task").exists(), reason="needs /proc")
def test_who_has_set_up_zenohs_threads_keeps_them(tmp_path: Path) -> None:
    assert "acc-0" in threads(tmp_path, "(rx: (worker_threads: 3))")
