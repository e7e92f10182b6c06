"""What is kept until it is taken, how much is on its way, and what goes again."""

from __future__ import annotations

import random
from collections import deque
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lodeflow.transport import outbox as module
from lodeflow.transport.outbox import Outbox

SETTINGS = settings(max_examples=100, deadline=None, derandomize=True, database=None)


class Wire:
    """Stands for a publisher: keeps what is put."""

    def __init__(self) -> None:
        self.put_there: list[bytes] = []

    def put(self, payload: bytes, attachment: bytes | None) -> None:
        self.put_there.append(payload)


def outbox_and_wire(monkeypatch: pytest.MonkeyPatch) -> tuple[Outbox, list[bytes]]:
    """Return an outbox that may have 10 bytes on their way at first, and 100 at most."""
    for name, value in {"WINDOW_BYTES": 100, "LEAST": 10, "STEP": 1}.items():
        monkeypatch.setattr(module, name, value)
    wire: Any = Wire()
    return Outbox(wire, latest=False), wire.put_there


def drained(box: Outbox) -> list[int]:
    """Return how many frames are on their way, time after time, until all are taken."""
    found = []
    while len(box):
        found.append(box.sent - box.base)
        box.taken(box.sent)
    return found


def test_what_gets_through_lets_more_be_put(monkeypatch: pytest.MonkeyPatch) -> None:
    box, wire = outbox_and_wire(monkeypatch)
    for number in range(20):
        box.add(b"%05d" % number, None, 1)
    assert (box.next, box.sent, box.base, len(box)) == (20, 2, 0, 20)
    assert box.is_full
    assert box.taken(1)
    assert not box.taken(1)  # it has said so before
    assert not box.taken(21)  # more than there is
    assert (box.sent, box.base, len(box), box.is_full) == (4, 1, 19, False)
    assert drained(box) == [3, 6, 10]
    assert wire == [b"%05d" % number for number in range(20)]
    box.add(b"again", None, 1)
    assert (box.sent, box.sent_again) == (21, 0)


def wide(box: Outbox) -> None:
    """Let all that a window holds be on its way."""
    for _ in range(20):
        box.add(b"x" * 5, None, 1)
    drained(box)


def test_after_a_loss_little_is_put_at_first_and_soon_more(monkeypatch: pytest.MonkeyPatch) -> None:
    box, wire = outbox_and_wire(monkeypatch)
    wide(box)
    for number in range(60):
        box.add(b"%02d" % number, None, 1)
    box.taken(44)
    wire.clear()
    box.again(44)  # 48 bytes were ahead of it when it was put, and too much: 36 may get through
    assert box.sent_again == 36
    assert drained(box) == [5, 10, 20, 1]  # doubled, up to what was all
    assert wire == [b"%02d" % number for number in range(24, 60)]


def test_what_was_cut_off_had_not_been_too_much(monkeypatch: pytest.MonkeyPatch) -> None:
    box, _ = outbox_and_wire(monkeypatch)
    wide(box)
    for _ in range(15):
        box.add(b"x" * 5, None, 1)
    box.again(20)
    assert box.sent_again == 15
    assert drained(box) == [2, 4, 8, 1]


def test_near_to_what_was_too_much_a_little_more_is_put_each_time(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    box, _ = outbox_and_wire(monkeypatch)
    wide(box)
    for _ in range(16):
        box.add(b"x", None, 1)
    box.taken(35)
    box.again(35)  # 15 were ahead: from 11 on it may be too much again
    underway = []
    for _ in range(5):
        while not box.is_full:
            box.add(b"x", None, 1)
        underway.append(box.sent - box.base)
        box.taken(box.sent)
    assert underway == [10, 20, 21, 22, 23]


def test_what_has_arrived_and_is_not_taken_holds_back_what_goes_again(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    box, wire = outbox_and_wire(monkeypatch)
    wide(box)
    for _ in range(20):
        box.add(b"x" * 5, None, 1)
    wire.clear()
    box.again(32)
    assert (len(wire), box.sent, len(box)) == (0, 32, 20)
    box.taken(32)
    assert (len(wire), box.sent, len(box)) == (8, 40, 8)


def test_who_asks_for_what_was_never_put_changes_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    box, wire = outbox_and_wire(monkeypatch)
    box.add(b"x", None, 1)
    box.again(1)
    box.again(5)
    assert (wire, box.sent_again) == ([b"x"], 0)


@SETTINGS
@given(seed=st.integers(0, 2**32), sizes=st.lists(st.integers(0, 40), max_size=60))
def test_what_is_on_its_way_is_a_run_of_what_is_kept(seed: int, sizes: list[int]) -> None:
    rng = random.Random(seed)
    with pytest.MonkeyPatch.context() as patch:
        box, _ = outbox_and_wire(patch)
        waiting = deque(sizes)
        taken = 0
        for _ in range(10_000):
            match rng.choice("aatr"):
                case "a" if waiting:
                    box.add(bytes(waiting.popleft()), None, 1)
                case "t" if box.sent > taken:
                    taken = rng.randint(taken, box.sent)
                    box.taken(taken)
                case "r":
                    box.again(rng.randint(taken, box.next))
            assert taken == box.base <= box.sent <= box.next
            on_their_way = sum(sizes[box.base : box.sent])
            assert box._underway == on_their_way
            assert box._bytes == sum(sizes[box.base : box.next])
            # Something always is: who waits for room waits for an answer.
            assert box.sent == box.next or on_their_way >= box._allowed >= 10
            if not waiting and taken == len(sizes):
                return
        raise AssertionError("it never ended")
