"""Window: every stream of a running graph has a key, and costs nothing while nobody looks.

A session of its own, so that a slow onlooker never holds up the links between groups.
"""

from __future__ import annotations

import json
import logging
import threading
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import zenoh
from zenoh.handlers import Callback, FifoChannel

from lodeflow.errors import LodeflowError
from lodeflow.graph.keyed import FromKey
from lodeflow.graph.model import Wire
from lodeflow.messages.cdr import Layout, layout_of
from lodeflow.messages.message import Message
from lodeflow.runtime.exchange import Driver
from lodeflow.runtime.plan import Plan
from lodeflow.sync import END, NEVER
from lodeflow.transport import frame as frames
from lodeflow.transport import keys
from lodeflow.transport.outside import subscribe
from lodeflow.transport.session import close_session, open_session, put

ENCODING = "application/cdr"
"""Encoding of a stream's payload; its schema is the ROS 2 name of the message type."""
ROWS_BYTES = 32 << 10
"""Size above which a block is put in pieces: each fits a batch of Zenoh's, and is dropped alone."""
SETTINGS: Mapping[str, Any] = {
    # A put is made by the run's own thread: what an onlooker has no room for is dropped at once.
    "transport/link/tx/queue/size/data": 16,
    "transport/link/tx/queue/congestion_control/drop/wait_before_drop": 0,
    "transport/link/tx/queue/congestion_control/drop/max_wait_before_drop_fragments": 2_000,
    "transport/link/tx/queue/congestion_control/block/wait_before_close": 500_000,
}

Answer = Callable[[Mapping[str, Any]], Any]
"""Answers one question, given and answered as plain data; runs on the window's own thread."""


class Window:
    """What others see of a process: its streams, and answers to their questions.

    Args:
        graph: name of the graph.
        group: name of the group that runs here.
        plan: its nodes.
        listen: endpoints.
        connect: endpoints of other programs.
        config: Zenoh configuration file to begin with.
        answer: answers questions that come over the control key.
        wake: called, on any thread, when `tend` should be.

    Raises:
        RunError: an endpoint cannot be used.
    """

    def __init__(
        self,
        graph: str,
        group: str,
        plan: Plan,
        *,
        listen: Sequence[str],
        connect: Sequence[str] = (),
        config: Path | None = None,
        answer: Answer,
        wake: Callable[[], None],
    ) -> None:
        self.session = open_session(
            listen=listen, connect=connect, settings=SETTINGS, config=config
        )
        self._plan = plan
        self._answer = answer
        self._wake = wake
        self._changed = True
        self._panes = [
            _Pane(self.session, key, Wire(node.name, port.name), port.type, self._matched)
            for node in plan.mine
            for port in node.spec.outputs
            for key in _keys(graph, plan, Wire(node.name, port.name))
        ]
        for node in plan.sources:
            if isinstance(node.plugin, FromKey):
                node.plugin.subscribe = partial(subscribe, self.session)
        self._key = keys.control(graph, group)
        self._questions = self.session.declare_queryable(self._key, FifoChannel(256))
        self._thread = threading.Thread(target=self._serve, name="window", daemon=True)
        self._thread.start()

    def tend(self, driver: Driver | None) -> None:
        """Open and close panes as onlookers come and go; called on the engine's thread."""
        if not self._changed or driver is None:
            return
        self._changed = False
        for pane in self._panes:
            wanted = pane.wanted  # read once: it changes on a thread of Zenoh
            if wanted != pane.open:
                taps = self._plan.taps[pane.wire]
                (taps.append if wanted else taps.remove)(pane.show)
                pane.open = wanted
                driver.retap(pane.wire)

    def close(self) -> None:
        """Tell onlookers that the streams have ended, and close the session."""
        for pane in self._panes:
            if pane.open:
                pane.end()
        close_session(self.session)
        self._thread.join(1.0)

    def _matched(self) -> None:
        self._changed = True
        self._wake()

    def _serve(self) -> None:
        while True:
            try:
                query = self._questions.recv()
            except zenoh.ZError:  # the session is closed
                return
            try:
                payload = query.payload
                asked = json.loads(payload.to_bytes() if payload is not None else b"{}")
                told = {"answer": self._answer(asked)}
            except LodeflowError as error:
                told = {"error": str(error)}
            except (ValueError, TypeError, KeyError, AttributeError, RecursionError) as error:
                told = {"error": f"not understood: {type(error).__name__}: {error}"}
            except Exception as error:
                logging.getLogger("lodeflow").exception("a question failed")
                told = {"error": f"lodeflow itself failed: {type(error).__name__}: {error}"}
            try:
                query.reply(self._key, json.dumps(told, default=str))
                query.drop()  # type: ignore[no-untyped-call]
            except zenoh.ZError:
                continue


def _keys(graph: str, plan: Plan, wire: Wire) -> list[str]:
    """Return the keys of a stream: its own, and what the graph gives it."""
    given = plan.graph.nodes[wire.node].keys.get(wire.port)
    return [keys.stream(graph, wire), *([] if given is None else [given])]


class _Pane:
    """One stream as others see it."""

    def __init__(
        self,
        session: zenoh.Session,
        key: str,
        wire: Wire,
        kind: type[Message],
        changed: Callable[[], None],
    ) -> None:
        self.wire = wire
        self.open = self.wanted = False
        self._layout: Layout = layout_of(kind)
        self._sequence = 0
        self._publisher = session.declare_publisher(
            key,
            encoding=zenoh.Encoding(ENCODING).with_schema(kind.ros),
            congestion_control=zenoh.CongestionControl.DROP,
        )

        def matching(status: Any) -> None:  # on a thread of Zenoh: it only sets flags
            self.wanted = bool(status.matching)
            changed()

        self._listener = self._publisher.declare_matching_listener(
            Callback(matching, indirect=False)
        )
        status: Any = self._publisher.matching_status  # declared a bool, which it is not
        self.wanted = bool(status.matching)

    def show(self, message: Any) -> None:
        """Put a sample or a block."""
        layout = self._layout
        if not message.is_block:
            t = message.t
            self._put(t, t + 1, 1, layout.encode_sample(message))
            return
        rows = max(1, ROWS_BYTES // layout.size)
        for at in range(0, len(message.t), rows):
            piece = message[at : at + rows]
            t = piece.t
            self._put(int(t[0]), int(t[-1]) + 1, len(t), layout.encode_block(piece).tobytes())

    def end(self) -> None:
        """Say that nothing more will come."""
        self._put(NEVER, END, 0, b"")

    def _put(self, first: int, bound: int, count: int, payload: bytes) -> None:
        put(
            self._publisher,
            payload,
            frames.head_of(self._sequence, first, bound, count, frames.DATA, 0, 0),
        )
        self._sequence += 1
