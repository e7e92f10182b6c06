"""What comes out of a link: samples or blocks, and what is missing after a sender began anew."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import lodeflow as lf
from lodeflow.graph import Wire
from lodeflow.messages.cdr import layout_of
from lodeflow.sync import END, NEVER
from lodeflow.transport import frame as frames
from lodeflow.transport.frame import Frame
from lodeflow.transport.inlet import FEW, Inlet
from lodeflow.transport.losses import Gap, LinkLosses

LAYOUT = layout_of(lf.Heading)
WIRE = Wire("compass", "out")


def frame(*stamps: int, bound: int | None = None, payload: bytes | None = None) -> Frame:
    t = np.array(stamps, dtype=np.int64)
    data = LAYOUT.encode_block(lf.Heading(t, t / 10.0)).tobytes() if payload is None else payload
    end = stamps[-1] + 1 if bound is None else bound
    first = stamps[0] if stamps else 0
    return Frame(0, first, end, len(stamps), frames.DATA, 0, 0, data)


@pytest.fixture
def told() -> list[Gap]:
    return []


@pytest.fixture
def inlet(told: list[Gap]) -> Inlet:
    return Inlet(WIRE, "there", "here", LAYOUT, LinkLosses(), told.append)


def opened(inlet: Inlet, one: Frame) -> list[tuple[list[int], int]]:
    """Return the stamps and the bound of each arrival, and look at the values."""
    found: list[tuple[list[int], int]] = []

    def enter(message: Any, bound: int) -> None:
        if message is None:
            found.append(([], bound))
            return
        block = message if message.is_block else message.as_block()
        assert (block.heading == block.t / 10.0).all()
        found.append((block.t.tolist(), bound))

    inlet.enter = enter
    inlet.bring(one.first, one.bound, one.rows, one.payload)
    return found


@pytest.mark.parametrize("rows", [1, 2, FEW, FEW + 1, 100])
def test_each_message_comes_with_the_bound_that_is_known_by_then(inlet: Inlet, rows: int) -> None:
    stamps = list(range(5, 5 + 3 * rows, 3))
    found = opened(inlet, frame(*stamps, bound=1000))
    if rows <= FEW:
        assert found == [([t], t + 1) for t in stamps[:-1]] + [([stamps[-1]], 1000)]
    else:
        assert found == [(stamps, 1000)]
    assert inlet.bound == 1000


def test_a_bound_alone_comes_if_it_is_news(inlet: Inlet) -> None:
    assert opened(inlet, frame(bound=7)) == [([], 7)]
    assert opened(inlet, frame(bound=7)) == []
    assert opened(inlet, frame(bound=END)) == [([], END)]


@pytest.mark.parametrize("more", [0, FEW])
def test_what_a_restarted_sender_repeats_is_left_out_and_the_gap_told(
    inlet: Inlet, told: list[Gap], more: int
) -> None:
    opened(inlet, frame(1, 2, 3, 4))
    inlet.restarted()
    later = list(range(10, 10 + more))
    found = opened(inlet, frame(3, 4, 7, *later))
    assert [t for stamps, _ in found for t in stamps] == [7, *later]
    assert inlet.losses.repeated == 2
    assert told == [Gap(WIRE, "here", "there", 5, 7)]
    assert opened(inlet, frame(50)) == [([50], 51)]
    assert len(told) == inlet.losses.gaps == 1


def test_a_sender_that_had_sent_nothing_leaves_no_gap(inlet: Inlet, told: list[Gap]) -> None:
    inlet.restarted()
    assert opened(inlet, frame(3)) == [([3], 4)]
    assert told == []


@pytest.mark.parametrize("rows", [1, 3, FEW + 3])
@pytest.mark.parametrize("cut", [-1, 4])
def test_a_frame_that_is_no_records_is_a_gap(
    inlet: Inlet, told: list[Gap], rows: int, cut: int
) -> None:
    stamps = list(range(10, 10 + rows))
    broken = frame(*stamps).payload[:cut] or b""
    assert opened(inlet, frame(*stamps, payload=broken)) == [([], 10 + rows)]
    assert inlet.losses.undecodable == 1
    assert told == [Gap(WIRE, "here", "there", 10, 10 + rows)]


@pytest.mark.parametrize("lost", [True, False])
def test_a_stream_ends_where_it_is(inlet: Inlet, told: list[Gap], lost: bool) -> None:
    opened(inlet, frame(1))
    came: list[tuple[Any, int]] = []
    inlet.enter = lambda message, bound: came.append((message, bound))
    inlet.end(lost=lost)
    assert came == [(None, END)]
    assert told == ([Gap(WIRE, "here", "there", 2, END)] if lost else [])
    inlet.end(lost=True)
    assert len(came) == 1
    assert NEVER < inlet.bound == END
