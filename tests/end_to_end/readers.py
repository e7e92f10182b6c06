"""Recordings as other people's packages read them."""

from __future__ import annotations

from pathlib import Path

from mcap.reader import make_reader


def records(path: Path) -> dict[str, list[tuple[int, bytes]]]:
    """Return (log time, payload) of every topic, by the mcap package."""
    found: dict[str, list[tuple[int, bytes]]] = {}
    with path.open("rb") as file:
        for _, channel, message in make_reader(file, validate_crcs=True).iter_messages():
            found.setdefault(channel.topic, []).append((message.log_time, message.data))
            assert message.log_time == message.publish_time
    return found
