"""Two streams of one topic side by side: who is whose partner, and how far partners are apart."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lodeflow.errors import MessageError
from lodeflow.messages.cdr import TEXT_AT, StreamConstants, layout_of, read_constants
from lodeflow.messages.message import Message
from lodeflow.recording.columns import components
from lodeflow.recording.comparison import Difference, Largest, StreamComparison
from lodeflow.recording.mcap.raw import Rows
from lodeflow.recording.stream import StreamDecoder
from lodeflow.sync import NEVER


class NotIncreasingError(Exception):
    """Log times repeat or go back, so that stamps do not tell who is whose partner."""


class Pairing:
    """Takes the blocks of two streams as they come, and compares what has met its partner.

    Args:
        result: where to write what is found.
        kind: type of the messages, None to compare bytes only.
        tolerances: by field; a field without one must be equal to the bit.
        by_number: pair the messages by number and not by stamp.
    """

    def __init__(
        self,
        result: StreamComparison,
        kind: type[Message] | None,
        tolerances: Mapping[str, float],
        *,
        by_number: bool = False,
    ) -> None:
        self.result = result
        self.kind = kind
        self.tolerances = tolerances
        self.by_number = by_number
        self._waiting: list[Rows | None] = [None, None]
        self._last = [NEVER, NEVER]
        self._ended = [False, False]
        self._taken = [0, 0]
        result.paired = "number" if by_number else "stamp"

    def held(self, side: int) -> int:
        """Return the bytes that wait for a partner."""
        waiting = self._waiting[side]
        return 0 if waiting is None else len(waiting.data) + 24 * len(waiting.t)

    def wants(self, side: int) -> bool:
        """Whether rows of a side may still find partners; else `skip` them."""
        other = 1 - side
        return not self._ended[other] or self._waiting[other] is not None

    def put(self, side: int, rows: Rows) -> None:
        """Take the next rows of a side.

        Raises:
            NotIncreasingError: their log times do not increase.
        """
        if not self.by_number:
            if rows.t[0] <= self._last[side] or (rows.t[1:] <= rows.t[:-1]).any():
                raise NotIncreasingError
            self._last[side] = int(rows.t[-1])
        waiting = self._waiting[side]
        self._waiting[side] = rows if waiting is None else Rows.join([waiting, rows])
        self._settle()

    def skip(self, side: int, t: NDArray[Any]) -> None:
        """Count rows that can have no partner."""
        self._lonely(side, t, np.arange(len(t)))
        self._taken[side] += len(t)

    def end(self, side: int) -> None:
        """Say that a side has no more rows."""
        self._ended[side] = True
        self._settle()

    def _settle(self) -> None:
        a, b = self._waiting
        if a is not None and b is not None:
            if self.by_number:
                cuts = [min(len(a.t), len(b.t))] * 2
            else:
                reached = min(a.t[-1], b.t[-1])
                cuts = [int(np.searchsorted(rows.t, reached, side="right")) for rows in (a, b)]
            self._pair(a.cut(0, cuts[0]), b.cut(0, cuts[1]))
            for side, (rows, cut) in enumerate(zip((a, b), cuts, strict=True)):
                left = len(rows.t) - cut
                self._waiting[side] = rows.cut(cut, len(rows.t)) if left else None
        for side in (0, 1):
            rest = self._waiting[side]
            if rest is not None and self._ended[1 - side]:
                self._waiting[side] = None
                self.skip(side, rest.t)

    def _pair(self, a: Rows, b: Rows) -> None:
        rows_a = rows_b = np.arange(len(a.t))
        if not self.by_number and not np.array_equal(a.t, b.t):
            _, rows_a, rows_b = np.intersect1d(a.t, b.t, assume_unique=True, return_indices=True)
            for side, rows, kept in ((0, a, rows_a), (1, b, rows_b)):
                lone = np.setdiff1d(np.arange(len(rows.t)), kept, assume_unique=True)
                self._lonely(side, rows.t, lone)
            a, b = _take(a, rows_a), _take(b, rows_b)
        self.result.shared += len(rows_a)
        unequal = _unequal(a, b)
        if len(unequal):
            self.result.unequal += len(unequal)
            numbers = self._taken[0] + rows_a[unequal]
            self._differ(_take(a, unequal), _take(b, unequal), numbers)
        self._taken = [self._taken[0] + len(a.t), self._taken[1] + len(b.t)]

    def _lonely(self, side: int, t: NDArray[Any], rows: NDArray[Any]) -> None:
        self.result.lone[side] += len(rows)
        if len(rows):
            row = int(rows[0])
            there = (True, None) if side == 0 else (None, True)
            self._first(Difference(self._taken[side] + row, int(t[row]), "", *there))

    def _first(self, found: Difference) -> None:
        known = self.result.first
        if known is None or (not self.by_number and found.t < known.t):
            self.result.first = found

    def _differ(self, a: Rows, b: Rows, numbers: NDArray[Any]) -> None:
        """Look into messages whose bytes, or log times, differ."""
        try:
            blocks = None if self.kind is None else (_decode(self.kind, a), _decode(self.kind, b))
        except MessageError:
            blocks = None  # not what the schema says: their bytes differ, and that is all
        if self.kind is None or blocks is None:
            self.result.beyond += len(numbers)
            self._first(Difference(int(numbers[0]), int(a.t[0]), *_first_byte(a, b, 0)))
            return
        beyond = (a.t != b.t) | (blocks[0].t != blocks[1].t) | _rest_differs(self.kind, a, b)
        for spec, x, y in zip(
            self.kind.fields, blocks[0].values(), blocks[1].values(), strict=True
        ):
            tolerance = None if spec.integer else self.tolerances.get(spec.name)
            apart = _apart(x, y, len(numbers))
            self._enlarge(spec.name, spec.unit.symbol, apart, a.t)
            beyond |= _is_beyond(x, y, apart, tolerance)
        self.result.beyond += int(beyond.sum())
        if beyond.any():
            row = int(np.argmax(beyond))
            self._first(
                Difference(
                    int(numbers[row]),
                    int(a.t[row]),
                    *self._first_field(a, b, blocks[0].row(row), blocks[1].row(row), row),
                )
            )

    def _enlarge(self, name: str, unit: str, apart: NDArray[np.float64], t: NDArray[Any]) -> None:
        known = self.result.largest.setdefault(name, Largest(0.0, int(t[0]), unit))
        known.unknown += int(np.isnan(apart).any(axis=1).sum())
        rows = np.fmax.reduce(apart, axis=1)
        if not np.isnan(rows).all():
            row = int(np.nanargmax(rows))
            if rows[row] > known.value:
                known.value, known.t = float(rows[row]), int(t[row])

    def _first_field(
        self, a: Rows, b: Rows, x: Message, y: Message, row: int
    ) -> tuple[str, Any, Any, str]:
        """Return component, both values and unit of the first difference in one message."""
        if a.t[row] != b.t[row]:
            return "log time", int(a.t[row]), int(b.t[row]), "ns"
        if x.t != y.t:
            return "header.stamp", x.t, y.t, "ns"
        for spec, left, right in zip(x.fields, x.values(), y.values(), strict=True):
            tolerance = None if spec.integer else self.tolerances.get(spec.name)
            left, right = np.atleast_1d(left), np.atleast_1d(right)
            apart = _apart(left, right, spec.size)
            far = _is_beyond(left.reshape(-1, 1), right.reshape(-1, 1), apart, tolerance)
            if far.any():
                at = int(np.argmax(far))
                values = left.ravel()[at].item(), right.ravel()[at].item()
                return components(spec)[at], *values, spec.unit.symbol
        constants = [read_constants(type(x), rows.payload(row)) for rows in (a, b)]
        if constants[0].frame_id != constants[1].frame_id:
            a_text, b_text = (c.frame_id.encode("utf-8", "backslashreplace") for c in constants)
            return "header.frame_id", a_text.decode(), b_text.decode(), ""
        for (path, left), (_, right) in zip(*[c.values for c in constants], strict=True):
            if repr(left) != repr(right):
                return path, left, right, ""
        return _first_byte(a, b, row)  # in the padding, or in the pattern of a NaN


def _take(rows: Rows, which: NDArray[Any]) -> Rows:
    if len(which) == len(rows.t):
        return rows
    if not len(which):
        return rows.cut(0, 0)
    return Rows.gather(rows.t[which], rows.data, rows.starts[which], rows.sizes[which])


def _unequal(a: Rows, b: Rows) -> NDArray[Any]:
    """Return the rows that differ in their bytes, or in their log times."""
    if a.data == b.data and np.array_equal(a.sizes, b.sizes):
        return np.flatnonzero(a.t != b.t)
    left, right = a.matrix(), b.matrix()
    if left is not None and right is not None and left.shape == right.shape:
        return np.flatnonzero((left != right).any(axis=1) | (a.t != b.t))
    payloads = [a.payload(row) != b.payload(row) for row in range(len(a.t))]
    return np.flatnonzero(np.array(payloads, dtype=bool) | (a.t != b.t))


def _decode(kind: type[Message], rows: Rows) -> Message:
    return StreamDecoder(kind, []).block(rows.data, rows.starts, rows.sizes)


def _apart(x: NDArray[Any], y: NDArray[Any], rows: int) -> NDArray[np.float64]:
    """Return absolute differences, (N, components); NaN where only one is a number."""
    left, right = (value.reshape(rows, -1).astype(np.float64) for value in (x, y))
    with np.errstate(invalid="ignore", over="ignore"):
        apart: NDArray[np.float64] = np.abs(left - right)
    apart[(left == right) | (np.isnan(left) & np.isnan(right))] = 0.0
    return apart


def _is_beyond(
    x: NDArray[Any], y: NDArray[Any], apart: NDArray[np.float64], tolerance: float | None
) -> NDArray[np.bool_]:
    """Return the rows that are further apart than the tolerance; without one, in any bit."""
    if tolerance is None:
        bits = (value.reshape(len(apart), -1).view(np.int64) for value in (x, y))
        return np.asarray(np.not_equal(*bits).any(axis=1))
    return np.asarray(~(apart <= tolerance).all(axis=1))


def _rest_differs(kind: type[Message], a: Rows, b: Rows) -> NDArray[np.bool_]:
    """Return the rows that differ in frame_id or in members that the type does not declare."""
    left, right = (_rest(kind, rows) for rows in (a, b))
    if left is not None and right is not None:
        if left.shape != right.shape:
            return np.ones(len(a.t), dtype=bool)
        return np.asarray((left != right).any(axis=1))
    pairs = ([repr(read_constants(kind, r.payload(n))) for n in range(len(r.t))] for r in (a, b))
    return np.array([x != y for x, y in zip(*pairs, strict=True)])


def _rest(kind: type[Message], rows: Rows) -> NDArray[np.uint8] | None:
    """Return the payloads with stamp and declared fields zero; None if their layouts differ."""
    records = rows.matrix()
    if records is None:
        return None
    texts = np.ascontiguousarray(records[:, TEXT_AT : TEXT_AT + 4]).view("<u4")
    if not (texts == texts[0]).all():
        return None
    layout = layout_of(kind, StreamConstants("?" * (int(texts[0, 0]) - 1)))
    rest = records.copy()
    view = rest.view(layout.dtype)[:, 0]
    for name in layout.dtype.names or ():
        view[name] = 0
    return rest


def _first_byte(a: Rows, b: Rows, row: int) -> tuple[str, Any, Any, str]:
    left, right = a.payload(row), b.payload(row)
    if left == right:
        return "log time", int(a.t[row]), int(b.t[row]), "ns"
    if len(left) != len(right):
        return "size", len(left), len(right), "bytes"
    at = next(n for n, (x, y) in enumerate(zip(left, right, strict=True)) if x != y)
    return f"byte {at}", left[at], right[at], ""
