"""Alignment of columns: which rows the inputs of a node make, decided by stamps and bounds.

This is the block form of the rules; `samples.py` has the same rules for single messages, and the
property tests hold the two to the same bytes.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from lodeflow.messages.message import Message
from lodeflow.sync import END, NEVER, Each, Exact, Hold, Nearest, Sparse, Sync

Stamps = NDArray[np.int64]


class Column:
    """The messages of one input that are not used up yet, and how far its stream is known."""

    __slots__ = ("bound", "kind", "parts")

    def __init__(self, kind: type[Message]) -> None:
        self.kind = kind
        self.parts: list[Any] = []
        self.bound = NEVER

    def push(self, block: Any) -> None:
        """Append messages; their stamps imply a bound."""
        if self.parts and not len(self.parts[0].t):
            self.parts.clear()  # nothing is left: spare the copy
        self.parts.append(block)
        self.bound = max(self.bound, int(block.t[-1]) + 1)

    def block(self) -> Any:
        """Return all messages as one block."""
        if len(self.parts) != 1:
            self.parts = [self.kind.concat(self.parts)]
        return self.parts[0]

    def drop(self, count: int) -> None:
        """Forget the first messages."""
        if count:
            self.parts = [self.block()[count:]]

    def first_or_bound(self) -> int:
        """Return the stamp of the first message, or the bound where there is none."""
        t = self.block().t
        return int(t[0]) if len(t) else self.bound


class Rows(NamedTuple):
    """Aligned rows: stamps, and per wired input a block of as many rows (or Sparse)."""

    t: Stamps
    columns: tuple[Any, ...]

    def select(self, key: Any) -> Rows:
        """Return the rows that a slice or mask selects."""
        t = self.t[key]
        return Rows(t, tuple(_select(column, key, t) for column in self.columns))


def _select(column: Any, key: Any, t: Stamps) -> Any:
    if not isinstance(column, Sparse):
        return column[key]
    rows = column.rows[key]
    present = rows >= 0
    # Messages of rows that are left out must not be seen: the step gets only its own.
    values = column.values[rows[present]]
    return Sparse(values, np.where(present, np.cumsum(present) - 1, -1), t)


def join_rows(parts: list[Rows]) -> Rows:
    """Concatenate aligned rows."""
    if len(parts) == 1:
        return parts[0]
    t = np.concatenate([part.t for part in parts])
    columns = []
    for pieces in zip(*[part.columns for part in parts], strict=True):
        if not isinstance(pieces[0], Sparse):
            columns.append(type(pieces[0]).concat(pieces))
            continue
        offsets = np.cumsum([0, *[len(piece.values) for piece in pieces[:-1]]])
        rows = [
            np.where(piece.rows >= 0, piece.rows + offset, -1)
            for piece, offset in zip(pieces, offsets, strict=True)
        ]
        values = type(pieces[0].values).concat([piece.values for piece in pieces])
        columns.append(Sparse(values, np.concatenate(rows), t))
    return Rows(t, tuple(columns))


class Aligner:
    """Takes rows as far as the bounds decide them.

    Attributes:
        inputs: one column per wired input, in the order of the step's arguments.
        unmatched: lead rows that found no partner.
        floor: no later row has a stamp below this; END when there is none to come.
    """

    def __init__(self, inputs: list[Column]) -> None:
        self.inputs = inputs
        self.unmatched = 0
        self.floor = NEVER

    def take(self) -> Rows:
        """Return the rows decided now, and move `floor`."""
        (column,) = self.inputs
        block = column.block()
        column.parts = []
        self.floor = column.bound
        return Rows(block.t, (block,))


class _Led(Aligner):
    """Rows and stamps come from one input."""

    def __init__(self, inputs: list[Column], lead: int) -> None:
        super().__init__(inputs)
        self.lead = inputs[lead]
        self.others = [column for i, column in enumerate(inputs) if i != lead]

    def _decided(self, t: Stamps) -> int:
        """Return how many of the lead's rows are decided."""
        raise NotImplementedError

    def _partners(self, column: Column, t: Stamps) -> tuple[NDArray[np.intp], NDArray[np.bool_]]:
        """Return for each row the index into the column's block, and whether it has a partner."""
        raise NotImplementedError

    def _used(self, column: Column) -> int:
        """Return how many messages no row from `floor` on can use."""
        raise NotImplementedError

    def _values(self, column: Column) -> Any:
        return column.block()

    def take(self) -> Rows:
        block = self.lead.block()
        count = self._decided(block.t) if len(block.t) else 0
        t = block.t[:count]
        found = {id(column): self._partners(column, t) for column in self.others}
        matched = np.ones(count, dtype=bool)
        for _, has in found.values():
            matched &= has
        complete = bool(matched.all())
        columns = []
        for column in self.inputs:
            if column is self.lead:
                columns.append(block[:count] if complete else block[:count][matched])
            else:
                index = found[id(column)][0]
                index = index if complete else index[matched]
                columns.append(_gather(self._values(column), index))
        self.unmatched += count - int(matched.sum())
        self.lead.drop(count)
        self.floor = self.lead.first_or_bound()
        for column in self.others:
            column.drop(self._used(column))
        return Rows(t if complete else t[matched], tuple(columns))


def _gather(values: Any, index: NDArray[np.intp]) -> Any:
    """Return the rows at `index`; a slice where they are consecutive, which copies nothing."""
    if not len(index):
        return values[:0]
    first, last = int(index[0]), int(index[-1])
    if last - first == len(index) - 1 and (np.diff(index) == 1).all():
        return values[first : last + 1]
    return values[index]


class ExactAligner(_Led):
    """Stamps that all inputs share."""

    def __init__(self, inputs: list[Column]) -> None:
        super().__init__(inputs, 0)

    def take(self) -> Rows:
        rows = super().take()
        if any(c.bound == END and not len(c.block().t) for c in self.inputs):
            self.floor = END
        return rows

    def _decided(self, t: Stamps) -> int:
        return int(np.searchsorted(t, min(c.bound for c in self.others)))

    def _partners(self, column: Column, t: Stamps) -> tuple[NDArray[np.intp], NDArray[np.bool_]]:
        other = column.block().t
        index = np.searchsorted(other, t)
        has = index < len(other)
        has[has] = other[index[has]] == t[has]
        return index, has

    def _used(self, column: Column) -> int:
        return int(np.searchsorted(column.block().t, self.floor))


class NearestAligner(_Led):
    """The nearest message of every other input, within a distance."""

    def __init__(self, inputs: list[Column], lead: int, within: int) -> None:
        super().__init__(inputs, lead)
        self.within = within

    def _best(self, column: Column, t: Stamps) -> tuple[NDArray[np.intp], Stamps]:
        """Return index and distance of the nearest message; within + 1 where none is near."""
        other = column.block().t
        far = self.within + 1
        if not len(other):
            return np.zeros(len(t), dtype=np.intp), np.full(len(t), far)
        after = np.searchsorted(other, t, side="right")
        before = np.maximum(after - 1, 0)
        after = np.minimum(after, len(other) - 1)
        d_before, d_after = np.abs(t - other[before]), np.abs(other[after] - t)
        index = np.where(d_before <= d_after, before, after)
        return index, np.minimum(np.minimum(d_before, d_after), far)

    def _decided(self, t: Stamps) -> int:
        # t + distance never falls from one row to the next, so the decided rows are the first.
        return min(
            int(np.searchsorted(t + self._best(c, t)[1], c.bound, side="right"))
            for c in self.others
        )

    def _partners(self, column: Column, t: Stamps) -> tuple[NDArray[np.intp], NDArray[np.bool_]]:
        index, distance = self._best(column, t)
        return index, distance <= self.within

    def _used(self, column: Column) -> int:
        return max(int(np.searchsorted(column.block().t, self.floor, side="right")) - 1, 0)


class HoldAligner(_Led):
    """The last value of every other input at, or strictly before, the lead's stamp."""

    def __init__(
        self, inputs: list[Column], lead: int, initial: list[Message | None], delay: bool
    ) -> None:
        super().__init__(inputs, lead)
        self.delay = delay
        first = [message for i, message in enumerate(initial) if i != lead]
        self.before = {
            id(column): None if message is None else message.as_block()
            for column, message in zip(self.others, first, strict=True)
        }

    def _decided(self, t: Stamps) -> int:
        least = min(c.bound for c in self.others)
        return int(np.searchsorted(t, least, side="right" if self.delay else "left"))

    def _partners(self, column: Column, t: Stamps) -> tuple[NDArray[np.intp], NDArray[np.bool_]]:
        side = "left" if self.delay else "right"
        index = np.searchsorted(column.block().t, t, side=side)  # type: ignore[call-overload]
        if self.before[id(column)] is not None:
            return index, np.ones(len(t), dtype=bool)
        return index - 1, index > 0

    def _values(self, column: Column) -> Any:
        before = self.before[id(column)]
        return column.block() if before is None else column.kind.concat([before, column.block()])

    def _used(self, column: Column) -> int:
        side = "left" if self.delay else "right"
        index = np.searchsorted(column.block().t, self.floor, side=side)  # type: ignore[call-overload]
        used = max(int(index) - 1, 0)
        if int(index) and self.before[id(column)] is not None:
            self.before[id(column)] = column.block()[used : used + 1]
            return used + 1
        return used


def _union(stamps: list[Stamps]) -> Stamps:
    """Return the distinct stamps in order; sorting is spared where all are the same."""
    first, *others = stamps
    if all(np.array_equal(first, other) for other in others):
        return first
    return np.unique(np.concatenate(stamps))


class EachAligner(Aligner):
    """Every distinct stamp of any input."""

    def take(self) -> Rows:
        self.floor = min(column.bound for column in self.inputs)
        counts = [int(np.searchsorted(c.block().t, self.floor)) for c in self.inputs]
        blocks = [c.block()[:n] for c, n in zip(self.inputs, counts, strict=True)]
        t = _union([block.t for block in blocks])
        columns = []
        for column, count, block in zip(self.inputs, counts, blocks, strict=True):
            rows = np.arange(count)
            if count < len(t):
                places = np.searchsorted(t, block.t)
                rows = np.full(len(t), -1, dtype=np.int64)
                rows[places] = np.arange(count)
            columns.append(Sparse(block, rows, t))
            column.drop(count)
        return Rows(t, tuple(columns))


class GateColumn(Column):
    """The stream that opens and closes a gate."""

    __slots__ = ("allowed", "field")

    def __init__(self, kind: type[Message], field: str, allowed: frozenset[int]) -> None:
        super().__init__(kind)
        self.field = field
        self.allowed = np.array(sorted(allowed), dtype=np.int64)

    def is_open(self, t: Stamps) -> NDArray[np.bool_]:
        """Return for each row whether the last value at its stamp lets it pass."""
        block = self.block()
        index = np.searchsorted(block.t, t, side="right")
        passes = np.concatenate([[False], np.isin(getattr(block, self.field), self.allowed)])
        opened: NDArray[np.bool_] = passes[index]
        return opened

    def forget(self, floor: int) -> None:
        """Drop what no row from `floor` on needs."""
        self.drop(max(int(np.searchsorted(self.block().t, floor, side="right")) - 1, 0))


def make_aligner(sync: Sync | None, inputs: list[Column], names: list[str], lead: str) -> Aligner:
    """Return the aligner of a sync over the wired inputs."""
    match sync:
        case Exact():
            return ExactAligner(inputs)
        case Nearest(_, within):
            return NearestAligner(inputs, names.index(lead), within)
        case Hold():
            initial = [sync.first(name) for name in names]
            return HoldAligner(inputs, names.index(lead), initial, sync.delay)
        case Each():
            return EachAligner(inputs)
        case None:
            return Aligner(inputs)
