"""How a run is told to stop: signals, and a grace period before it is interrupted."""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Any

GRACE = 1.0
"""Seconds that a run has to end by itself after Ctrl-C, before it is interrupted where it is."""
MOMENT, MOMENTS = 0.01, 50
"""Seconds, and how often, that the interpreter is given to finish what it does with a module's
file: interrupted, it would leave the file open, and say so."""

_IMPORTS = "<frozen importlib"  # how the files of the import system are called


@contextmanager
def interruptible(
    stop: Callable[[], None],
    is_stopping: Callable[[], bool],
    grace: float = GRACE,
    by: tuple[signal.Signals, ...] = (signal.SIGINT, signal.SIGTERM),
) -> Iterator[Callable[[], None]]:
    """Let Ctrl-C and SIGTERM end the sources; what does not react in time is interrupted.

    Yields what is to be called when the run is over: from then on nothing interrupts the closing
    of the recording, which takes no user code.

    Args:
        stop: asks the run to stop; safe in a signal handler.
        is_stopping: whether it has been asked.
        grace: seconds until it is interrupted.
        by: signals that ask it to stop.
    """
    if threading.current_thread() is not threading.main_thread():
        yield lambda: None
        return

    def interrupt(*_: Any) -> None:
        if is_stopping():
            raise KeyboardInterrupt
        stop()
        signal.setitimer(signal.ITIMER_REAL, grace)

    moments = MOMENTS

    def give_up(number: int, frame: FrameType | None) -> None:
        nonlocal moments
        if frame is not None and moments and frame.f_code.co_filename.startswith(_IMPORTS):
            moments -= 1
            signal.setitimer(signal.ITIMER_REAL, MOMENT)
            return
        raise KeyboardInterrupt

    def closing() -> None:
        signal.setitimer(signal.ITIMER_REAL, 0)
        for number in handlers:
            signal.signal(number, signal.SIG_IGN)

    handlers = {**dict.fromkeys(by, interrupt), signal.SIGALRM: give_up}
    before = {number: signal.signal(number, handler) for number, handler in handlers.items()}
    try:
        yield closing
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        for number, handler in before.items():
            signal.signal(number, handler)
