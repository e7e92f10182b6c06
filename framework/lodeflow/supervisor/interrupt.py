"""How a run is told to stop: signals, and a grace period before it is interrupted."""

from __future__ import annotations

import signal
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType

GRACE = 1.0
"""Seconds that a run has to end by itself after Ctrl-C, before it is interrupted where it is."""
MOMENT, MOMENTS = 0.01, 50
"""Seconds, and how often, that what must not be left half done is given to finish."""

_IMPORTS = "<frozen importlib"  # how the files of the import system are called
_OF_LLVM = "_raw_object_cache_"  # what LLVM calls when it has compiled something for numba


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

    moments = MOMENTS

    def give_up(number: int, frame: FrameType | None) -> None:
        nonlocal moments
        if moments and _must_finish(frame):
            moments -= 1
            signal.setitimer(signal.ITIMER_REAL, MOMENT)
            return
        raise KeyboardInterrupt

    def lost(unraisable: sys.UnraisableHookArgs) -> None:
        # Python can only report what is raised in a finaliser, or in a callback of C: once more.
        if issubclass(unraisable.exc_type, KeyboardInterrupt):
            signal.setitimer(signal.ITIMER_REAL, MOMENT)
        else:
            report(unraisable)

    def closing() -> None:
        signal.setitimer(signal.ITIMER_REAL, 0)
        for number in handlers:
            signal.signal(number, signal.SIG_IGN)

    handlers = {**dict.fromkeys(by, interrupt), signal.SIGALRM: give_up}
    before = {number: signal.signal(number, handler) for number, handler in handlers.items()}
    report, sys.unraisablehook = sys.unraisablehook, lost
    try:
        signal.pthread_sigmask(signal.SIG_UNBLOCK, by)
        yield closing
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        for number, handler in before.items():
            signal.signal(number, handler)
        sys.unraisablehook = report


def _must_finish(frame: FrameType | None) -> bool:
    """Whether an interrupt raised here would leave something half done, and soon would not.

    The import system would leave the file of a module open, and numba would be without a function
    that it believes compiled: the callback of LLVM, which swallows exceptions, is where a signal
    that comes during a long compilation is noticed.
    """
    if frame is not None and frame.f_code.co_filename.startswith(_IMPORTS):
        return True
    while frame is not None:
        if frame.f_code.co_name.startswith(_OF_LLVM):
            return True
        frame = frame.f_back
    return False
