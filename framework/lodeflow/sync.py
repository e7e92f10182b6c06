"""Sync: how the inputs of a node meet. Declared by the node class, never implied.

All decisions depend on stamps and bounds alone, never on the order of arrival. A *bound* is the
promise that no later message on a port has a stamp below it; a message at t implies t + 1.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

from lodeflow.messages.message import Message

M = TypeVar("M", bound=Message)

NEVER = -(2**63)
"""The bound of a port that has promised nothing yet."""
END = 2**63 - 1
"""The bound of a stream that has ended."""


@dataclass(frozen=True, slots=True)
class Bound:
    """What a source yields to say that nothing with a stamp below `t` will come."""

    t: int


@dataclass(frozen=True)
class Exact:
    """Rows are the stamps that all inputs share; the first input leads."""


@dataclass(frozen=True)
class Nearest:
    """Each message of `lead` meets the nearest message of every other input.

    Attributes:
        lead: the input that gives rows and stamps.
        within: largest distance, in nanoseconds (see `seconds`). On a tie the earlier wins; one
            message may serve several rows.
    """

    lead: str
    within: int


@dataclass(frozen=True)
class Hold:
    """Each message of `lead` meets the last value of every other input at or before its stamp.

    Attributes:
        lead: the input that gives rows and stamps.
        initial: messages that serve before the first one, by input.
        delay: take the last value strictly before the lead's stamp. This is what closes a cycle
            of nodes; each held input then needs an initial message.
    """

    lead: str
    initial: Mapping[str, Message] | None = None
    delay: bool = False

    def first(self, port: str) -> Message | None:
        """Return the message that serves `port` before its first one."""
        return (self.initial or {}).get(port)


@dataclass(frozen=True)
class Each:
    """One step per distinct stamp, with each input that has a message there, and None."""


Sync = Exact | Nearest | Hold | Each


class Sparse(Generic[M]):
    """An input of a block step under `Each`: its messages, and at which rows they stand.

    Attributes:
        values: block of the M messages present.
        rows: (N,) int64, for each row the index into `values`, or -1 where there is none.
        t: (N,) int64, stamps of the rows.
    """

    __slots__ = ("rows", "t", "values")

    def __init__(self, values: M, rows: NDArray[np.int64], t: NDArray[np.int64]) -> None:
        self.values = values
        self.rows = rows
        self.t = t

    def row(self, index: int) -> M | None:
        """Return the sample at a row, or None."""
        at = int(self.rows[index])
        return None if at < 0 else self.values.row(at)


def describe(sync: Any) -> str:
    """Return a sync in a few words, for documentation."""
    match sync:
        case Exact():
            return "equal stamps"
        case Nearest(lead, within):
            return f"nearest to each {lead} within {within / 1e6:g} ms"
        case Hold(lead, _, delay):
            return f"last value {'before' if delay else 'at or before'} each {lead}"
        case Each():
            return "every stamp"
        case _:
            return "one input"
