"""Gaps: stretches of a stream that did not reach a reader in a recorded run."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any


def without(take: Callable[[Any], None], spans: Sequence[tuple[int, int]]) -> Callable[[Any], None]:
    """Return what takes only the messages outside of some spans of stamps, [begin, end)."""

    def outside(message: Any) -> None:
        t = message.t
        if type(t) is int:
            if not any(begin <= t < end for begin, end in spans):
                take(message)
            return
        kept = t == t
        for begin, end in spans:
            kept &= (t < begin) | (t >= end)
        if kept.all():
            take(message)
        elif kept.any():
            take(message[kept])

    return outside
