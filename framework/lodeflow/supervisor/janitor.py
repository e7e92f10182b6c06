"""Janitor: outlives a killed supervisor by two seconds, and leaves nothing behind."""

from __future__ import annotations

import contextlib
import os
import signal
from collections.abc import Iterable
from pathlib import Path

from lodeflow.clock import monotonic, sleep
from lodeflow.supervisor import rundir

PATIENCE = 1.5
"""Seconds that the children of a killed supervisor have to close their files."""
UNHEARD = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
"""It is there until its supervisor ends, whatever is sent to both of them."""


class Janitor:
    """A small process that waits for the supervisor to end, however it does.

    Args:
        run_dir: removed at the end.
    """

    def __init__(self, run_dir: Path) -> None:
        read, self._write = os.pipe()
        mask = signal.pthread_sigmask(signal.SIG_BLOCK, UNHEARD)
        self._pid = os.fork()
        if self._pid == 0:
            os.close(self._write)
            _watch(read, run_dir)
            os._exit(0)
        signal.pthread_sigmask(signal.SIG_SETMASK, mask)
        os.close(read)

    @property
    def descriptors(self) -> tuple[int, ...]:
        """What a child of the supervisor must close, or the end would go unnoticed."""
        return (self._write,)

    def add(self, pid: int) -> None:
        """Look after a child."""
        self._tell(f"+{pid}\n")

    def drop(self, pid: int) -> None:
        """A child has ended."""
        self._tell(f"-{pid}\n")

    def dismiss(self) -> None:
        """All is in order; the janitor removes the run directory and goes."""
        os.close(self._write)
        with contextlib.suppress(ChildProcessError):
            os.waitpid(self._pid, 0)

    def _tell(self, line: str) -> None:
        with contextlib.suppress(BrokenPipeError):
            os.write(self._write, line.encode())


def _watch(read: int, run_dir: Path) -> None:
    children: set[int] = set()
    rest = b""
    while data := os.read(read, 4096):
        *lines, rest = (rest + data).split(b"\n")
        for line in lines:
            (children.add if line[:1] == b"+" else children.discard)(int(line[1:]))
    end_all(children)
    rundir.end(run_dir)


def end_all(pids: Iterable[int]) -> None:
    """Ask processes to end, and kill those that do not within `PATIENCE`."""
    left = set(pids)
    _signal(left, signal.SIGTERM)
    until = monotonic() + PATIENCE
    while left and monotonic() < until:
        sleep(0.02)
        left = {pid for pid in left if rundir.is_alive(pid)}
    _signal(left, signal.SIGKILL)


def _signal(pids: Iterable[int], number: signal.Signals) -> None:
    for pid in pids:
        with contextlib.suppress(ProcessLookupError):
            os.kill(pid, number)
