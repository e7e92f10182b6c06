"""What `lodeflow hz` makes of the puts that came."""

from __future__ import annotations

import pytest

from lodeflow.cli.hz_command import pulse
from lodeflow.transport import frame as frames
from lodeflow.transport.onlooker import Sighting


def puts(*came: tuple[float, int, int, int]) -> list[Sighting]:
    """Return puts from (time of arrival, first stamp, last stamp, rows)."""
    return [
        Sighting("k", at, "", b"", frames.read(frames.head_of(n, t, last + 1, rows, 0, 0, 0), b""))
        for n, (at, t, last, rows) in enumerate(came)
    ]


def test_samples() -> None:
    found = pulse(puts(*[(i / 10, i * 10**8, i * 10**8, 1) for i in range(11)]), 0, 0)
    assert found.messages == 11
    assert found.rate == pytest.approx(10)
    assert found.stamp_rate == pytest.approx(10)
    assert found.jitter == pytest.approx(0, abs=1e-9)
    assert found.longest == pytest.approx(0.1)


def test_blocks_count_their_rows() -> None:
    found = pulse(puts((0.0, 0, 99, 100), (1.0, 100, 199, 100), (3.0, 200, 299, 100)), 0, 0)
    assert found.messages == 300
    assert found.rate == pytest.approx(200 / 3)
    assert found.stamp_rate == pytest.approx(1e9)
    assert found.jitter == pytest.approx(0.5)
    assert found.longest == 2.0


def test_too_few_to_tell() -> None:
    assert pulse([], 0, 2).__dict__ == {
        "messages": 0,
        "rate": None,
        "stamp_rate": None,
        "jitter": None,
        "longest": None,
        "missed": 0,
        "foreign": 2,
    }
    assert pulse(puts((0.0, 5, 5, 1)), 0, 0).rate is None


def test_a_rate_by_stamps_is_not_told_where_some_were_missed() -> None:
    found = pulse(puts((0.0, 0, 0, 1), (1.0, 10**9, 10**9, 1)), 3, 0)
    assert (found.missed, found.stamp_rate) == (3, None)
