"""A run that does not stop by itself is interrupted, but not where that leaves a mess."""

from __future__ import annotations

import contextlib
import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator

import llvmlite.binding as llvm
import pytest

from lodeflow.supervisor.interrupt import MOMENT, MOMENTS, interruptible


@pytest.fixture(autouse=True)
def alarm() -> Iterator[None]:
    """Leave the timer of the tests as it was."""
    left = signal.setitimer(signal.ITIMER_REAL, 0.0)
    yield
    signal.setitimer(signal.ITIMER_REAL, *left)


LONG = 20.0
SOON = 0.3
assert SOON < MOMENT * MOMENTS

Work = Callable[[], None]


def busy(seconds: float, file: str = "node.py") -> Work:
    """Return code of a file that takes some time."""
    code = compile("while monotonic() < begun + seconds: pass", file, "exec")

    def run() -> None:
        exec(code, {"monotonic": time.monotonic, "begun": time.monotonic(), "seconds": seconds})

    return run


def importing(seconds: float) -> Work:
    return busy(seconds, "<frozen importlib._bootstrap_external>")


def finalising(seconds: float) -> Work:
    class Held:
        def __del__(self) -> None:
            busy(seconds)()

    def run() -> None:
        Held()

    return run


def compiling(seconds: float) -> Work:
    """Return work in which LLVM calls back, as it does for numba, and a signal comes then."""
    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()
    machine = llvm.Target.from_default_triple().create_target_machine()
    module = llvm.parse_assembly("define i32 @one() { ret i32 1 }")
    engine = llvm.create_mcjit_compiler(module, machine)
    called: list[bytes] = []

    def back(_: llvm.ModuleRef, code: bytes) -> None:
        os.kill(os.getpid(), signal.SIGINT)
        busy(seconds)()
        called.append(code)

    engine.set_object_cache(notify_func=back)

    def run() -> None:
        engine.finalize_object()
        assert len(called) == 1

    return run


def ended(*work: Work, signals: int = 1, grace: float = 0.05) -> int:
    """Do work, one after the other; return how much of it ended.

    Args:
        work: what is done.
        signals: how often the run is asked to stop before it, which it ignores.
        grace: seconds that it has then.
    """
    asked: list[None] = []
    done = 0
    with (
        contextlib.suppress(KeyboardInterrupt),
        interruptible(lambda: asked.append(None), lambda: bool(asked), grace=grace),
    ):
        for _ in range(signals):
            os.kill(os.getpid(), signal.SIGINT)
        for each in work:
            each()
            done += 1
    return done


def test_a_node_is_interrupted_where_it_is() -> None:
    assert ended(busy(LONG)) == 0


def test_an_import_gets_a_moment_to_close_its_file() -> None:
    assert ended(importing(SOON), busy(LONG)) == 1


def test_an_import_that_never_ends_is_interrupted_too() -> None:
    assert ended(importing(LONG)) == 0


def test_a_compiled_function_is_handed_over_to_numba() -> None:
    assert ended(compiling(SOON), busy(LONG), signals=0) == 1


def test_an_interrupt_that_a_finaliser_swallows_comes_again(
    capsys: pytest.CaptureFixture[str],
) -> None:
    begun = time.monotonic()
    assert ended(finalising(LONG), busy(LONG)) == 1
    assert time.monotonic() - begun < LONG
    assert "KeyboardInterrupt" not in capsys.readouterr().err


def test_what_else_a_finaliser_swallows_is_reported(monkeypatch: pytest.MonkeyPatch) -> None:
    class Held:
        def __del__(self) -> None:
            raise ValueError

    def run() -> None:
        Held()

    reported: list[type[BaseException]] = []
    monkeypatch.setattr(sys, "unraisablehook", lambda lost: reported.append(lost.exc_type))
    before = sys.unraisablehook
    assert ended(run, signals=0) == 1
    assert reported == [ValueError]
    assert sys.unraisablehook is before


def test_a_second_signal_interrupts_at_once() -> None:
    assert ended(busy(LONG), signals=2, grace=10 * LONG) == 0


def test_a_second_signal_lets_an_import_close_its_file() -> None:
    again = threading.Timer(SOON / 3, os.kill, (os.getpid(), signal.SIGINT))
    again.start()
    assert ended(importing(SOON), busy(LONG), grace=10 * LONG) == 1
    again.join()


def test_who_ends_in_time_is_not_interrupted() -> None:
    assert ended(busy(0.1), grace=10 * LONG) == 1
