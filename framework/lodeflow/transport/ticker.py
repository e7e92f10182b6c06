"""Ticker: ends waits that nothing else ends. Zenoh's `recv` has no timeout."""

from __future__ import annotations

import threading
from collections.abc import Callable

from lodeflow.clock import monotonic


class Ticker:
    """Calls `ring` when the time set is up; one thread, asleep between.

    Args:
        ring: called on the ticker's own thread.
    """

    def __init__(self, ring: Callable[[], None]) -> None:
        self._ring = ring
        self._due: float | None = None
        self._sleeps_until = float("inf")
        self._changed = threading.Condition()
        self._closed = False
        self._thread = threading.Thread(target=self._work, name="ticker", daemon=True)
        self._thread.start()

    def set(self, seconds: float) -> None:
        """Ring in so many seconds, if `clear` is not called before."""
        due = monotonic() + seconds
        with self._changed:
            self._due = due
            if due < self._sleeps_until:  # else it wakes in time by itself
                self._changed.notify()

    def clear(self) -> None:
        """Ring no more."""
        self._due = None

    def close(self) -> None:
        """End the thread."""
        with self._changed:
            self._closed = True
            self._changed.notify()
        self._thread.join()

    def _work(self) -> None:
        with self._changed:
            while not self._closed:
                due, now = self._due, monotonic()
                if due is None:
                    self._sleeps_until = float("inf")
                    self._changed.wait()
                elif due > now:
                    self._sleeps_until = due
                    self._changed.wait(due - now)
                else:
                    self._due = None
                    self._ring()
