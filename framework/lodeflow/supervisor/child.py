"""Child: a forked process that runs one group, and ends when its supervisor does."""

from __future__ import annotations

import contextlib
import ctypes
import gc
import logging
import os
import signal
import sys
import threading
import traceback
from collections import deque
from collections.abc import Callable, Iterable
from typing import Any

from lodeflow.clock import sleep
from lodeflow.errors import LodeflowError
from lodeflow.supervisor.setup import Pipe, Report

LAST_WORDS = 1.5
"""Seconds between the end of a supervisor and that of a child that does not stop by itself; the
recorder closes its file before."""
M_TRIM_THRESHOLD, M_MMAP_THRESHOLD = -1, -3
"""Names of malloc.h."""

Work = Callable[[Callable[[Any], None], "deque[Any]", list[Any]], Report]
"""Runs a group: tells the supervisor, gets orders, gives what wakes it; returns its report."""


class Child:
    """A forked process, seen from its supervisor.

    Args:
        name: of the group.
        work: runs in the child, with SIGTERM blocked.
        forget: descriptors of the supervisor that the child must not keep open.

    Attributes:
        pid: its process.
        pipe: its reports come in here, orders go out.
        output: what it prints, as a descriptor to read from.
    """

    def __init__(self, name: str, work: Work, forget: Iterable[int]) -> None:
        self.name = name
        self.report: Report | None = None
        self.ready = False
        up_read, up_write = os.pipe()
        down_read, down_write = os.pipe()
        self.output, output_write = os.pipe()
        self.rest = b""
        sys.stdout.flush()
        sys.stderr.flush()
        # A SIGTERM that comes while the child begins waits until it can be obeyed: `interruptible`.
        mask = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGTERM})
        self.pid = os.fork()
        if self.pid == 0:
            code = 1
            try:
                for descriptor in (up_read, down_write, self.output, *forget):
                    with contextlib.suppress(OSError):
                        os.close(descriptor)
                os.dup2(output_write, 1)
                os.dup2(output_write, 2)
                os.close(output_write)
                code = _run(Pipe(down_read, up_write), work)
            except BaseException:
                traceback.print_exc()
            finally:
                with contextlib.suppress(Exception):
                    sys.stdout.flush()
                    sys.stderr.flush()
                os._exit(code)
        signal.pthread_sigmask(signal.SIG_SETMASK, mask)
        for descriptor in (up_write, down_read, output_write):
            os.close(descriptor)
        self.pipe = Pipe(up_read, down_write)

    @property
    def descriptors(self) -> tuple[int, ...]:
        """What other children must not keep open."""
        return (self.pipe.read, self.pipe.write, self.output)

    def signal(self, number: signal.Signals) -> None:
        """Send a signal, if the process is still there."""
        with contextlib.suppress(ProcessLookupError):
            os.kill(self.pid, number)

    def close(self) -> None:
        """Close the pipes of a child that has ended."""
        for descriptor in self.descriptors:
            os.close(descriptor)


def _keep_memory() -> None:
    """Let glibc keep freed memory of the size of frames and columns.

    By default it gives such pieces back to the kernel at once, and gets them again page by page,
    which costs links with large frames a fifth of their rate.
    """
    mallopt = getattr(ctypes.CDLL(None), "mallopt", None)
    if mallopt is not None:
        mallopt(M_MMAP_THRESHOLD, 4 << 20)
        mallopt(M_TRIM_THRESHOLD, 64 << 20)


def _run(pipe: Pipe, work: Work) -> int:
    # What was imported before the fork is no garbage: to look it through again would hold up the
    # data (with numba and scipy for a tenth of a second), and copy the memory that is shared.
    gc.freeze()
    _keep_memory()
    signal.set_wakeup_fd(-1)
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the supervisor hears Ctrl-C, and asks us
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    signal.signal(signal.SIGCHLD, signal.SIG_DFL)
    handler = logging.StreamHandler(sys.stderr)
    handler.setFormatter(logging.Formatter("%(name)s: %(levelname)s: %(message)s"))
    logger = logging.getLogger("lodeflow")
    logger.handlers[:] = [handler]
    logger.setLevel(logging.INFO)
    orders: deque[Any] = deque()
    awake: list[Any] = []
    listener = threading.Thread(
        target=_listen, args=(pipe, orders, awake), name="supervisor", daemon=True
    )
    listener.start()
    try:
        report = work(pipe.send, orders, awake)
    except LodeflowError as error:  # it could not even start
        report = Report(error=str(error))
    pipe.send(report)
    return 1 if report.error is not None else 0


def _listen(pipe: Pipe, orders: deque[Any], awake: list[Any]) -> None:
    """Take the orders of the supervisor; when it ends, end too."""
    while True:
        for order in pipe.receive():
            if order is None:
                os.kill(os.getpid(), signal.SIGTERM)
                sleep(LAST_WORDS)
                os._exit(1)
            orders.append(order)
        for wake in awake:
            wake()
