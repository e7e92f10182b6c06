"""The window of a process: what is looked at is put, what is not costs nothing."""

from __future__ import annotations

import json
import time
from collections.abc import Mapping
from typing import Any

import pytest
from panes import RATE, TURNED, panes, rates, taken

import lodeflow as lf
from lodeflow.errors import RunError
from lodeflow.transport.session import open_session
from lodeflow.transport.viewing import StreamView
from lodeflow.transport.window import ROWS_BYTES


@pytest.mark.parametrize("form", ["samples", "blocks"])
def test_what_is_watched_comes_and_the_rest_is_not_encoded(form: str) -> None:
    with panes(form) as made:
        made.push(0, 10)
        assert (made.taps("source"), made.taps("turn")) == (0, 0)
        onlooker, view = made.onlooker(TURNED), StreamView(TURNED)
        made.until_taps("turn", 1)
        assert made.taps("source") == 0
        made.push(10, 20)
        blocks = [view.read(sighting) for sighting in taken(onlooker, view, 20)]
        assert lf.AngularRate.concat(blocks) == lf.AngularRate(
            rates(10, 20).t, -rates(10, 20).angular_rate
        )
        assert (view.missed, view.puts) == (0, 20 if form == "samples" else 1)
        onlooker.close()
        made.until_taps("turn", 0)
        made.push(30, 10)


def test_who_comes_later_has_missed_nothing() -> None:
    with panes() as made:
        made.onlooker(RATE)
        made.until_taps("source", 1)
        made.push(0, 7)
        late, view = made.onlooker(RATE), StreamView(RATE)
        until = time.monotonic() + 10
        count = 7
        while not view.rows and time.monotonic() < until:
            made.push(count, 1)
            count += 1
            for sighting in late.take(0.02):
                view.see(sighting)
        made.push(count, 5)
        before = view.rows
        taken(late, view, before + 5)
        assert view.rows >= before + 5
        assert view.missed == 0


def test_a_large_block_comes_in_pieces() -> None:
    with panes("blocks") as made:
        onlooker, view = made.onlooker(RATE), StreamView(RATE)
        made.until_taps("source", 1)
        made.push(0, 3000)
        sightings = taken(onlooker, view, 3000)
        assert view.puts > 1
        assert max(len(sighting.payload) for sighting in sightings) <= ROWS_BYTES
        assert lf.AngularRate.concat([view.read(s) for s in sightings]) == rates(0, 3000)


def test_the_end_is_told() -> None:
    with panes() as made:
        onlooker, view = made.onlooker(RATE), StreamView(RATE)
        made.until_taps("source", 1)
        made.push(0, 3)
        made.window.close()
        taken(onlooker, view, 4)
        assert view.ended
        assert view.rows == 3


def test_questions_are_answered_and_errors_told() -> None:
    def answer(asked: Mapping[str, Any]) -> Any:
        if asked["ask"] == "refuse":
            raise RunError("not now")
        return asked["x"] + 1

    with panes(answer=answer) as made:
        onlooker = made.onlooker()
        while not (found := onlooker.ask("add", timeout=5, x=1)):
            time.sleep(0.01)
        assert found == [("panes", "main", 2, "")]
        assert onlooker.ask("refuse", timeout=5)[0].error == "not now"
        assert "KeyError" in onlooker.ask("add", timeout=5)[0].error
        assert onlooker.ask("add", graph="other", timeout=5, x=1) == []


@pytest.mark.parametrize(
    "garbage", [b"", b"\xff\xfe", b"[]", b"3", b"null", b'{"ask": []}', b"[" * 100_000]
)
def test_garbage_on_the_control_key_is_refused(garbage: bytes) -> None:
    with panes(answer=lambda asked: {"a": asked["ask"].upper()}) as made:
        onlooker = made.onlooker()
        while not onlooker.ask("hear", timeout=5):
            time.sleep(0.01)
        stranger = open_session(connect=[made.endpoint])
        stranger.put("@lodeflow/panes/control/main", garbage)
        replies: list[Any] = []
        until = time.monotonic() + 10
        while not replies and time.monotonic() < until:
            replies = list(stranger.get("@lodeflow/panes/control/*", payload=garbage, timeout=5))
        stranger.close()  # type: ignore[no-untyped-call]
        assert "not understood" in json.loads(replies[0].ok.payload.to_bytes())["error"]
        assert onlooker.ask("hear", timeout=5)[0].told == {"a": "HEAR"}


def test_garbage_on_a_stream_is_counted_and_what_is_ours_comes() -> None:
    with panes() as made:
        stranger = open_session(listen=[made.endpoint + "2"])
        onlooker, view = made.onlooker(RATE, also=made.endpoint + "2"), StreamView(RATE)
        made.until_taps("source", 1)
        until = time.monotonic() + 10
        while view.foreign < 3 and time.monotonic() < until:
            stranger.put(RATE, b"garbage", attachment=b"x" * 32)
            stranger.put(RATE, b"garbage")
            stranger.put("lodeflow/panes/source/out", b"", encoding="?" * 200)
            for sighting in onlooker.take(0.05):
                view.see(sighting)
        stranger.close()  # type: ignore[no-untyped-call]
        made.push(0, 3)
        taken(onlooker, view, 3)
        assert view.foreign >= 3
        assert (view.rows, view.missed) == (3, 0)
