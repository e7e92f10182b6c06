"""Clocks, without asking how fast this machine is."""

from __future__ import annotations

import time

import pytest

import lodeflow as lf
from lodeflow import clock
from lodeflow.clock import Pacer, SimClock, WallClock


class Time:
    """Stands in for the time module: it goes as it is told."""

    def __init__(self) -> None:
        self.wall = 1_000_000_000_000
        self.steady = 77

    def time_ns(self) -> int:
        return self.wall

    def monotonic_ns(self) -> int:
        return self.steady

    def monotonic(self) -> float:
        return self.steady / 1e9


@pytest.fixture
def fake(monkeypatch: pytest.MonkeyPatch) -> Time:
    fake = Time()
    monkeypatch.setattr(clock, "time", fake)
    return fake


def test_seconds_are_rounded_to_nanoseconds() -> None:
    assert lf.seconds(0.1) == 100_000_000
    assert lf.seconds(-1.5) == -1_500_000_000
    assert lf.seconds(1e-9 * 2.6) == 3
    assert type(lf.seconds(2)) is int


def test_the_simulated_clock_goes_on_as_it_is_told() -> None:
    sim = SimClock(5)
    assert (sim.start, sim.now()) == (5, 5)
    sim.advance(9)
    sim.advance(7)
    assert (sim.start, sim.now()) == (5, 9)


def test_the_wall_clock_does_not_follow_steps_of_the_system_clock(fake: Time) -> None:
    wall = WallClock()
    assert wall.start == wall.now() == 1_000_000_000_000
    fake.wall -= 10**12
    fake.steady += 500
    assert wall.now() == 1_000_000_000_500
    assert wall.start == 1_000_000_000_000


def test_the_pacer_counts_from_its_first_stamp(fake: Time) -> None:
    pacer = Pacer(speed=2.0)
    assert pacer.remaining(10**15) == 0.0
    assert pacer.remaining(10**15 + 3 * 10**9) == 1.5
    fake.steady += 2 * 10**9
    assert pacer.remaining(10**15 + 3 * 10**9) == -0.5
    assert pacer.remaining(10**15 - 2 * 10**9) == -3.0


def test_monotonic_and_wall_time(fake: Time) -> None:
    assert clock.monotonic() == fake.steady / 1e9
    assert clock.wall_time() == fake.wall


def test_the_wall_clock_is_the_time_since_1970() -> None:
    before = time.time_ns()
    start = WallClock().start
    assert before <= start <= time.time_ns()
