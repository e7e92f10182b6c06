"""What is to be measured, and what a sink writes down of it."""

from __future__ import annotations

import json
import os
import struct
import time
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Self

import numpy as np

HEAD = struct.Struct("<dd")
"""Monotonic nanoseconds at which it was sent, and its number: the first bytes of a message."""

SETTLE = 0.3
"""Seconds between the first message and those that are measured."""


@dataclass(frozen=True)
class Task:
    """One measurement.

    Attributes:
        size: bytes of a message.
        count: messages.
        hz: how many a second; 0 for as fast as it goes.
        relays: processes between the first and the last.
        rows: records in a message.
        out: where the sink writes what it saw.
        numba: whether nodes use numba.
    """

    size: int
    count: int
    hz: float = 0.0
    relays: int = 0
    rows: int = 1
    out: str = ""
    numba: bool = False

    def dumps(self) -> str:
        return json.dumps(asdict(self))

    @classmethod
    def from_environment(cls) -> Self:
        return cls(**json.loads(os.environ["TASK"]))


class Book:
    """What a sink has seen; writes it down once all has come."""

    def __init__(self, task: Task) -> None:
        self.task = task
        self.delays: list[float] = []
        self.seen = 0
        self.first = 0

    def see(self, sent: float, number: float, count: int = 1) -> bool:
        """Note a message, or so many at once; return whether it was the last."""
        now = time.monotonic_ns()
        if not self.seen:
            self.first = now
            Path(f"{self.task.out}.first").write_text(str(now))
        if self.task.hz:
            self.delays.append(now - sent)
        self.seen += count
        if number + 1 < self.task.count:
            return False
        found: dict[str, Any] = {"first": self.first, "seconds": (now - self.first) / 1e9}
        found["missing"] = int(number) + 1 - self.seen
        if self.delays:
            warm = np.array(self.delays[len(self.delays) // 10 :]) / 1e3
            found["p50"], found["p99"] = np.percentile(warm, [50, 99]).tolist()
        path = Path(self.task.out)
        path.with_suffix(".new").write_text(json.dumps(found))
        path.with_suffix(".new").rename(path)
        return True


def paced(task: Task, settle: float = SETTLE) -> Any:
    """Yield numbers from 0 at the task's pace; before the second, all settles."""
    begun = time.monotonic() + settle
    for number in range(task.count // task.rows):
        if task.hz and number:
            wait = begun + number / task.hz - time.monotonic()
            if wait > 0:
                time.sleep(wait)
        yield number


def compiled() -> Any:
    """Return a small kernel of numba, compiled: what a node with numba waits for at its start."""
    import numba

    @numba.njit(cache=True)
    def double(x: float) -> float:
        return 2.0 * x

    double(1.0)
    return double
