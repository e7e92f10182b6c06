"""What goes into the links of a stream, and what a reader misses that only watches."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import lodeflow as lf
from lodeflow.graph import Wire
from lodeflow.messages.cdr import layout_of
from lodeflow.sync import END
from lodeflow.transport import outlet as outlet_module
from lodeflow.transport.losses import LinkLosses
from lodeflow.transport.outlet import Outlet


class Reader(SimpleNamespace):
    """Stands for a link: keeps what it is sent."""

    def __init__(self, *, latest: bool, window: int) -> None:
        super().__init__(latest=latest, closed=False, window=window, sent=[])

    __hash__ = object.__hash__

    @property
    def is_full(self) -> bool:
        return len(self.sent) >= self.window

    def send(self, flags: int, first: int, bound: int, count: int, data: bytes) -> None:
        self.sent.append((first, bound, count, len(data)))


def outlet_to(*readers: Any) -> Outlet:
    return Outlet(
        3, Wire("a", "out"), layout_of(lf.AngularRate), {link: LinkLosses() for link in readers}
    )


def rates(*stamps: int) -> lf.AngularRate:
    return lf.AngularRate(np.array(stamps, np.int64), np.zeros((len(stamps), 3)))


def test_samples_that_wait_go_as_one_frame() -> None:
    reader = Reader(latest=False, window=99)
    outlet = outlet_to(reader)
    block = rates(1, 2, 5)
    outlet.queue.extend([block[0], block[1], block[2]])
    outlet.send(9)
    outlet.queue.append(rates(12)[0])
    outlet.send(9)
    outlet.send(13)
    outlet.send(20)
    assert [sent[:3] for sent in reader.sent] == [(1, 9, 3), (12, 13, 1), (0, 20, 0)]


def test_a_long_block_goes_in_pieces_that_are_alike(monkeypatch: pytest.MonkeyPatch) -> None:
    reader = Reader(latest=False, window=99)
    outlet = outlet_to(reader)
    monkeypatch.setattr(outlet_module, "FRAME_BYTES", 2 * outlet.layout.size)
    outlet.queue.append(rates(1, 2, 5, 7, 9))
    outlet.send(50)
    assert [sent[:3] for sent in reader.sent] == [(1, 6, 3), (7, 50, 2)]
    outlet.queue.append(rates(51, 52, 53))  # hardly too long
    outlet.queue.append(rates(61, 62, 63, 64, 65, 66, 67))
    outlet.send(90)
    assert [sent[2] for sent in reader.sent[2:]] == [2, 1, 2, 2, 2, 1]


def test_who_only_watches_misses_what_it_is_too_slow_for_but_not_the_end() -> None:
    watching, reading = Reader(latest=True, window=2), Reader(latest=False, window=2)
    outlet = outlet_to(watching, reading)
    for t in range(1, 6):
        outlet.queue.append(rates(10 * t, 10 * t + 1))
        outlet.send(10 * t + 5)
    outlet.queue.append(rates(90))
    outlet.send(END)
    assert [sent[0] for sent in reading.sent] == [10, 20, 30, 40, 50, 90]
    assert [sent[:3] for sent in watching.sent] == [(10, 15, 2), (20, 25, 2), (0, END, 0)]
    assert outlet.readers[watching] == LinkLosses(missed=7)
    assert outlet.readers[watching].is_lossless
    assert outlet.readers[reading] == LinkLosses()


def test_a_bound_alone_is_not_kept_for_who_is_behind() -> None:
    watching = Reader(latest=True, window=0)
    outlet = outlet_to(watching)
    outlet.send(5)
    assert watching.sent == []
    outlet.send(END)
    assert [sent[:3] for sent in watching.sent] == [(0, END, 0)]
