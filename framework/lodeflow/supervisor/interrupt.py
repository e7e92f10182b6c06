"""How a run is told to stop: signals, and a grace period before it is interrupted."""

from __future__ import annotations

import gc
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType

GRACE = 1.0
"""Seconds that a run has to end by itself after Ctrl-C, before it is interrupted where it is."""
MOMENT, MOMENTS = 0.01, 50
"""Seconds, and how often, that LLVM is given to come back to numba, which calls it to compile."""

_LLVM = "llvmlite.binding"


@contextmanager
def interruptible(
    stop: Callable[[], None],
    is_stopping: Callable[[], bool],
    grace: float = GRACE,
    by: tuple[signal.Signals, ...] = (signal.SIGINT, signal.SIGTERM),
) -> Iterator[Callable[[], None]]:
    """Let Ctrl-C and SIGTERM end the sources; what does not react in time is interrupted.

    Signals that are blocked are not from here on; one that has come before is obeyed now.

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

    def interrupt(number: int, frame: FrameType | None) -> None:
        if is_stopping():
            give_up(number, frame)
            return
        stop()
        signal.setitimer(signal.ITIMER_REAL, grace)

    moments, forced = MOMENTS, False

    def give_up(number: int, frame: FrameType | None) -> None:
        nonlocal moments, forced
        if moments and _is_in_llvm(frame):
            moments -= 1
            signal.setitimer(signal.ITIMER_REAL, MOMENT)
            return
        forced = True
        raise KeyboardInterrupt

    def unraisable(lost: sys.UnraisableHookArgs) -> None:
        if not forced:
            report(lost)
        elif issubclass(lost.exc_type, KeyboardInterrupt):
            # Python can only report what is raised in a finaliser, or in a callback of C: again.
            signal.setitimer(signal.ITIMER_REAL, MOMENT)

    def closing() -> None:
        signal.setitimer(signal.ITIMER_REAL, 0)
        for number in handlers:
            signal.signal(number, signal.SIG_IGN)

    handlers = {**dict.fromkeys(by, interrupt), signal.SIGALRM: give_up}
    before = {number: signal.signal(number, handler) for number, handler in handlers.items()}
    report, sys.unraisablehook = sys.unraisablehook, unraisable
    try:
        signal.pthread_sigmask(signal.SIG_UNBLOCK, by)
        yield closing
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        for number, handler in before.items():
            signal.signal(number, handler)
        if forced:  # it has left things half made, and they complain as they go
            sys.unraisablehook = lambda _: None
            gc.collect()
        sys.unraisablehook = report


def _is_in_llvm(frame: FrameType | None) -> bool:
    """Whether LLVM compiles, or calls back.

    What comes during its long calls is noticed right after them, where the binding has not yet
    written down what belongs to whom: an exception there leads to a crash. In a callback it would
    be lost, and numba without a function that it believes compiled.
    """
    while frame is not None:
        if frame.f_globals.get("__name__", "").startswith(_LLVM):
            return True
        frame = frame.f_back
    return False
