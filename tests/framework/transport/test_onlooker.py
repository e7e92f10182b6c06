"""The onlooker: bounded, and no harm to anybody when it is slow."""

from __future__ import annotations

import itertools
import threading
from typing import Any

import pytest
from panes import RATE, TURNED, panes, taken

from lodeflow.errors import RunError
from lodeflow.transport import onlooker as module
from lodeflow.transport.onlooker import Onlooker
from lodeflow.transport.viewing import StreamView


def test_who_does_not_take_misses_the_oldest(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "KEPT", 10)
    with panes() as made:
        slow, view = made.onlooker(RATE), StreamView(RATE)
        quick, seen = made.onlooker(RATE), StreamView(RATE)
        made.until_taps("source", 1)
        numbers = itertools.count()
        while not (view.rows and seen.rows):
            made.push(next(numbers), 1)
            taken(slow, view, 1, seconds=0.05)
            taken(quick, seen, 1, seconds=0.05)
        for _ in range(100):
            made.push(next(numbers), 1)
            taken(quick, seen, seen.rows + 1)
        left = slow.take(1.0)
        late = slow.take(0.2)  # the last may still have been on its way
        for sighting in [*left, *late]:
            view.see(sighting)
        assert seen.missed == 0
        assert len(left) == 10
        assert view.missed + len(left) + len(late) >= 100


def test_no_thread_is_left_behind() -> None:
    with panes() as made:
        onlooker = made.onlooker(RATE, TURNED)
        assert [t for t in threading.enumerate() if t.name.startswith("watch")]
        onlooker.close()
        assert not [t for t in threading.enumerate() if t.name.startswith("watch")]


@pytest.mark.parametrize("key", ["/a", "a//b", "a/", "a#b", "a/**/**"])
def test_a_key_that_is_none_is_refused(key: str) -> None:
    with panes() as made, pytest.raises(RunError, match="no key expression"):
        made.onlooker(key)


def test_an_endpoint_that_is_none_is_refused() -> None:
    with pytest.raises(RunError, match="cannot open Zenoh on nonsense"):
        Onlooker(["nonsense"])


def test_nobody_there_answers_nothing() -> None:
    onlooker = Onlooker(["unixsock-stream//tmp/there-is-nobody-here"])
    found: list[Any] = onlooker.ask("about", timeout=0.2)
    onlooker.close()
    assert found == []
