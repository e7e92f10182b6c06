"""Link: the conversation with one other group. What it sends arrives, once and in order.

Zenoh is asked to drop rather than to block, so that no put holds anybody up. Each frame is kept
until the other side has taken it; what was dropped, or lost with a cut cable, is sent again. The
window of frames not yet taken is the credit: while it is full, the sources here are held back.
"""

from __future__ import annotations

import struct
from collections import deque
from typing import Any, NamedTuple

import zenoh

from lodeflow.transport import frame as frames
from lodeflow.transport.frame import (
    COUNT_BITS,
    COUNT_MASK,
    INCARNATIONS,
    Frame,
    Payload,
    head_of,
    join,
)
from lodeflow.transport.outbox import Outbox
from lodeflow.transport.session import put

ACK_FRAMES, ACK_BYTES, ACK_AFTER = 64, 256 << 10, 0.02
"""What is taken is acknowledged after so many frames, bytes, or seconds: a small part of the window
only, or its sender would stop and go."""
HELLO_EVERY = 0.05
PROBE_AFTER, PROBE_MOST = 0.2, 1.0
"""Seconds without an acknowledgement until the other side is asked what it has; doubled each time.
It may only be slow, so nothing is sent again unasked."""
SURE = (1 << 32) - 1
"""In place of a turn: what was sent again has gone by, without what is missing."""

_pack = frames.HEAD.pack
_HELLO = struct.Struct("<QQQHHH16s")


class Hello(NamedTuple):
    """What groups tell each other of themselves until both know enough.

    Attributes:
        incarnation: of the sender; a restarted process has a higher one.
        heard: incarnation of the receiver that the sender knows of, or 0.
        base: number of the oldest frame that the sender still keeps.
        ready: of the sender, see `Link`.
        known: what it knows of the receiver's.
        agreed: what it knows that the receiver knows of the sender's.
        graph: digest of the graph that it runs.
    """

    incarnation: int
    heard: int
    base: int
    ready: int
    known: int
    agreed: int
    graph: bytes


def newer(one: int, other: int) -> bool:
    """Whether an incarnation came after another; their numbers wrap."""
    return 0 < (one - other) % INCARNATIONS < INCARNATIONS // 2


class Link:
    """One side of a conversation. All calls come from one thread.

    Args:
        peer: name of the other group.
        index: number of this group, which goes into its frames.
        publisher: at the other group's key.
        incarnation: of this process, above 0.
        graph: digest of the graph that runs here.
        latest: the other group only watches; it holds nobody back, and misses what comes while
            its window is full.
        rounds: how far both are ready when the run begins.

    Attributes:
        ready: how far this group is: 0 if not all of its links are up; else one more than the
            least that a neighbour is. So n says that all links within n - 1 links from here are up.
        arrived: frames in order that nobody has worked on yet.
        joined: both sides have heard each other.
        peer_ready: how far the other side is.
        departed: the other side has nothing more to send, and everything from here.
        closed: the other group is gone for good.
        gone: the other side has said so itself, with some of its frames not taken.
        loses: and something is missing with it; it had begun.
        stops: the other side has been told to stop.
        restarts: how often the other side began anew.
        refused: digest of another graph, if that is what the other side runs.
    """

    def __init__(
        self,
        peer: str,
        index: int,
        publisher: zenoh.Publisher,
        incarnation: int,
        graph: bytes,
        latest: bool = False,
        rounds: int = 1,
    ) -> None:
        self.peer, self.index = peer, index
        self.publisher = publisher
        self.incarnation, self.graph = incarnation, graph
        self.latest, self.rounds = latest, rounds
        self.ready = self.peer_ready = self._known = 0
        self.joined = self.departed = self.closed = False
        self.gone = self.loses = self.stops = False
        self.restarts = 0
        self.refused: bytes | None = None
        self.arrived: deque[Frame] = deque()
        self._theirs = 0
        self._expected = 0
        self._done = 0
        self._taken = 0
        self._taken_bytes = 0
        self._taken_since = 0.0
        self._asked = (-1, 0, 0.0)
        self._heard_turn, self._latest = 0, -1
        self._turn, self._again = 0, -1
        self._outbox = Outbox(publisher, latest)
        self._progress = 0.0
        self._patience = PROBE_AFTER
        self._greeted = 0.0

    @property
    def waiting(self) -> int:
        """Frames sent and not yet taken by the other side."""
        return len(self._outbox)

    @property
    def sent_again(self) -> int:
        """Frames that were lost, or may have been, and were sent once more."""
        return self._outbox.sent_again

    @property
    def owes(self) -> int:
        """Frames that the other side has not taken and may still want."""
        return 0 if self.departed else len(self._outbox)

    @property
    def owes_rows(self) -> int:
        """Records in these frames; others only say how far a stream has come, or hold a text."""
        return 0 if self.departed else self._outbox.rows

    @property
    def is_matched(self) -> bool:
        """Whether the other side is there to hear anything."""
        status: Any = self.publisher.matching_status  # declared a bool, which it is not
        return bool(status.matching)

    @property
    def owes_word(self) -> bool:
        """Whether so much has been taken that the other side should hear of it soon."""
        return self._taken >= ACK_FRAMES or self._taken_bytes >= ACK_BYTES

    @property
    def is_full(self) -> bool:
        """Whether the other side has to catch up first."""
        return not self.closed and self._outbox.is_full

    def send(self, flags: int, first: int, bound: int, count: int, payload: Payload) -> None:
        """Send a frame in sequence, and keep it until it is taken.

        Args:
            flags: see `flags_of`.
            first: its first stamp.
            bound: of its stream.
            count: records in it.
            payload: the records, or a text.
        """
        if self.closed:
            return
        sequence = self.incarnation << COUNT_BITS | self._outbox.next
        head = _pack(sequence, first, bound, count, flags)
        self._outbox.add(*join(head, payload), count)

    def receive(self, frame: Frame, now: float) -> None:
        """Take a frame of the other side in."""
        if frame.kind in frames.NUMBERED:
            self._arrive(frame, now)
            return
        if frame.kind == frames.GONE and frame.sequence >> COUNT_BITS == self._theirs:
            self.gone, self.loses = True, not frame.rows
            self._say(frames.BYE, 0)  # so that it need not say so again
        if self.closed:
            return
        if frame.kind == frames.HELLO:
            self._hear(frame.payload, now)
            return
        if frame.sequence >> COUNT_BITS != self._theirs or not self._theirs:
            return  # of an earlier incarnation, or before its hello
        if frame.kind in (frames.ACK, frames.AGAIN):
            if self._outbox.taken(frame.first):
                self._progress = now
                self._patience = PROBE_AFTER
            # What was sent again may still be on its way, on a slow link for long: it goes once
            # more only if something that went behind it has come, and it has not.
            is_new = frame.bound != self._again or frame.rows in (self._turn, SURE)
            if frame.kind == frames.AGAIN and is_new:
                self._send_again(now, since=frame.bound)
            return
        if frame.kind == frames.PROBE:
            # Frames come in the order in which they were sent: what is not here now was lost.
            self._heard_turn = frame.rows
            if frame.bound > self._expected:
                self._ask(now)
            else:
                self._say(frames.ACK, self._done)
            return
        if frame.kind == frames.BYE:
            self.departed = True
            return
        if frame.kind == frames.STOP:
            self.stops = True

    def pass_through(self, sequence: int, size: int, now: float) -> bool:
        """Take a numbered frame in and hand it out at once, as its receiver does if nothing waits.

        Args:
            sequence: of the frame.
            size: bytes of its payload.
            now: monotonic seconds.

        Returns:
            Whether it is the one that is due, and may be worked on.
        """
        number = sequence & COUNT_MASK
        if (
            number != self._expected
            or self.arrived
            or sequence >> COUNT_BITS != self._theirs
            or self.closed
            or not self._theirs
        ):
            return False
        self._expected = self._done = number + 1
        self._taken += 1
        self._taken_bytes += size
        self._taken_since = self._taken_since or now
        return True

    def _arrive(self, frame: Frame, now: float) -> None:
        """Take a numbered frame in."""
        sequence = frame.sequence
        if self.closed or sequence >> COUNT_BITS != self._theirs or not self._theirs:
            return  # of an earlier incarnation, or before its hello: it will come again
        number = sequence & COUNT_MASK
        if number == self._expected:
            self._expected = number + 1
            self.arrived.append(frame)
        elif number > self._expected:
            # Numbers fall back only where frames are sent again.
            went_by, self._latest = number < self._latest, number
            self._ask(now, sure=went_by)
        else:  # it came twice: the acknowledgement may have been lost
            self._taken_since = self._taken_since or now
            self._taken = max(self._taken, 1)

    def take(self, now: float) -> Frame:
        """Return the next frame in order; `tend` will acknowledge it."""
        frame = self.arrived.popleft()
        if frame.sequence >> COUNT_BITS == self._theirs:  # not of before a restart
            self._done = (frame.sequence & COUNT_MASK) + 1
        self._taken += 1
        self._taken_bytes += len(frame.payload)
        self._taken_since = self._taken_since or now
        return frame

    def tend(self, now: float, *, at_once: bool = False) -> None:
        """Acknowledge, greet, and send again, as far as it is time to.

        Args:
            now: monotonic seconds.
            at_once: acknowledge also what could wait.
        """
        if self.closed:
            return
        if self._taken and (at_once or self.owes_word or now - self._taken_since >= ACK_AFTER):
            self._taken = self._taken_bytes = 0
            self._taken_since = 0.0
            self._say(frames.ACK, self._done)
        if not self.joined or min(self.peer_ready, self._known) < self.rounds:
            if now - self._greeted >= HELLO_EVERY:
                self.greet(now)
        elif not self._outbox:
            self._progress = now
        elif now - self._progress >= self._patience:
            self._patience = min(2 * self._patience, PROBE_MOST)
            self._progress = now
            self._probe()

    def greet(self, now: float) -> None:
        """Tell the other side what it may not know yet."""
        self._greeted = now
        state = (self.ready, self.peer_ready, self._known)
        hello = _HELLO.pack(self.incarnation, self._theirs, self._outbox.base, *state, self.graph)
        put(self.publisher, head_of(0, 0, 0, 0, frames.HELLO, self.index, 0) + hello)

    def say_end(self, *, whole: bool, begun: bool = True) -> None:
        """Tell the other side that all is done here, or that what it still waits for is lost.

        Args:
            whole: all streams that it reads have ended.
            begun: there may be something to lose.
        """
        if whole and not self.owes:
            self._say(frames.BYE, 0)
        else:
            self._say(frames.GONE, 0, turn=int(not begun))

    def say_stop(self) -> None:
        """Tell the other side that this one has been told to stop."""
        self._say(frames.STOP, 0)

    def close(self) -> None:
        """Forget a group that is gone for good."""
        self.closed = True
        self._outbox.clear()
        self.arrived.clear()

    def _ask(self, now: float, *, sure: bool = False) -> None:
        """Ask for what was lost, but not with each frame that comes behind it."""
        number, turn, when = self._asked
        is_new = (number, turn) != (self._expected, self._heard_turn)
        if sure or is_new or now - when > HELLO_EVERY:
            self._asked = (self._expected, self._heard_turn, now)
            turn = SURE if sure else self._heard_turn
            self._say(frames.AGAIN, self._done, self._expected, turn)

    def _probe(self) -> None:
        """Ask the other side what it has got of all that was sent before this."""
        self._say(frames.PROBE, 0, self._outbox.sent, self._turn)

    def _say(self, kind: int, done: int, number: int = 0, turn: int = 0) -> None:
        sequence = self.incarnation << COUNT_BITS
        put(self.publisher, head_of(sequence, done, number, turn, kind, self.index, 0))

    def _hear(self, payload: bytes, now: float) -> None:
        if len(payload) != _HELLO.size:
            return
        hello = Hello(*_HELLO.unpack(payload))
        if hello.graph != self.graph:
            self.refused = hello.graph
            return
        if self._theirs != hello.incarnation:
            if self._theirs and not newer(hello.incarnation, self._theirs):
                return  # said before it was restarted
            self.restarts += bool(self._theirs)
            self._theirs = hello.incarnation
            self._expected = self._done = hello.base
            self._asked = (-1, 0, 0.0)
            self._heard_turn, self._latest = 0, -1
            self._taken = self._taken_bytes = 0
            self.joined = self.departed = False
            self._greeted = 0.0
        if hello.heard == self.incarnation and not self.joined:
            self.joined = True
            self._send_again(now)
        self.peer_ready = hello.ready
        self._known = hello.known if hello.heard == self.incarnation else 0
        # Answer only what it does not know yet and we do: else two would talk without end.
        if (
            hello.heard != self.incarnation
            or hello.known != self.ready
            or hello.agreed != self.peer_ready
        ):
            self.greet(now)

    def _send_again(self, now: float, since: int = 0) -> None:
        """Send frames from a number on again, with a probe behind the first of them."""
        self._progress = now
        self._again, self._turn = since, (self._turn + 1) % SURE
        if since < self._outbox.next:
            self._outbox.again(since)
            self._probe()
