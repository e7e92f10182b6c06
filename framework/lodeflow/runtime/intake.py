"""Intake: what a source yields, checked. Only here is a sample refused, and counted."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from lodeflow.graph.model import Loss
from lodeflow.messages.cdr import FIRST_STAMP, LAST_STAMP
from lodeflow.messages.message import Message
from lodeflow.node import Source
from lodeflow.runtime.plan import PlanNode, check_output
from lodeflow.sync import END, NEVER, Bound


def max_delay(node: PlanNode) -> int | None:
    """Return how late a live source's samples may come; None for data at rest."""
    delay: int | None = getattr(node.plugin, "max_delay", None)
    return delay


class Fed(Source):
    """Base of sources whose messages were in a graph before: they enter as they are.

    A node may send NaN, which no source may; replay can feed the streams of either.
    """


class Lost(NamedTuple):
    """What a source of the framework yields to say that messages did not come."""

    why: Loss
    messages: int


class Batch(NamedTuple):
    """What may enter the graph: messages as (port index, message), then a bound on all ports.

    They are blocks; of a live source samples too, which it usually has.
    """

    messages: list[tuple[int, Any]]
    bound: int


class Intake:
    """Checks what one source yields: types, finite values, order of stamps."""

    def __init__(self, node: PlanNode) -> None:
        self.node = node
        self.source: Any = node.plugin
        self.ports = node.spec.outputs
        self.live = max_delay(node) is not None
        self.fed = isinstance(node.plugin, Fed)
        self.floor = NEVER
        self.last = [NEVER] * len(self.ports)

    def take(self, item: Any) -> Batch:
        """Return the part of a yielded item that may enter, and count the rest."""
        if isinstance(item, Lost):
            self.node.counters.lose(item.why, item.messages)
            return Batch([], self.floor)
        if isinstance(item, Bound):
            if not isinstance(item.t, (int, np.integer)):
                raise self.node.broken(self._names(), f"it must yield Bound(int), got {item!r}")
            self.floor = min(max(self.floor, int(item.t)), END)
            return Batch([], self.floor)
        messages = item if self.node.spec.step_tuple else (item,)
        if not isinstance(messages, tuple) or len(messages) != len(self.ports):
            raise self.node.broken(
                self._names(), f"it must yield these ports or a Bound, got {item!r}"
            )
        given = [(index, message) for index, message in enumerate(messages) if message is not None]
        for index, message in given:
            check_output(self.node, self.ports[index], message)
            self._check_stamps(index, message.t)
        blocks = []
        reached = self.floor
        for index, message in given:
            if self.live and not message.is_block and self._is_clean(index, message):
                blocks.append((index, message))
                self.last[index] = message.t
                continue
            block = self._clean(index, message if message.is_block else message.as_block())
            if len(block):
                blocks.append((index, block))
                self.last[index] = int(block.t[-1])
                reached = max(reached, self.last[index] + 1)
        if not self.live:
            self.floor = reached
        return Batch(blocks, self.floor)

    def _names(self) -> str:
        return ", ".join(port.name for port in self.ports)

    def _check_stamps(self, index: int, t: Any) -> None:
        first, last = (t, t) if isinstance(t, int) else (t.min(initial=0), t.max(initial=0))
        if first < FIRST_STAMP or last > LAST_STAMP:
            raise self.node.broken(
                self.ports[index].name,
                f"stamp {first if first < FIRST_STAMP else last} is outside the range of ROS time "
                "(1901 to 2038, nanoseconds since 1970)",
            )

    def _is_clean(self, index: int, sample: Any) -> bool:
        """Whether a live sample may enter as it is; if unsure, False."""
        if sample.t < self.floor or sample.t <= self.last[index]:
            return False
        if not self.fed:
            for field, value in zip(sample.fields, sample.values(), strict=True):
                if field.integer or field.gaps:
                    continue
                if not (np.isfinite(value).all() if field.shape else math.isfinite(value)):
                    return False
        return True

    def _clean(self, index: int, block: Any) -> Any:
        finite = None if self.fed else finite_rows(block)
        if finite is not None:
            self.node.counters.lose("nonfinite", int(len(block) - finite.sum()))
            block = block[finite]
        if self.live and (late := block.t < self.floor).any():
            self.node.counters.lose("late", int(late.sum()))
            block = block[~late]
        t = block.t
        if not len(t):
            return block
        before = max(self.last[index], NEVER if self.live else self.floor - 1)
        if t[0] > before and (t[1:] > t[:-1]).all():
            return block
        highest = np.maximum.accumulate(np.concatenate([[before], t[:-1]]))
        onward = t > highest
        self.node.counters.lose("disorder", int(len(t) - onward.sum()))
        return block[onward]


def finite_rows(block: Message) -> NDArray[np.bool_] | None:
    """Return which rows of a block are finite where they must be; None if all are."""
    rows: NDArray[np.bool_] | None = None
    for field, column in zip(block.fields, block.values(), strict=True):
        if field.integer or field.gaps:
            continue
        finite = np.isfinite(column)
        if not finite.all():
            finite = finite.reshape(len(finite), -1).all(axis=1)
            rows = finite if rows is None else rows & finite
    return rows
