"""Ticker: ends waits that nothing else ends. Zenoh's `recv` has no timeout."""

from __future__ import annotations

import threading
from collections.abc import Callable

from lodeflow.clock import monotonic


class Ticker:
    """Calls `ring` when the time set is up; one thread, asleep between.

    Args:
        ring: called on the ticker's own thread.

    Attributes:
        due: when it rings next, monotonic seconds; None for not at all. It may be set to None.
    """

    def __init__(self, ring: Callable[[], None]) -> None:
        self._ring = ring
        self.due: float | None = None
        self._sleeps_until = float("inf")
        self._changed = threading.Condition()
        self._closed = False
        self._thread = threading.Thread(target=self._work, name="ticker", daemon=True)
        self._thread.start()

    def set(self, seconds: float) -> None:
        """Ring in so many seconds, unless `due` is changed before."""
        self.due = due = monotonic() + seconds
        if due < self._sleeps_until:  # else it wakes in time by itself
            with self._changed:
                self._changed.notify()

    def close(self) -> None:
        """End the thread."""
        with self._changed:
            self._closed = True
            self._changed.notify()
        self._thread.join()

    def _work(self) -> None:
        with self._changed:
            while not self._closed:
                # Before `due` is read: who sets it from here on sees this, and waits for the lock
                # until we sleep, to wake us.
                self._sleeps_until = float("inf")
                due, now = self.due, monotonic()
                if due is None:
                    self._changed.wait()
                elif due > now:
                    self._sleeps_until = due
                    self._changed.wait(due - now)
                else:
                    self.due = None
                    self._ring()
