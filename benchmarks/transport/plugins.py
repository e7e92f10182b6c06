"""The nodes of lodeflow's side."""

from __future__ import annotations

import time
from collections.abc import Iterator
from typing import Literal

import numpy as np
from task import Book, Task, compiled, paced

import lodeflow as lf

TASK = Task.from_environment()
ROWS = max(TASK.rows, 100)
VALUES = max(TASK.size // TASK.rows - 24, 16) // 8


class Packet(lf.Message, ros="bench_msgs/msg/Packet"):
    """When it was sent, its number, and padding up to the size that is asked for."""

    data: lf.Array[lf.Dimensionless, Literal[VALUES]]  # type: ignore[valid-type]
    tail: lf.UInt32


class Tick(lf.Message, ros="bench_msgs/msg/Tick"):
    number: lf.Scalar[lf.Dimensionless]


class Ticks(lf.Source):
    """Paced by the run where it has a rate, else as fast as the run takes them."""

    def read(self, clock: lf.Clock) -> Iterator[Tick]:
        step = int(1e9 / TASK.hz) if TASK.hz else 1000
        for first in range(0, TASK.count, 100):
            n = np.arange(first, min(first + 100, TASK.count), dtype=np.int64)
            yield Tick(n * step, n.astype(float))


class Stamp(lf.Node):
    """Sends packets, with the time at which it does."""

    def start(self) -> None:
        self.values = np.zeros(VALUES)
        if TASK.numba:
            compiled()

    def step(self, tick: Tick) -> Packet:
        values = self.values.copy()
        values[1] = tick.number
        values[0] = time.monotonic_ns()
        return Packet(tick.t, values, 0)


class Device(lf.Source):
    """A live device in the place of ticks and stamp: its thread, and its inbox, are in the way."""

    max_delay = 10_000_000_000

    def read(self, clock: lf.Clock) -> Iterator[Packet]:
        template = np.zeros(VALUES)
        for n in paced(TASK):
            values = template.copy()
            values[1] = n
            values[0] = time.monotonic_ns()
            yield Packet(clock.now(), values, 0)


class Relay(lf.Node):
    def step(self, x: Packet) -> Packet:
        return Packet(x.t, x.data, x.tail)


class Sink(lf.Node):
    """Notes what comes, one by one."""

    def start(self) -> None:
        self.book = Book(TASK)
        if TASK.numba:
            compiled()

    def step(self, x: Packet) -> None:
        self.book.see(x.data[0], x.data[1])


class Blocks(lf.Source):
    """Blocks of so many packets; they are there before, as the payload of the other peers is."""

    def start(self) -> None:
        self.ready = [self.block(first) for first in range(0, TASK.count, ROWS)]

    def block(self, first: int) -> lf.Message:
        n = np.arange(first, first + ROWS, dtype=np.int64)
        values = np.zeros((ROWS, VALUES))
        values[:, 1] = n
        return Packet(n * 1000, values, np.zeros(ROWS, dtype=np.int64))

    def read(self, clock: lf.Clock) -> Iterator[Packet]:
        yield from self.ready


class BlockSink(lf.Node):
    def start(self) -> None:
        self.book = Book(TASK)

    def step_block(self, x: Packet) -> None:
        self.book.see(0.0, x.data[-1, 1], len(x))


class ImuBlocks(Blocks):
    def block(self, first: int) -> lf.Message:
        n = np.arange(first, first + ROWS, dtype=np.int64)
        values = np.zeros((ROWS, 3))
        values[:, 0] = n
        return lf.Imu(n * 1000, values, values.copy())

    def read(self, clock: lf.Clock) -> Iterator[lf.Imu]:
        yield from self.ready


class ImuBlockSink(lf.Node):
    def start(self) -> None:
        self.book = Book(TASK)

    def step_block(self, x: lf.Imu) -> None:
        self.book.see(0.0, x.angular_velocity[-1, 0], len(x))


class ImuSink(lf.Node):
    def start(self) -> None:
        self.book = Book(TASK)

    def step(self, x: lf.Imu) -> None:
        self.book.see(0.0, x.angular_velocity[0])
