"""A child hears what it is told, however early."""

from __future__ import annotations

import os
import signal
import time
from collections import deque
from collections.abc import Callable
from typing import Any

from lodeflow.supervisor.child import Child
from lodeflow.supervisor.interrupt import interruptible
from lodeflow.supervisor.setup import Report


def work(tell: Callable[[Any], None], orders: deque[Any], awake: list[Any]) -> Report:
    """Begin slowly, and run until the end is asked for."""
    stopping: list[None] = []
    time.sleep(0.3)
    with interruptible(lambda: stopping.append(None), by=(signal.SIGTERM,)) as closing:
        tell("ready")
        until = time.monotonic() + 20.0
        while not stopping and time.monotonic() < until:
            time.sleep(0.01)
        closing()
    return Report(stopped=bool(stopping))


def told(child: Child) -> list[Any]:
    """Return all that a child tells until it ends."""
    heard: list[Any] = []
    while not heard or heard[-1] is not None:
        heard += child.pipe.receive()
    return heard[:-1]


def test_a_signal_that_comes_while_it_begins_stops_it() -> None:
    child = Child("early", work, ())
    child.signal(signal.SIGTERM)
    heard = told(child)
    _, status = os.waitpid(child.pid, 0)
    child.close()
    assert os.waitstatus_to_exitcode(status) == 0
    assert heard[0] == "ready"
    assert isinstance(heard[1], Report)
    assert heard[1].stopped


def test_its_supervisor_is_as_before() -> None:
    child = Child("early", work, ())
    child.signal(signal.SIGKILL)
    os.waitpid(child.pid, 0)
    child.close()
    assert signal.SIGTERM not in signal.pthread_sigmask(signal.SIG_BLOCK, ())
