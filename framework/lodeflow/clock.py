"""Clocks: the only door between wall time and event time, and only sources are handed one."""

from __future__ import annotations

import time
from typing import Protocol

NANOSECONDS_PER_SECOND = 1_000_000_000


def seconds(value: float) -> int:
    """Return a duration given in seconds as integer nanoseconds, the unit of all stamps."""
    return round(value * NANOSECONDS_PER_SECOND)


class Clock(Protocol):
    """What a source is handed; stamps are int nanoseconds of event time."""

    @property
    def start(self) -> int:
        """Event time at which the run starts."""

    def now(self) -> int:
        """Return the event time of this moment."""


class SimClock:
    """Event time of a run that goes as fast as its data: it starts where it is told to.

    Nothing moves it but `advance`, so that two runs see the same times.
    """

    def __init__(self, start: int = 0) -> None:
        self.start = start
        self._now = start

    def now(self) -> int:
        """Return the event time reached."""
        return self._now

    def advance(self, t: int) -> None:
        """Move on to `t`; never back."""
        self._now = max(self._now, t)


class WallClock:
    """Event time is wall time (Unix epoch), unaffected by steps of the system clock in a run."""

    def __init__(self) -> None:
        self.start = time.time_ns()
        self._origin = self.start - time.monotonic_ns()

    def now(self) -> int:
        """Return the wall time, monotonic within the run."""
        return self._origin + time.monotonic_ns()


class Pacer:
    """Holds a run back to wall time: event time `t` is due (t - first) / speed after the first."""

    def __init__(self, speed: float = 1.0) -> None:
        self._speed = speed
        self._first: int | None = None
        self._origin = 0

    def remaining(self, t: int) -> float:
        """Return the seconds until `t` is due; negative if it is late."""
        now = time.monotonic_ns()
        if self._first is None:
            self._first, self._origin = t, now
        due = self._origin + (t - self._first) / self._speed
        return (due - now) / NANOSECONDS_PER_SECOND

    def reached(self) -> int:
        """Return the event time that is due now; `remaining` has been asked before."""
        passed = time.monotonic_ns() - self._origin
        return (self._first or 0) + int(passed * self._speed)


def monotonic() -> float:
    """Return monotonic wall time in seconds, for progress and flushing, never for data."""
    return time.monotonic()


def wall_time() -> int:
    """Return wall time in nanoseconds, for provenance and file names, never for data."""
    return time.time_ns()


def sleep(duration: float) -> None:
    """Do nothing for so many seconds; for supervisors, never for data."""
    time.sleep(duration)
