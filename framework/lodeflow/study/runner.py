"""Runs the cells of a study in parallel processes that are used again and again."""

from __future__ import annotations

import json
import multiprocessing
import signal
import threading
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from multiprocessing.connection import Connection, wait
from typing import Any

from lodeflow.clock import monotonic
from lodeflow.study.model import Cell
from lodeflow.study.worker import STARTED, Job, Outcome, serve

GRACE = 1.0
"""Seconds that the cells which are running have to end after Ctrl-C, before they are killed."""

Done = Callable[[Cell, Outcome], None]
"""Called with each cell as it ends."""


def run_cells(cells: Sequence[Cell], jobs: int, done: Done) -> None:
    """Run cells, several at a time, and report each as it ends.

    A cell that raises, and one whose process is killed, has an error in its outcome; the others
    go on. The first cell with a plugin has started its nodes, and so compiled their kernels into
    numba's cache, before a second one with that plugin begins.

    Args:
        cells: what to run.
        jobs: how many at a time.
        done: called in this thread.

    Raises:
        KeyboardInterrupt: by Ctrl-C or SIGTERM; all processes have ended by then.
    """
    pending = deque(cells)
    crew: list[_Worker] = []
    warm: set[str] = set()
    with _terminated_like_interrupted():
        try:
            while pending or any(worker.cell for worker in crew):
                _assign(pending, crew, jobs, warm)
                busy = {worker.pipe: worker for worker in crew if worker.cell}
                for pipe in wait(list(busy)):
                    worker = busy[pipe]  # type: ignore[index]
                    message = worker.receive()
                    warm |= worker.plugins
                    if message == STARTED:
                        continue
                    cell, worker.cell = worker.cell, None
                    if worker.is_dead:
                        crew.remove(worker)
                    if cell is not None:
                        done(cell, message)
        finally:
            _end(crew)


def _assign(pending: deque[Cell], crew: list[_Worker], jobs: int, warm: set[str]) -> None:
    """Give cells to idle processes, and begin new ones."""
    while pending:
        starting = {p for worker in crew if worker.cell for p in worker.plugins} - warm
        cell = next((c for c in pending if not starting & plugins_of(c)), None)
        crew[:] = [worker for worker in crew if worker.cell or worker.process.is_alive()]
        idle = next((worker for worker in crew if worker.cell is None), None)
        if cell is None or (idle is None and len(crew) >= jobs):
            return
        if idle is None:
            idle = _Worker()
            crew.append(idle)
        pending.remove(cell)
        idle.give(cell)


def plugins_of(cell: Cell) -> set[str]:
    """Return the names of the classes that a cell's graph is made of."""
    return {
        f"{node.plugin.__module__}.{node.plugin.__qualname__}" for node in cell.graph.nodes.values()
    }


def job_of(cell: Cell) -> Job:
    """Return a cell as a worker gets it."""
    # A cell runs in one process, which changes no byte; JSON is YAML, and fast.
    kept = {name: value for name, value in cell.graph.document.items() if name != "processes"}
    document = json.dumps(kept, ensure_ascii=False)
    recording = "" if cell.change.recording is None else str(cell.change.recording)
    return Job(document, str(cell.change.graph), recording, cell.change.start, cell.streams)


class _Worker:
    """A process and its pipe.

    Attributes:
        cell: what it runs; None while it is idle.
        plugins: of that cell.
        is_dead: the process has ended before its cell did.
    """

    def __init__(self) -> None:
        context = multiprocessing.get_context("spawn")
        self.pipe: Connection
        self.pipe, theirs = context.Pipe()
        self.process = context.Process(target=serve, args=(theirs,), daemon=True)
        # The child inherits the mask: Ctrl-C on the terminal is for this process alone.
        before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
        try:
            self.process.start()
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, before)
        theirs.close()
        self.cell: Cell | None = None
        self.plugins: set[str] = set()
        self.is_dead = False

    def give(self, cell: Cell) -> None:
        """Let the process run a cell."""
        self.cell, self.plugins = cell, plugins_of(cell)
        with suppress(OSError):  # it is dead, which `receive` tells
            self.pipe.send(job_of(cell))

    def receive(self) -> Any:
        """Return what the process sends; a failed outcome if it has died."""
        try:
            return self.pipe.recv()
        except (EOFError, OSError):
            self.is_dead = True
            self.process.join(GRACE)
            return Outcome({}, f"its process {_how_it_ended(self.process.exitcode)}")


def _how_it_ended(code: int | None) -> str:
    if code is None or code >= 0:
        return f"ended with code {code}"
    name = signal.Signals(-code).name
    hint = ", perhaps for want of memory" if -code == signal.SIGKILL else ""
    return f"was killed by {name}{hint}"


def _end(crew: Sequence[_Worker]) -> None:
    """End all processes: ask, wait a little, kill."""
    for worker in crew:
        worker.process.terminate()
        worker.pipe.close()
    until = monotonic() + GRACE
    for worker in crew:
        worker.process.join(max(0.0, until - monotonic()))
        if worker.process.is_alive():
            worker.process.kill()
            worker.process.join()


@contextmanager
def _terminated_like_interrupted() -> Iterator[None]:
    """Let SIGTERM raise what Ctrl-C does."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return

    def interrupt(*_: object) -> None:
        raise KeyboardInterrupt

    before = signal.signal(signal.SIGTERM, interrupt)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)
