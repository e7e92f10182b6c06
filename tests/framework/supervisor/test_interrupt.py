"""A run that does not stop by itself is interrupted, and makes no noise."""

from __future__ import annotations

import gc
import os
import signal
import sys
import time
from collections.abc import Callable, Iterator

import llvmlite.binding as llvm
import pytest

import lodeflow as lf
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


def busy(seconds: float) -> Work:
    """Return work that takes some time."""

    def run() -> None:
        until = time.monotonic() + seconds
        while time.monotonic() < until:
            pass

    return run


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


class Slow(lf.Node):
    def step(self, x: lf.Heading) -> lf.Heading:
        busy(LONG)()
        return x


def ended(
    *work: Work,
    signals: int = 1,
    grace: float = 0.05,
    patience: float = 0.0,
    begun: bool = True,
    number: signal.Signals = signal.SIGINT,
) -> int:
    """Do work, one after the other; return how much of it ended.

    Args:
        work: what is done.
        signals: how often the run is asked to stop before it, which it ignores.
        grace: seconds that it has then.
        patience: seconds more where no plugin is at work.
        begun: whether data have come.
        number: of the signal that asks.
    """
    done = 0
    with interruptible(lambda: None, grace, patience, lambda: begun):
        try:
            for _ in range(signals):
                os.kill(os.getpid(), number)
            for each in work:
                each()
                done += 1
        except KeyboardInterrupt:
            pass
    return done


def test_a_node_is_interrupted_where_it_is() -> None:
    assert ended(busy(LONG)) == 0


def test_a_compiled_function_is_handed_over_to_numba() -> None:
    assert ended(compiling(SOON), busy(LONG), signals=0) == 1


def test_an_interrupt_that_a_finaliser_swallows_comes_again(
    capsys: pytest.CaptureFixture[str],
) -> None:
    begun = time.monotonic()
    assert ended(finalising(LONG), busy(LONG)) == 1
    assert time.monotonic() - begun < LONG
    assert "KeyboardInterrupt" not in capsys.readouterr().err


class HalfMade:
    """In a cycle, and complains when it goes."""

    def __init__(self) -> None:
        self.me = self

    def __del__(self) -> None:
        raise ValueError


def leaving(seconds: float) -> Work:
    """Return work that holds something."""

    def run() -> None:
        held = HalfMade()
        busy(seconds)()
        assert held

    return run


@pytest.mark.parametrize(("seconds", "told"), [(0.0, [ValueError]), (LONG, [])])
def test_what_a_finaliser_complains_of_is_told_if_nobody_interrupted(
    monkeypatch: pytest.MonkeyPatch, seconds: float, told: list[type[Exception]]
) -> None:
    complaints: list[type[BaseException]] = []
    monkeypatch.setattr(sys, "unraisablehook", lambda lost: complaints.append(lost.exc_type))
    before = sys.unraisablehook
    assert ended(leaving(seconds), signals=int(seconds > 0)) == (seconds == 0)
    gc.collect()
    assert complaints == told
    assert sys.unraisablehook is before


def test_a_second_ctrl_c_interrupts_at_once() -> None:
    assert ended(busy(LONG), signals=2, grace=10 * LONG) == 0


def test_a_second_sigterm_does_not() -> None:
    assert ended(busy(0.1), signals=2, grace=10 * LONG, number=signal.SIGTERM) == 1


@pytest.mark.parametrize("begun", [False, True])
def test_a_plugin_at_its_start_is_interrupted_at_once(begun: bool) -> None:
    class Starting(lf.Node):
        def start(self) -> None:
            busy(SOON)()

        def step(self, x: lf.Heading) -> None: ...

    class AskedMeanwhile(Starting):
        def start(self) -> None:
            os.kill(os.getpid(), signal.SIGINT)
            super().start()

    work = AskedMeanwhile().start
    assert ended(work, signals=0, grace=10 * LONG, begun=begun) == int(begun)


def test_where_no_plugin_is_at_work_there_is_more_patience() -> None:
    assert ended(busy(0.3), patience=10 * LONG) == 1
    assert ended(busy(LONG), patience=0.1) == 0
    assert ended(lambda: Slow().step(lf.Heading.of(0, heading=0.0)), patience=10 * LONG) == 0


def test_who_ends_in_time_is_not_interrupted() -> None:
    assert ended(busy(0.1), grace=10 * LONG) == 1
