"""Onlooker: looks into running graphs from another process, and never holds them up.

What comes is drained by threads of our own into a bounded store; whoever is slow to take it out
misses the oldest, and nobody else notices.
"""

from __future__ import annotations

import json
import threading
from collections import deque
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import zenoh
from zenoh.handlers import RingChannel

from lodeflow.clock import monotonic
from lodeflow.errors import RunError
from lodeflow.transport import frame as frames
from lodeflow.transport import keys
from lodeflow.transport.frame import Frame
from lodeflow.transport.session import close_session, open_session

RING = 2048
"""Puts of up to 32 KB that may wait in Zenoh for our thread; then the oldest is overwritten."""
KEPT, KEPT_BYTES = 8192, 64 << 20
"""Sightings that may wait to be taken, and their bytes."""


class Answer(NamedTuple):
    """What one process has answered.

    Attributes:
        graph: name of the graph that it runs.
        group: its process group.
        told: plain data; None if it refused.
        error: why it refused, "" if it did not.
    """

    graph: str
    group: str
    told: Any
    error: str


class Sighting(NamedTuple):
    """One put on a key that is watched.

    Attributes:
        key: where.
        at: monotonic seconds at which it came.
        encoding: of the payload, such as "application/cdr;sensor_msgs/msg/Imu".
        payload: its bytes.
        frame: from its attachment; None where that is none of ours.
    """

    key: str
    at: float
    encoding: str
    payload: bytes
    frame: Frame | None


class Onlooker:
    """A session that asks questions and watches streams.

    Args:
        connect: endpoints, tried until they are there.
        config: Zenoh configuration file: certificates, user and password.

    Raises:
        RunError: an endpoint is malformed, or the file cannot be used.
    """

    def __init__(self, connect: Sequence[str], config: Path | None = None) -> None:
        self._session = open_session(connect=connect, config=config)
        self._seen: deque[Sighting] = deque()
        self._bytes = 0
        self._lock = threading.Lock()
        self._news = threading.Event()
        self._threads: list[threading.Thread] = []

    def ask(
        self, what: str, *, graph: str = "*", group: str = "*", timeout: float, **details: Any
    ) -> list[Answer]:
        """Ask all processes at once; return what those have answered that did so in time.

        Args:
            what: the question, such as "about".
            graph: name of the graph, or "*" for all.
            group: name of the process group, or "*" for all.
            timeout: seconds to wait for those that do not answer.
            **details: further members of the question.
        """
        try:
            replies = self._session.get(
                keys.control(graph, group),
                payload=json.dumps({"ask": what, **details}),
                target=zenoh.QueryTarget.ALL,
                consolidation=zenoh.ConsolidationMode.NONE,
                # Answers come back with the same: before data that waits, and never blocking.
                priority=zenoh.Priority.INTERACTIVE_HIGH,
                congestion_control=zenoh.CongestionControl.DROP,
                timeout=timeout,
            )
            found = [_answer(reply) for reply in replies]
        except zenoh.ZError as error:
            raise RunError(f"cannot ask over Zenoh: {error}") from error
        return [answer for answer in found if answer is not None]

    def watch(self, key: str) -> None:
        """Have `take` return what is put on a key expression from now on.

        Raises:
            RunError: it is no key expression.
        """
        try:
            subscriber = self._session.declare_subscriber(key, RingChannel(RING))
        except zenoh.ZError as error:
            why = str(error).split(" at ")[0]
            raise RunError(f"{key!r} is no key expression of Zenoh: {why}") from None
        thread = threading.Thread(
            target=self._drain, args=(subscriber,), name=f"watch {key}", daemon=True
        )
        self._threads.append(thread)
        thread.start()

    def take(self, timeout: float) -> list[Sighting]:
        """Return what has come since the last call; wait for it, but no longer than so (s)."""
        self._news.wait(timeout)
        with self._lock:
            self._news.clear()
            found = list(self._seen)
            self._seen.clear()
            self._bytes = 0
        return found

    def close(self) -> None:
        """Close the session, and see our threads end: one inside Zenoh at exit would abort."""
        close_session(self._session)
        for thread in self._threads:
            thread.join(1.0)

    def _drain(self, subscriber: Any) -> None:
        while True:
            try:
                sample = subscriber.recv()
            except zenoh.ZError:  # the session is closed
                return
            attachment, payload = sample.attachment, sample.payload.to_bytes()
            found = Sighting(
                str(sample.key_expr),
                monotonic(),
                str(sample.encoding),
                payload,
                None if attachment is None else frames.read(attachment.to_bytes(), payload),
            )
            with self._lock:
                self._seen.append(found)
                self._bytes += len(payload)
                while len(self._seen) > KEPT or self._bytes > KEPT_BYTES:
                    self._bytes -= len(self._seen.popleft().payload)
                self._news.set()


def _answer(reply: Any) -> Answer | None:
    """Return what a process has answered; None for what a stranger has."""
    if reply.ok is None:
        return None
    try:
        _, graph, _, group = str(reply.ok.key_expr).split("/")
        said = json.loads(reply.ok.payload.to_bytes())
        return Answer(graph, group, said.get("answer"), str(said.get("error", "")))
    except (ValueError, AttributeError, RecursionError):
        return None
