"""Outbox: the frames that a link sends, until the other side has taken them.

Frames that nobody has taken yet are the credit: while there are too many, the sources here are held
back. How many of them may be on their way at once is another matter: Zenoh drops what a slow
network has no room for, so this is found out as TCP does (slow start and congestion avoidance,
RFC 5681), and the others wait here.
"""

from __future__ import annotations

from collections import deque

import zenoh

from lodeflow.transport.frame import Payload
from lodeflow.transport.session import put

WINDOW = 1024
"""Frames not taken, at most."""
WINDOW_BYTES = 32 << 20
"""Bytes not taken, at most (one frame more, where a frame is larger)."""
WINDOW_ROWS, FEW = 1 << 14, 8
"""Records not taken, at most, where they are in more than a few frames: samples of a live device
are to wait at the device, where they are counted when they overflow."""
LATEST = 64
"""Frames, or records, not taken by who only watches, at most: so far it can be behind."""
LEAST, STEP = 1 << 20, 1 << 16
"""Bytes that may be on their way at first and after a loss, and how many more with each round trip
from near the amount on that was too much."""


class Outbox:
    """What a link sends, and sends again.

    Args:
        publisher: at the other group's key.
        latest: the other group only watches.

    Attributes:
        next: number of the next frame.
        rows: records in the frames that are kept.
        sent_again: frames that were lost, or may have been, and go once more.
    """

    def __init__(self, publisher: zenoh.Publisher, latest: bool) -> None:
        self.publisher, self.latest = publisher, latest
        self.next = 0
        self.sent_again = 0
        self._kept: deque[tuple[Payload, bytes | None, int]] = deque()
        self._ahead: deque[int] = deque()  # of each that was put: bytes on their way before it
        self.rows = self._bytes = self._underway = 0
        self._allowed, self._knee = LEAST, WINDOW_BYTES

    def __len__(self) -> int:
        return len(self._kept)

    @property
    def base(self) -> int:
        """Number of the oldest frame that is kept."""
        return self.next - len(self._kept)

    @property
    def sent(self) -> int:
        """Number before which all frames were put."""
        return self.base + len(self._ahead)

    @property
    def is_full(self) -> bool:
        """Whether the other side has to catch up first."""
        frames = len(self._kept)
        if self.latest:
            return frames >= LATEST or self.rows >= LATEST
        return (
            frames >= WINDOW
            or self._bytes >= WINDOW_BYTES
            or (self.rows >= WINDOW_ROWS and frames > FEW)
        )

    def add(self, payload: Payload, attachment: bytes | None, rows: int) -> None:
        """Send the frame `next`, at once if it may be, and keep it until it is taken."""
        size = len(payload)
        if len(self._ahead) == len(self._kept) and self._underway < self._allowed:
            put(self.publisher, payload, attachment)  # before all that can be done meanwhile
            self._ahead.append(self._underway)
            self._underway += size
        self._kept.append((payload, attachment, rows))
        self.next += 1
        self._bytes += size
        self.rows += rows

    def taken(self, number: int) -> bool:
        """Forget all frames before a number, which the other side has taken; send what waits.

        Returns:
            Whether there were any; a number that none of ours can have changes nothing.
        """
        if not self.base < number <= self.next:
            return False
        before = self._bytes
        for _ in range(number - self.base):
            payload, _, rows = self._kept.popleft()
            self._bytes -= len(payload)
            self.rows -= rows
            if self._ahead:
                self._ahead.popleft()
                self._underway -= len(payload)
        size = before - self._bytes
        more = size if self._allowed < self._knee else STEP * size // self._allowed
        self._allowed = min(self._allowed + more, WINDOW_BYTES)
        self._go_on()
        return True

    def again(self, since: int) -> None:
        """Send all frames from a number on once more: the first of them was lost."""
        kept = max(since - self.base, 0)
        if kept >= len(self._ahead):
            return
        if ahead := self._ahead[kept]:  # else it was not too much, but cut off
            self._knee = max(ahead * 3 // 4, LEAST)
        self._allowed = LEAST
        while len(self._ahead) > kept:
            self._ahead.pop()
            self._underway -= len(self._kept[len(self._ahead)][0])
            self.sent_again += 1
        self._go_on()

    def clear(self) -> None:
        """Forget all frames."""
        self._kept.clear()
        self._ahead.clear()
        self._bytes = self.rows = self._underway = 0

    def _go_on(self) -> None:
        """Put frames that have waited, as many as may be on their way."""
        while len(self._ahead) < len(self._kept) and self._underway < self._allowed:
            payload, attachment, _ = self._kept[len(self._ahead)]
            put(self.publisher, payload, attachment)
            self._ahead.append(self._underway)
            self._underway += len(payload)
