"""What a person sees on a terminal while a graph runs."""

from __future__ import annotations

import os
import pty
import subprocess

import pytest
import split_toys
from command_line import COMMAND, CommandLine


def seen(toy: CommandLine, *arguments: str) -> str:
    """Run with a terminal as the standard error, and return what is written to it."""
    ours, theirs = pty.openpty()
    process = subprocess.Popen(
        [*COMMAND, "run", "toy.yaml", *arguments],
        cwd=toy.folder,
        env={**toy.environment, "TERM": "xterm"},
        stdout=subprocess.DEVNULL,
        stderr=theirs,
    )
    toy.started.append(process)  # type: ignore[arg-type]
    os.close(theirs)
    text = b""
    try:
        while data := os.read(ours, 1 << 16):
            text += data
    except OSError:  # how a terminal says that nobody writes to it any more
        pass
    os.close(ours)
    assert process.wait(timeout=30) == 0, text.decode()
    return text.decode()


@pytest.mark.parametrize("way", ["one", "graph"])
def test_the_progress_of_all_nodes_is_shown(lodeflow: CommandLine, way: str) -> None:
    lodeflow.write("toys.py", split_toys.MODULE)
    lodeflow.write("toy.yaml", split_toys.GRAPH)
    told = seen(lodeflow, "--arg", "seconds=1", "--realtime", "--processes", way)
    assert "messages/s" in told
    table = told[: told.index("messages/s")]
    assert all(name in table for name in ("ticks", "double", "triple", "sum", "total", "stepped"))
    (line,) = {row.strip() for row in told.splitlines() if "begins" in row}
    prefix = "[ends] " if way == "graph" else ""
    assert line.endswith(f"{prefix}lodeflow.node.total: INFO: begins")
