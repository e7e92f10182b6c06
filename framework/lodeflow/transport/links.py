"""Links: the exchange of a group with all others of its run, over one Zenoh session."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Sequence
from typing import Any

import zenoh
from zenoh.handlers import FifoChannel

from lodeflow.clock import monotonic, wall_time
from lodeflow.graph import Graph, Wire
from lodeflow.graph.groups import RECORDER
from lodeflow.graph.partition import Part
from lodeflow.messages.cdr import layout_of
from lodeflow.messages.message import Message
from lodeflow.runtime.exchange import Bell, Driver, Enter
from lodeflow.sync import END
from lodeflow.transport import frame as frames
from lodeflow.transport import keys
from lodeflow.transport.frame import INCARNATIONS, Frame, flags_of, head_of
from lodeflow.transport.inlet import Inlet
from lodeflow.transport.link import HELLO_EVERY, Link
from lodeflow.transport.losses import LinkLosses
from lodeflow.transport.outlet import Outlet
from lodeflow.transport.session import put
from lodeflow.transport.ticker import Ticker

CAPACITY = 1 << 16
"""Frames that may wait in Zenoh's queue; the windows of all links keep it far from full."""
TEND_EVERY = 0.005
"""Seconds after which a link is asked whether it has something to say of itself."""
BATCH = 32
"""Frames that are worked on before what came of them is passed on."""

_unpack, _HEAD_SIZE = frames.HEAD.unpack_from, frames.HEAD.size


class Links:
    """The exchange of one group.

    Args:
        session: an open session, used by nothing that blocks.
        graph: the whole graph; every group of a run has the same.
        part: the group that runs here.
        groups: names of all groups, in the same order everywhere.
        digest: 16 bytes that tell the graph from others; groups of another do not link.
        rounds: of word between neighbours until all know that all links of the run are up.
        on_note: called with each text that another group sends for the recorder.
        attend: called whenever frames are looked for, also before and after the data.

    Attributes:
        losses: per link, what did not arrive.
        foreign: messages of strangers on our keys; they are ignored.
        woken: whether `wake` has asked for a look since this was last set to False.
    """

    def __init__(
        self,
        session: zenoh.Session,
        graph: Graph,
        part: Part,
        groups: Sequence[str],
        digest: bytes = bytes(16),
        *,
        rounds: int = 2,
        on_note: Callable[[str, str], None] = lambda group, text: None,
        attend: Callable[[Links], None] = lambda links: None,
    ) -> None:
        self.part, self.rounds = part, rounds
        self.outlets = frozenset(part.outlets)
        self.incarnation = wall_time() // 10_000_000 % (INCARNATIONS - 1) + 1
        me = groups.index(part.name)
        self.links = {
            groups.index(peer): Link(
                peer,
                me,
                session.declare_publisher(
                    keys.link(graph.name, peer, part.name),
                    congestion_control=zenoh.CongestionControl.DROP,
                ),
                self.incarnation,
                digest,
                peer in graph.processes and graph.processes[peer].latest,
                rounds,
            )
            for peer in part.peers
        }
        self.by_name = {link.peer: link for link in self.links.values()}
        readers = {RECORDER}.union(*part.outlets.values())  # who gets the notes may fall behind too
        self._held_by = [
            link for name, link in self.by_name.items() if name in readers and not link.latest
        ]
        wires = list(graph.streams())
        kinds = {
            Wire(node.name, port.name): port.type
            for node in graph.nodes.values()
            for port in node.plugin.spec.outputs
        }
        layouts = {wire: layout_of(kinds[wire]) for wire in {*part.inlets, *part.outlets}}
        self.losses = {name: LinkLosses() for name in self.by_name}
        self._may_lose = {name for name, group in graph.processes.items() if group.allow_gaps}
        self._outlets = [
            Outlet(
                flags_of(frames.DATA, me, wires.index(wire)),
                wire,
                layouts[wire],
                {self.by_name[name]: self.losses[name] for name in readers},
            )
            for wire, readers in part.outlets.items()
        ]
        self._inlets = {
            wires.index(wire): Inlet(
                wire,
                sender,
                part.name,
                layouts[wire],
                self.losses[sender],
                lambda gap: self.note(gap.as_json()),
            )
            for wire, sender in part.inlets.items()
        }
        self._lanes = {
            flags_of(frames.DATA, groups.index(inlet.sender), number): (
                self.by_name[inlet.sender],
                inlet,
            )
            for number, inlet in self._inlets.items()
        }
        self._watches = part.name in graph.processes and graph.processes[part.name].latest
        self.foreign = 0
        self._paces = [
            inlet
            for inlet in self._inlets.values()
            if inlet.sender not in part.knot and _speaks_by_step(graph, inlet.wire)
        ]
        self._on_note = on_note
        self._attend = attend
        self._leaving: set[Link] = set()
        self._said_stop = self._tended = self._drained = 0.0
        self._came: Any = None
        self._ended: deque[tuple[Link, list[Frame], bool]] = deque()
        self._notes: deque[str] = deque()
        me_key = keys.link(graph.name, part.name, part.name)
        self._self = session.declare_publisher(me_key)
        self._subscriber = session.declare_subscriber(
            keys.link(graph.name, part.name, "*"), FifoChannel(CAPACITY)
        )
        self._bell = Bell()
        self.woken = self._by_bell = self._runs = self._room = self._owes_word = False
        self._ticker = Ticker(self._wake_by_zenoh)

    # ---- the engine's side -------------------------------------------------------------------

    def attach(self, driver: Driver, saw: Callable[[int, int], None]) -> None:
        """Take the driver that what comes is brought in to, and whose bounds are passed on."""
        for outlet in self._outlets:
            outlet.port = driver.port(outlet.wire)
        for inlet in self._inlets.values():
            inlet.enter = driver.entry(inlet.wire, saw)
        self._runs = True

    def on_arrival(self, wire: Wire, enter: Enter) -> None:
        """Give what comes over a stream to somebody else than a driver."""
        next(inlet for inlet in self._inlets.values() if inlet.wire == wire).enter = enter

    def detach(self) -> None:
        """From now on only the links are waited for, no source here."""
        self._runs = False

    def tap(self, wire: Wire) -> Callable[[Message], None]:
        """Return what takes the messages of an outlet, samples or blocks."""
        return next(o.queue.append for o in self._outlets if o.wire == wire)

    def take(self) -> bool:
        """Bring in what has come and may be worked on now; return whether anything was."""
        now = monotonic()
        if self._by_bell and now - self._drained < TEND_EVERY:
            return False  # what the links say can wait
        first, self._came = self._came, None  # what ended a wait, before all else
        if first is None:
            self.drain(now)
        moved = first is not None and self._at_once(first, now)
        for link in self._takeable():
            moved = True
            for _ in range(min(BATCH, len(link.arrived))):
                self._open(link, link.take(now))
            self._owes_word |= link.owes_word
        while self._ended:
            moved = True
            self._end(*self._ended.popleft())
        if first is not None:
            self.drain(now)
        return moved

    def flush(self) -> None:
        """Send what the outlets have, their bounds, and what the links have to say."""
        while self._notes:
            self.note(self._notes.popleft())
        now = monotonic()
        if self._owes_word or now - self._tended >= TEND_EVERY or self._watches:
            self._owes_word, self._tended = False, now
            for link in self.links.values():
                link.tend(now, at_once=self._watches)
        for outlet in self._outlets:
            outlet.send(outlet.port.bound)

    def has_room(self) -> bool:
        """Whether all readers keep up."""
        for link in self._held_by:  # a generator costs more than all else
            if link.is_full:
                self._room = False
                return False
        self._room = True
        return True

    def behind(self) -> int:
        """Return the least bound of the streams that do not depend on this group."""
        return min((inlet.bound for inlet in self._paces), default=END)

    def is_open(self) -> bool:
        """Whether a stream from another group has not ended."""
        for inlet in self._inlets.values():  # likewise
            if inlet.bound < END:
                return True
        return bool(self._ended)

    def wait(self, timeout: float) -> None:
        """Wait until a frame comes, `wake` is called, or the time is up."""
        # Who has no inlet is woken by its own sources: a bell is nearer than Zenoh, and what the
        # links say can wait for so long (unless there was no room when that was last looked at).
        self._by_bell = self._runs and self._room and not self._inlets
        if self._by_bell or self._bell.rung:
            self._bell.wait(timeout)
            return
        if self._came is not None or self._ended or self._takeable():
            return
        self._ticker.set(timeout)
        try:
            self._came = self._subscriber.recv()
        finally:
            self._ticker.due = None

    def wake(self, *, look: bool = True) -> None:
        """End a wait."""
        if look:
            self.woken = True
        self._bell.ring()
        if not self._by_bell:
            self._wake_by_zenoh()

    # ---- the group's side --------------------------------------------------------------------

    def drain(self, now: float) -> None:
        """Take in all that has come."""
        self._drained = now
        self._attend(self)
        first, self._came = self._came, None
        if first is not None:
            self._receive(first, now)
        while (sample := self._subscriber.try_recv()) is not None:
            self._receive(sample, now)

    def is_whole(self, link: Link) -> bool:
        """Whether all streams that another group reads have ended."""
        return all(outlet.bound == END for outlet in self._outlets if link in outlet.readers)

    @property
    def lossless(self) -> bool:
        """Whether everything arrived here, but for what groups owed that may have gaps."""
        return all(x.is_lossless for name, x in self.losses.items() if name not in self._may_lose)

    @property
    def has_unread(self) -> bool:
        """Whether data have come that nobody has worked on."""
        came = (frame for link in self.links.values() for frame in link.arrived)
        return any(frame.kind == frames.DATA for frame in came)

    def break_off(self) -> None:
        """End the streams that are still open where they are, and count what is missing."""
        for inlet in self._inlets.values():
            inlet.end(lost=True)

    def note(self, text: str, group: str = "") -> None:
        """Send a text to the recorder (or to a group), if it is there."""
        link = self.by_name.get(group or RECORDER)
        if link is None and self.part.name == RECORDER:
            self._on_note(RECORDER, text)
        elif link is not None:
            link.send(flags_of(frames.NOTE, link.index, 0), 0, 0, 0, text.encode())

    def left_early(self) -> set[str]:
        """Return the groups that stop, or have left, although streams have not ended."""
        if not self._leaving:
            return set()
        return {
            link.peer
            for link in self._leaving
            if link.stops or not (link.closed or self.is_whole(link))
        }

    def say_stop(self, groups: Iterable[str]) -> None:
        """Tell groups now and then that this one has been told to stop."""
        now = monotonic()
        if now - self._said_stop >= HELLO_EVERY:  # again and again: a frame may be lost
            self._said_stop = now
            for group in groups:
                self.by_name[group].say_stop()

    def later(self, text: str) -> None:
        """Send a text to the recorder at the next flush; safe in any thread."""
        self._notes.append(text)

    def gone(self, group: str, *, lost: bool = True) -> None:
        """Go on without a group that will not come back: its streams end where they are.

        Args:
            group: its name.
            lost: it has crashed, and what it still owed is missing.
        """
        link = self.by_name.get(group)
        if link is None or link.closed:
            return
        left = list(link.arrived)  # what had arrived counts
        link.close()
        self._ended.append((link, left, lost))
        self.wake()

    def close(self) -> None:
        """Stop the ticker; the session is closed by who opened it."""
        self._ticker.close()

    # ---- inside ------------------------------------------------------------------------------

    def _takeable(self) -> list[Link]:
        """Return the links with frames that may be worked on now."""
        found = [link for link in self.links.values() if link.arrived]
        if found and not self.has_room():
            return [link for link in found if link.peer in self.part.knot]
        return found

    def _wake_by_zenoh(self) -> None:
        put(self._self, head_of(0, 0, 0, 0, frames.WAKE, 0, 0))

    def _at_once(self, sample: Any, now: float) -> bool:
        """Bring in a frame without a queue, if nothing stands before it; else take it in.

        This is the way of almost every message of a live graph.
        """
        payload = head = sample.payload.to_bytes()
        if len(payload) > frames.SMALL and (attachment := sample.attachment) is not None:
            head = attachment.to_bytes()
        if len(head) >= _HEAD_SIZE:
            sequence, first, bound, rows, flags = _unpack(head)
            lane = self._lanes.get(flags)
            if lane is not None and self.has_room():
                link, inlet = lane
                if head is payload:
                    payload = payload[_HEAD_SIZE:]
                if link.pass_through(sequence, len(payload), now):
                    inlet.bring(first, bound, rows, payload)
                    self._owes_word |= link.owes_word
                    return True
        self._receive(sample, now)
        return False

    def _receive(self, sample: Any, now: float) -> None:
        attachment = sample.attachment
        head = None if attachment is None else attachment.to_bytes()
        frame = frames.part(sample.payload.to_bytes(), head)
        if frame is None:
            self.foreign += 1
        elif frame.kind == frames.WAKE:
            return
        elif (link := self.links.get(frame.group)) is None:
            self.foreign += 1
        else:
            before = link.restarts
            link.receive(frame, now)
            if frame.kind in frames.NUMBERED:
                return
            if link.departed or link.stops:
                self._leaving.add(link)
            if link.restarts > before:
                self._restarted(link.peer)
            if link.gone:
                self.gone(link.peer, lost=link.loses)

    def _open(self, link: Link, frame: Frame) -> None:
        """Bring in what a frame holds."""
        if frame.kind == frames.NOTE:
            self._on_note(link.peer, frame.payload.decode("utf-8", "replace"))
            return
        inlet = self._inlets.get(frame.stream)
        if inlet is None or inlet.sender != link.peer:
            self.losses[link.peer].undecodable += 1
            return
        inlet.bring(frame.first, frame.bound, frame.rows, frame.payload)

    def _end(self, link: Link, left: list[Frame], lost: bool) -> None:
        """End the streams of a group that is gone, behind what had arrived of them."""
        for frame in left:
            self._open(link, frame)
        for inlet in self._inlets.values():
            if inlet.sender == link.peer:
                inlet.end(lost=lost)

    def _restarted(self, peer: str) -> None:
        for inlet in self._inlets.values():
            if inlet.sender == peer:
                inlet.restarted()
        self.losses[peer].restarts += 1


def _speaks_by_step(graph: Graph, wire: Wire) -> bool:
    """Whether a port's bound moves on while its node runs."""
    port = graph.nodes[wire.node].plugin.spec.output(wire.port)
    return port is not None and port.by_step and not port.by_finish
