"""Two links over a network that drops, repeats and delays: all arrives, once and in order."""

from __future__ import annotations

import random
from collections import deque
from collections.abc import Callable
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lodeflow.transport import frame as frames
from lodeflow.transport import outbox
from lodeflow.transport.frame import SMALL, Frame, head_of, join, part, read
from lodeflow.transport.link import HELLO_EVERY, Link, newer
from lodeflow.transport.outbox import WINDOW

SETTINGS = settings(max_examples=60, deadline=None, derandomize=True, database=None)
GRAPH = b"g" * 16


class Wire:
    """Stands for a publisher: what is put waits here until the network moves it."""

    def __init__(self) -> None:
        self.queue: deque[tuple[bytes, bytes | None]] = deque()

    def put(self, payload: bytes, attachment: bytes | None) -> None:
        self.queue.append((payload, attachment))


class Network:
    """Two links, and a clock that only the test moves."""

    def __init__(self, rng: random.Random, loss: float = 0.0) -> None:
        self.rng, self.loss = rng, loss
        self.now = 100.0
        self.ends: dict[str, Link] = {}
        self.wires = {"a": Wire(), "b": Wire()}
        self.incarnation = 0
        self.begin("a")
        self.begin("b")

    def begin(self, name: str) -> None:
        """Start one side, or start it again."""
        self.incarnation += 1
        peer = "b" if name == "a" else "a"
        publisher: Any = self.wires[name]
        self.ends[name] = Link(peer, "ab".index(name), publisher, self.incarnation, GRAPH)

    def move(self, seconds: float = 0.01) -> None:
        """Let time pass, and what is on its way arrive, or not."""
        self.now += seconds
        for name, peer in (("a", "b"), ("b", "a")):
            queue = self.wires[name].queue
            while queue:
                frame = part(*queue.popleft())
                assert frame is not None
                times = 0 if self.rng.random() < self.loss else self.rng.choice([1, 1, 1, 2])
                for _ in range(times):
                    self.deliver(peer, frame)
        for end in self.ends.values():
            joined = end.joined
            end.ready = joined
            end.tend(self.now)

    def deliver(self, peer: str, frame: Frame) -> None:
        self.ends[peer].receive(frame, self.now)

    def join(self) -> None:
        for _ in range(1000):
            self.move(HELLO_EVERY)
            if all(end.joined and end.peer_ready for end in self.ends.values()):
                return
        raise AssertionError("the links did not come up")


def send(link: Link, text: str) -> None:
    link.send(frames.flags_of(frames.DATA, link.index, 0), 0, 0, 1, text.encode())


def taken(link: Link, now: float) -> list[str]:
    return [link.take(now).payload.decode() for _ in range(len(link.arrived))]


def test_a_head_has_32_bytes_and_comes_back() -> None:
    data = head_of(2**63 + 5, -7, 2**62, 9, frames.NOTE, 1023, 2**18 - 1)
    assert len(data) == 32
    assert read(data, b"x") == Frame(2**63 + 5, -7, 2**62, 9, frames.NOTE, 1023, 2**18 - 1, b"x")
    assert read(data[:-1], b"x") is None


@pytest.mark.parametrize("size", [0, 1, SMALL, SMALL + 1])
def test_the_head_of_a_small_frame_stands_before_it(size: int) -> None:
    head, records = head_of(1, 2, 3, 4, frames.DATA, 5, 6), bytes(range(256)) * 17
    payload, attachment = join(head, bytearray(records[:size]))
    assert (attachment is None) == (size <= SMALL)
    assert part(bytes(payload), attachment) == read(head, records[:size])


@SETTINGS
@given(payload=st.binary(max_size=80), attachment=st.none() | st.binary(max_size=40))
def test_garbage_is_a_frame_only_with_a_head(payload: bytes, attachment: bytes | None) -> None:
    has_head = len(payload) >= 32 if attachment is None else len(attachment) == 32
    assert (part(payload, attachment) is not None) == has_head


class Passing(Network):
    """One that lets frames through where it can, but not always tries."""

    def __init__(self, rng: random.Random, loss: float) -> None:
        self.got: list[str] = []
        super().__init__(rng, loss)

    def deliver(self, peer: str, frame: Frame) -> None:
        end = self.ends[peer]
        tries = frame.kind in frames.NUMBERED and self.rng.random() < 0.7
        if tries and end.pass_through(frame.sequence, len(frame.payload), self.now):
            self.got.append(frame.payload.decode())
            return
        super().deliver(peer, frame)
        if self.rng.random() < 0.5:
            self.got += taken(end, self.now)


@SETTINGS
@given(st.integers(0, 2**32), st.floats(0.0, 0.5), st.integers(1, 60))
def test_frames_that_pass_through_keep_their_place(seed: int, loss: float, count: int) -> None:
    network = Passing(random.Random(seed), loss)
    network.join()
    a, b = network.ends["a"], network.ends["b"]
    sent = [f"{i}" for i in range(count)]
    for text in sent:
        send(a, text)
    for _ in range(2000):
        network.got += taken(b, network.now)
        if not a.waiting:
            break
        network.move(0.05)
    assert network.got == sent
    assert not a.waiting  # what passed through is acknowledged too


def test_only_the_next_frame_passes_through() -> None:
    network = Passing(random.Random(1), 0.0)
    network.join()
    b = network.ends["b"]
    first = network.ends["a"].incarnation << frames.COUNT_BITS
    assert not b.pass_through(first + 1, 5, network.now)  # one is missing
    assert not b.pass_through(first + (1 << frames.COUNT_BITS), 5, network.now)  # of another
    assert b.pass_through(first, 5, network.now)
    assert not b.pass_through(first, 5, network.now)  # it came twice
    data = head_of(first + 1, 0, 0, 1, frames.DATA, 0, 0)
    b.receive(read(data, b"hello") or pytest.fail("no frame"), network.now)
    assert not b.pass_through(first + 2, 5, network.now)  # one waits before it
    assert taken(b, network.now) == ["hello"]
    assert b.pass_through(first + 2, 5, network.now)


def all_arrives(seed: int, loss: float, count: int) -> None:
    network = Network(random.Random(seed), loss)
    network.join()
    a, b = network.ends["a"], network.ends["b"]
    got: dict[str, list[str]] = {"a": [], "b": []}
    sent = [f"{i}" for i in range(count)]
    for text in sent:
        send(a, text)
        send(b, text)
        if network.rng.random() < 0.5:
            network.move()
            got["b"] += taken(b, network.now)
            got["a"] += taken(a, network.now)
    for _ in range(5000):
        if not (a.waiting or b.waiting):
            break
        network.move(0.05)
        got["b"] += taken(b, network.now)
        got["a"] += taken(a, network.now)
    assert (got["a"], got["b"]) == (sent, sent)
    assert (a.waiting, b.waiting) == (0, 0)


def what_was_not_taken_comes_again(seed: int, loss: float, count: int) -> None:
    network = Network(random.Random(seed), loss)
    network.join()
    a = network.ends["a"]
    sent = [f"{i}" for i in range(count)]
    first: list[str] = []
    for text in sent:
        send(a, text)
        network.move()
        if network.rng.random() < 0.3:
            first += taken(network.ends["b"], network.now)
    network.begin("b")
    network.join()
    assert a.restarts == 1
    second: list[str] = []
    for _ in range(5000):
        if not a.waiting:
            break
        network.move(0.05)
        second += taken(network.ends["b"], network.now)
    # Nothing is missing; what was taken but not yet acknowledged comes twice.
    assert sent[: len(first)] == first
    assert second == sent[count - len(second) :]
    assert len(first) + len(second) >= count


@SETTINGS
@given(st.integers(0, 2**32), st.floats(0.0, 0.5), st.integers(0, 60))
def test_what_is_sent_arrives_once_and_in_order(seed: int, loss: float, count: int) -> None:
    all_arrives(seed, loss, count)


@SETTINGS
@given(st.integers(0, 2**32), st.floats(0.0, 0.4), st.integers(1, 40))
def test_a_restarted_reader_gets_again_what_it_had_not_taken(
    seed: int, loss: float, count: int
) -> None:
    what_was_not_taken_comes_again(seed, loss, count)


@pytest.mark.parametrize("check", [all_arrives, what_was_not_taken_comes_again])
@SETTINGS
@given(seed=st.integers(0, 2**32), loss=st.floats(0.0, 0.4), count=st.integers(1, 60))
def test_both_hold_where_little_may_be_on_its_way(
    check: Callable[[int, float, int], None], seed: int, loss: float, count: int
) -> None:
    with pytest.MonkeyPatch.context() as patch:
        for name, value in {"LEAST": 100, "STEP": 40, "WINDOW_BYTES": 1000}.items():
            patch.setattr(outbox, name, value)  # a frame has 33 bytes or 34
        check(seed, loss, count)


def test_a_restarted_sender_begins_anew_and_stale_frames_are_ignored() -> None:
    network = Network(random.Random(1))
    network.join()
    b = network.ends["b"]
    send(network.ends["a"], "old")
    network.move()
    assert taken(b, network.now) == ["old"]
    stale = head_of(network.ends["a"].incarnation << frames.COUNT_BITS | 1, 0, 0, 1, 0, 0, 0)
    network.begin("a")
    network.join()
    late = read(stale, b"late")
    assert late is not None
    b.receive(late, network.now)
    send(network.ends["a"], "new")
    network.move()
    assert taken(b, network.now) == ["new"]
    assert b.restarts == 1


def test_a_full_window_is_told_and_drains() -> None:
    network = Network(random.Random(1))
    network.join()
    a, b = network.ends["a"], network.ends["b"]
    for i in range(WINDOW):
        assert not a.is_full
        send(a, f"{i}")
    assert a.is_full
    network.move()
    taken(b, network.now)
    network.move(0.05)
    network.move(0.05)
    assert not a.is_full


def test_bytes_fill_a_window_too(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(outbox, "WINDOW_BYTES", 10)
    network = Network(random.Random(1))
    network.join()
    send(network.ends["a"], "x" * 11)
    assert network.ends["a"].is_full


def test_another_graph_does_not_link() -> None:
    network = Network(random.Random(1))
    network.ends["b"].graph = b"h" * 16
    for _ in range(20):
        network.move(HELLO_EVERY)
    assert not network.ends["a"].joined
    assert network.ends["a"].refused == b"h" * 16


def test_a_closed_link_takes_and_sends_nothing() -> None:
    network = Network(random.Random(1))
    network.join()
    a = network.ends["a"]
    send(a, "x")
    a.close()
    send(a, "y")
    assert (a.waiting, a.is_full) == (0, False)


def test_who_has_left_wants_nothing_more() -> None:
    """Its last acknowledgement may be lost; what it says at the end counts as well."""
    network = Network(random.Random(5))
    network.join()
    a, b = network.ends["a"], network.ends["b"]
    send(a, "last")
    network.move()
    taken(b, network.now)
    assert a.owes == 1
    b.say_end(whole=True)
    network.move(0.0)
    assert (a.waiting, a.owes) == (1, 0)
    assert not a.gone


@pytest.mark.parametrize("whole", [True, False])
@pytest.mark.parametrize("owes", [True, False])
def test_who_leaves_with_things_unsaid_says_so(owes: bool, whole: bool) -> None:
    network = Network(random.Random(1))
    network.join()
    a, b = network.ends["a"], network.ends["b"]
    if owes:
        send(a, "unsaid")
    a.say_end(whole=whole)
    network.move()
    assert b.gone == (owes or not whole)
    assert b.departed == (whole and not owes)


def test_a_slow_reader_is_asked_and_nothing_is_sent_twice() -> None:
    network = Network(random.Random(1))
    network.join()
    a, b = network.ends["a"], network.ends["b"]
    for number in range(400):
        send(a, str(number))
    for _ in range(100):  # ten seconds in which it takes nothing
        network.move(0.1)
    assert a.sent_again == 0
    assert taken(b, network.now) == [str(number) for number in range(400)]


def test_all_that_a_cut_has_lost_is_sent_again_at_once() -> None:
    network = Network(random.Random(1))
    network.join()
    a, b = network.ends["a"], network.ends["b"]
    network.loss = 1.0
    for number in range(1000):
        send(a, str(number))
        network.move(0.001)
    network.loss = 0.0
    found: list[str] = []
    for _ in range(40):  # more than the longest wait, and a few ways there and back
        network.move(0.05)
        found += taken(b, network.now)
    assert found == [str(number) for number in range(1000)]
    assert 1000 <= a.sent_again < 2000  # this network doubles what it carries, now and then


def test_who_is_told_to_stop_says_so_and_still_takes_what_comes() -> None:
    network = Network(random.Random(1))
    network.join()
    a, b = network.ends["a"], network.ends["b"]
    b.say_stop()
    network.move()
    assert a.stops
    assert (b.stops, a.departed, a.gone) == (False, False, False)
    send(a, "late")
    network.move()
    assert taken(b, network.now) == ["late"]


@pytest.mark.parametrize(("one", "other"), [(2, 1), (5, 2**24 - 3)])
def test_incarnations_wrap(one: int, other: int) -> None:
    assert newer(one, other)
    assert not newer(other, one)
    assert not newer(one, one)


class Slow(Network):
    """One that keeps the order, carries little at a time, and drops what it has no room for."""

    ROOM = 12

    def move(self, seconds: float = 0.01) -> None:
        self.now += seconds
        for name, peer in (("a", "b"), ("b", "a")):
            queue = self.wires[name].queue
            while len(queue) > self.ROOM:
                queue.pop()
            if queue:
                frame = part(*queue.popleft())
                assert frame is not None
                self.deliver(peer, frame)
        for end in self.ends.values():
            end.ready = end.joined
            end.tend(self.now)


def test_on_a_slow_network_little_is_sent_twice() -> None:
    network = Slow(random.Random(1))
    network.join()
    a, b = network.ends["a"], network.ends["b"]
    for _ in range(200):
        network.move(HELLO_EVERY)  # until the last greetings are through
    sent = [f"{i}" for i in range(200)]
    waiting = deque(sent)
    found: list[str] = []
    moves = 0
    while len(found) < len(sent):
        while waiting and a.waiting < 3 * Slow.ROOM:
            send(a, waiting.popleft())
        network.move(0.2)
        found += taken(b, network.now)
        moves += 1
        assert moves < 5 * len(sent)
    assert found == sent
    assert a.sent_again > 0
    assert moves < 2 * len(sent)


class Narrow(Network):
    """One that carries so many bytes a second, and drops what it has no room for."""

    RATE, ROOM = 1_250_000, 4_000_000

    def __init__(self) -> None:
        super().__init__(random.Random(1))
        self.carried = 0.0
        self.dropped = 0

    def move(self, seconds: float = 0.01) -> None:
        self.now += seconds
        for name, peer in (("a", "b"), ("b", "a")):
            queue = self.wires[name].queue
            kept: deque[tuple[bytes, bytes | None]] = deque()
            room = self.ROOM
            for payload, attachment in queue:
                if len(payload) <= room:
                    kept.append((payload, attachment))
                    room -= len(payload)
                else:
                    self.dropped += 1
            self.wires[name].queue = kept
            budget = self.RATE * seconds + self.carried * (name == "a")
            while kept and len(kept[0][0]) <= budget:
                budget -= len(kept[0][0])
                frame = part(*kept.popleft())
                assert frame is not None
                self.deliver(peer, frame)
            if name == "a":
                self.carried = budget if kept else 0.0
        for end in self.ends.values():
            end.ready = end.joined
            end.tend(self.now)


def test_a_narrow_network_is_used_almost_as_well_as_it_can_be() -> None:
    network = Narrow()
    network.join()
    a, b = network.ends["a"], network.ends["b"]
    size, count = 250_000, 400
    left, found, began = count, 0, network.now
    while found < count:
        while left and not a.is_full:
            a.send(frames.flags_of(frames.DATA, 0, 0), 0, 0, 1, bytes(size))
            left -= 1
        network.move(0.01)
        found += len(taken(b, network.now))
    least = size * count / Narrow.RATE
    assert network.dropped > 0
    assert network.now - began < 1.15 * least
