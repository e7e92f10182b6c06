"""A run that does not stop by itself is interrupted, but not while a module's file is open."""

from __future__ import annotations

import contextlib
import os
import signal
import time
from collections.abc import Iterator

import pytest

from lodeflow.supervisor.interrupt import MOMENT, MOMENTS, interruptible


@pytest.fixture(autouse=True)
def alarm() -> Iterator[None]:
    """Leave the timer of the tests as it was."""
    left = signal.setitimer(signal.ITIMER_REAL, 0.0)
    yield
    signal.setitimer(signal.ITIMER_REAL, *left)


IMPORT = "<frozen importlib._bootstrap_external>"
LONG = 20.0


def ended(*work: tuple[str, float], signals: int = 1, grace: float = 0.05) -> list[str]:
    """Run code of some files, for some seconds each; return which ended.

    Args:
        work: file and seconds.
        signals: how often the run is asked to stop, which it ignores.
        grace: seconds that it has then.
    """
    asked: list[None] = []
    done: list[str] = []
    with (
        contextlib.suppress(KeyboardInterrupt),
        interruptible(lambda: asked.append(None), lambda: bool(asked), grace=grace),
    ):
        for _ in range(signals):
            os.kill(os.getpid(), signal.SIGINT)
        for file, seconds in work:
            code = compile("while monotonic() < until: pass", file, "exec")
            exec(code, {"monotonic": time.monotonic, "until": time.monotonic() + seconds})
            done.append(file)
    return done


def test_a_node_is_interrupted_where_it_is() -> None:
    assert ended(("node.py", LONG)) == []


def test_an_import_gets_a_moment_to_close_its_file() -> None:
    seconds = 0.3
    assert seconds < MOMENT * MOMENTS
    assert ended((IMPORT, seconds), ("node.py", LONG)) == [IMPORT]


def test_an_import_that_never_ends_is_interrupted_too() -> None:
    assert ended((IMPORT, LONG)) == []


def test_a_second_signal_interrupts_at_once() -> None:
    assert ended(("node.py", LONG), signals=2, grace=10 * LONG) == []


def test_who_ends_in_time_is_not_interrupted() -> None:
    assert ended(("node.py", 0.1), grace=10 * LONG) == ["node.py"]
