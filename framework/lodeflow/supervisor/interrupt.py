"""How a run is told to stop: signals, and a grace period before it is interrupted."""

from __future__ import annotations

import gc
import signal
import sys
import threading
import traceback
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType

from lodeflow.clock import monotonic
from lodeflow.node import Configured

GRACE = 1.0
"""Seconds that a run has to end by itself after Ctrl-C, before it is interrupted where it is."""
MOMENT, MOMENTS = 0.01, 50
"""Seconds between two looks whether it may be interrupted; and how often LLVM is waited for, until
it comes back to numba, which calls it to compile."""

_LLVM = "llvmlite.binding"


@contextmanager
def interruptible(
    stop: Callable[[], None],
    grace: float = GRACE,
    patience: float = 0.0,
    begun: Callable[[], bool] = lambda: True,
    by: tuple[signal.Signals, ...] = (signal.SIGINT, signal.SIGTERM),
) -> Iterator[Callable[[], None]]:
    """Let Ctrl-C and SIGTERM end the sources; what does not react in time is interrupted.

    A second Ctrl-C interrupts at once. Signals that are blocked are not from here on; one that has
    come before is obeyed now.

    Yields what is to be called when the run is over: from then on nothing interrupts the closing
    of the recording, which takes no user code.

    Args:
        stop: asks the run to stop; safe in a signal handler.
        grace: seconds until it is interrupted.
        patience: seconds more if no plugin is at work: then others are waited for, and their
            plugins have just been interrupted.
        begun: whether data may have come. Before, nothing is lost with a plugin that is at its
            start, and it is interrupted at once.
        by: signals that ask it to stop.
    """
    if threading.current_thread() is not threading.main_thread():
        yield lambda: None
        return

    until, moments, forced = 0.0, MOMENTS, False

    def interrupt(number: int, frame: FrameType | None) -> None:
        nonlocal until
        if not until:
            until = monotonic() + grace + patience
            stop()
            at_once = not begun() and _is_at_work(frame)
            signal.setitimer(signal.ITIMER_REAL, MOMENT if at_once else grace)
        elif number == signal.SIGINT:  # somebody insists
            give_up(number, frame)

    def give_up(number: int, frame: FrameType | None) -> None:
        nonlocal moments, forced
        if number == signal.SIGALRM and monotonic() < until and not _is_at_work(frame):
            signal.setitimer(signal.ITIMER_REAL, MOMENT)
            return
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


def interruption(error: KeyboardInterrupt) -> str:
    """Return what is said of a run that was interrupted after data had come in."""
    what = "the run"
    for frame, _ in traceback.walk_tb(error.__traceback__):
        if (plugin := _plugin(frame)) is not None:
            what = f"node '{plugin.name}' ({type(plugin).__name__}.{frame.f_code.co_name})"
            break
    return f"{what} did not end when it was to stop, and was interrupted: data on its way is lost"


def _is_at_work(frame: FrameType | None) -> bool:
    """Whether a plugin is."""
    while frame is not None:
        if _plugin(frame) is not None:
            return True
        frame = frame.f_back
    return False


def _plugin(frame: FrameType) -> Configured | None:
    """Return the plugin whose method a frame is."""
    code = frame.f_code
    first = frame.f_locals.get(code.co_varnames[0]) if code.co_argcount else None
    return first if isinstance(first, Configured) else None


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
