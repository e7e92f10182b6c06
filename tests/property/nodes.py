"""Small nodes for random graphs: every output depends on stamps, values and state."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

import lodeflow as lf
from lodeflow.messages.message import Message

PRIME = 1_000_003


class Value(Message, ros="lodeflow_property/msg/Value"):
    """An integer."""

    value: lf.Int64


class Pair(NamedTuple):
    a: Value | None
    b: Value | None


class Switched(NamedTuple):
    out: Value | None
    mode: lf.Mode | None


class Total(NamedTuple):
    total: Value | None


def mix(*parts: int) -> int:
    h = 7
    for part in parts:
        h = (h * 31 + part) % PRIME
    return h


class Single(lf.Node):
    """Base: one input."""

    def start(self) -> None:
        self.state = 1


class Affine(Single):
    def step(self, x: Value) -> Value | None:
        self.state = mix(self.state, x.t, x.value)
        return Value(x.t, self.state)


class AffineBlock(Single):
    def step_block(self, x: Value) -> Value | None:
        out = np.empty(len(x), dtype=np.int64)
        for i in range(len(x)):
            self.state = out[i] = mix(self.state, int(x.t[i]), int(x.value[i]))
        return Value(x.t, out)


class Silent(Single):
    """Says nothing for most rows."""

    def step(self, x: Value) -> Value | None:
        self.state = mix(self.state, x.value)
        return Value(x.t, self.state) if self.state % 3 == 0 else None


class Thinner(Single):
    """Lowers the rate; a block may become empty."""

    def step_block(self, x: Value) -> Value | None:
        keep = (self.state + np.arange(len(x))) % 3 == 0
        self.state = (self.state + len(x)) % 3
        return Value(x.t[keep], x.value[keep] + 1)


class Doubler(Single):
    """Raises the rate, looking back."""

    lookback = 3

    def start(self) -> None:
        self.last = -(10**9)

    def step_block(self, x: Value) -> Value | None:
        t, v = [], []
        for at, value in zip(x.t.tolist(), x.value.tolist(), strict=True):
            extra = max(self.last + 1, at - 3)
            if extra < at:
                t.append(extra)
                v.append(mix(value, extra))
            t.append(at)
            v.append(value)
            self.last = at
        return Value(np.array(t, dtype=np.int64), np.array(v, dtype=np.int64))


class Delayer(Single):
    """Stamps back in time, and speaks once more at the end."""

    lookback = 4

    def start(self) -> None:
        self.state, self.t = 1, None

    def step(self, x: Value) -> Value | None:
        self.state = mix(self.state, x.value)
        self.t = x.t
        return Value(x.t - 4, self.state)

    def finish(self) -> Value | None:
        return None if self.t is None else Value(self.t - 2, self.state)


class Closer(Single):
    """Silent for most rows, and speaks once more at its last row."""

    def start(self) -> None:
        self.state, self.t = 1, None

    def step(self, x: Value) -> Value | None:
        self.state = mix(self.state, x.value)
        self.t = x.t if self.state % 3 else None
        return None if self.state % 3 else Value(x.t, self.state)

    def finish(self) -> Value | None:
        return None if self.t is None else Value(self.t, self.state)


class Ahead(Single):
    """Stamps ahead of its rows."""

    def step(self, x: Value) -> Value | None:
        return Value(x.t + 2, mix(x.value))


class Splitter(Single):
    """Two ports of different rates."""

    def step(self, x: Value) -> Pair | None:
        self.state = mix(self.state, x.value)
        if self.state % 5 == 0:
            return None
        return Pair(
            Value(x.t, self.state) if self.state % 2 else None,
            Value(x.t, x.value) if self.state % 3 else None,
        )


class Switcher(Single):
    """Sends a mode when it changes."""

    def start(self) -> None:
        self.mode = -1

    def step(self, x: Value) -> Switched | None:
        mode = x.value % 2 + 1
        changed, self.mode = mode != self.mode, mode
        return Switched(Value(x.t, x.value + 1), lf.Mode(x.t, mode) if changed else None)


class Totaller(Single):
    """Speaks only at the end."""

    def start(self) -> None:
        self.state, self.t = 0, None

    def step(self, x: Value) -> None:
        self.state = mix(self.state, x.t, x.value)
        self.t = x.t

    def finish(self) -> Total | None:
        return None if self.t is None else Total(Value(self.t, self.state))


class Joined(lf.Node):
    """Base: two inputs."""

    sync = lf.Exact()

    def start(self) -> None:
        self.state = 1

    def step(self, x: Value, y: Value) -> Value | None:
        self.state = mix(self.state, x.t, x.value, y.t, y.value)
        return Value(x.t, self.state)


class ExactPair(Joined):
    sync = lf.Exact()


class ExactTriple(lf.Node):
    sync = lf.Exact()

    def step_block(self, x: Value, y: Value, z: Value) -> Value | None:
        return Value(x.t, (x.value + 3 * y.value + 5 * z.value) % PRIME)


class NearestPair(Joined):
    sync = lf.Nearest("x", within=3)


class NearestTriple(lf.Node):
    sync = lf.Nearest("y", within=2)

    def start(self) -> None:
        self.state = 1

    def step(self, x: Value, y: Value, z: Value) -> Value | None:
        self.state = mix(self.state, x.t, x.value, y.t, y.value, z.t, z.value)
        return Value(y.t, self.state)


class HoldPair(Joined):
    sync = lf.Hold("x")


class HoldInitial(Joined):
    sync = lf.Hold("x", initial={"y": Value(-5, 11)})


class HoldBlock(lf.Node):
    sync = lf.Hold("y", initial={"x": Value(-5, 11)})

    def step_block(self, x: Value, y: Value, z: Value) -> Value | None:
        return Value(y.t, (x.value + 3 * y.value + 5 * z.value + x.t + z.t) % PRIME)


class HoldGaps(Joined):
    """A hold that looks back, and speaks at the end."""

    sync = lf.Hold("x")
    lookback = 2

    def start(self) -> None:
        self.state, self.t = 1, None

    def step(self, x: Value, y: Value) -> Value | None:
        self.state, self.t = mix(self.state, x.value, y.value), x.t
        return Value(x.t - 2, self.state)

    def finish(self) -> Value | None:
        return None if self.t is None else Value(self.t, self.state)


class EachPair(lf.Node):
    sync = lf.Each()

    def start(self) -> None:
        self.state = 1

    def step(self, x: Value | None, y: Value | None) -> Value | None:
        t = x.t if x is not None else y.t
        self.state = mix(self.state, t, x.value if x else 3, y.value if y else 5)
        return Value(t, self.state)


class EachBlock(lf.Node):
    sync = lf.Each()

    def start(self) -> None:
        self.state = 1

    def step_block(
        self, x: lf.Sparse[Value], y: lf.Sparse[Value], z: lf.Sparse[Value] = None
    ) -> Value | None:
        out = np.empty(len(x.t), dtype=np.int64)
        assert len(x.values) == (x.rows >= 0).sum()
        for i, t in enumerate(x.t.tolist()):
            samples = [column.row(i) for column in (x, y, z)]
            self.state = mix(self.state, t, *[s.value if s else 9 for s in samples])
            out[i] = self.state
        return Value(x.t, out)


class Loop(lf.Node):
    """Closes a cycle."""

    sync = lf.Hold("x", initial={"back": Value(0, 1)}, delay=True)

    def step(self, x: Value, back: Value) -> Value | None:
        return Value(x.t, mix(x.value, back.t, back.value))


class LoopBlock(lf.Node):
    """Closes a cycle, in blocks, and is silent at times."""

    sync = lf.Hold("x", initial={"back": Value(0, 1)}, delay=True)

    def step_block(self, x: Value, back: Value) -> Value | None:
        value = (x.value * 3 + back.value + back.t) % PRIME
        keep = value % 4 != 0
        return Value(x.t[keep], value[keep])


class Given(lf.Source):
    """Stands for data that a test pushes itself."""

    def read(self, clock: lf.Clock) -> Iterator[Pair]:
        yield from ()


SINGLES = [
    Affine, AffineBlock, Silent, Thinner, Doubler, Delayer, Closer, Ahead, Splitter, Switcher,
    Totaller,
]  # fmt: skip
JOINS = [
    ExactPair, ExactTriple, NearestPair, NearestTriple, HoldPair, HoldInitial, HoldBlock, HoldGaps,
    EachPair, EachBlock,
]  # fmt: skip
LOOPS = [Loop, LoopBlock]
