"""check_node tells each broken rule by its own text; run_node runs a node on data."""

from __future__ import annotations

import random
import time
from collections.abc import Iterator
from typing import Any, ClassVar

import numpy as np
import pytest
from numba import njit

import lodeflow as lf
from lodeflow.testing import check_node, run_node


class Doubler(lf.Node):
    def step_block(self, rate: lf.AngularRate) -> lf.AngularRate:
        return rate.replace(angular_rate=2 * rate.angular_rate)


class Sum(lf.Node):
    """Good: a state, set up by start."""

    def start(self) -> None:
        self.sum = np.zeros(3)

    def step(self, rate: lf.AngularRate) -> lf.AngularRate:
        self.sum = self.sum + rate.angular_rate
        return rate.replace(angular_rate=self.sum)


@njit
def twice(column: np.ndarray) -> np.ndarray:
    return 2.0 * column


@njit
def thrice(column: np.ndarray) -> np.ndarray:
    return 3.0 * column


class CompiledLate(lf.Node):
    def step_block(self, rate: lf.AngularRate) -> lf.AngularRate:
        return rate.replace(angular_rate=twice(rate.angular_rate))


class CompiledAtStart(lf.Node):
    def start(self) -> None:
        thrice(np.empty((0, 3)))

    def step_block(self, rate: lf.AngularRate) -> lf.AngularRate:
        return rate.replace(angular_rate=thrice(rate.angular_rate))


class NeverReset(Sum):
    def start(self) -> None:
        self.sum = getattr(self, "sum", np.zeros(3))


class PerBlock(lf.Node):
    def step_block(self, rate: lf.AngularRate) -> lf.AngularRate:
        return rate.replace(angular_rate=rate.angular_rate - rate.angular_rate[0])


class InSlices(lf.Node):
    """Differs only where many blocks of one row follow each other."""

    def start(self) -> None:
        self.single = 0

    def step_block(self, rate: lf.AngularRate) -> lf.AngularRate:
        self.single = self.single + 1 if len(rate) == 1 else 0
        return rate.replace(angular_rate=rate.angular_rate * (2.0 if self.single > 9 else 1.0))


class TwoMinds(lf.Node):
    """Only samples differ."""

    def step_block(self, rate: lf.AngularRate) -> lf.AngularRate:
        return rate

    def step(self, rate: lf.AngularRate) -> lf.AngularRate:
        return rate.replace(angular_rate=-rate.angular_rate)


class Spoiler(lf.Node):
    def step_block(self, rate: lf.AngularRate) -> lf.AngularRate:
        rate.angular_rate.flags.writeable = True
        rate.angular_rate[:] += 1.0
        return rate.replace(angular_rate=rate.angular_rate.copy())


class SampleSpoiler(Doubler):
    """Modifies its inputs where they are samples only."""

    def step(self, rate: lf.AngularRate) -> lf.AngularRate:
        out = rate.replace(angular_rate=2 * rate.angular_rate)
        owner = rate.angular_rate if rate.angular_rate.base is None else rate.angular_rate.base
        owner.flags.writeable = True
        rate.angular_rate.flags.writeable = True
        rate.angular_rate[:] = 0.0
        return out


class Early(lf.Node):
    def step(self, rate: lf.AngularRate) -> lf.AngularRate:
        return rate.replace(t=rate.t - 5)


class WrongType(lf.Node):
    def step(self, rate: lf.AngularRate) -> lf.AngularRate:
        return lf.SpecificForce(rate.t, rate.angular_rate)  # type: ignore[return-value]


class Late(lf.Node):
    def step(self, rate: lf.AngularRate) -> lf.AngularRate:
        return rate.replace(t=time.time_ns())


def helper() -> float:
    return random.gauss(0.0, 1.0)


class Guessing(lf.Node):
    def step(self, rate: lf.AngularRate) -> lf.AngularRate:
        return rate.replace(angular_rate=rate.angular_rate + helper())


class Seeded(lf.Node):
    """Good: random, but the same in each run."""

    def start(self) -> None:
        self.rng = np.random.default_rng(7)

    def step(self, rate: lf.AngularRate) -> lf.AngularRate:
        return rate.replace(angular_rate=self.rng.standard_normal(3))


class Unseeded(Seeded):
    def start(self) -> None:
        self.rng = np.random.default_rng()


class SeededWithNone(Seeded):
    def start(self) -> None:
        self.rng = np.random.default_rng(seed=None)


class Counting(lf.Source):
    """Good."""

    def read(self, clock: lf.Clock) -> Iterator[lf.AngularRate]:
        for t in range(0, 10**9, 10**7):
            yield lf.AngularRate.of(clock.start + t, angular_rate=[self.value(t)] * 3)

    def value(self, t: int) -> float:
        return float(t)


class Backwards(Counting):
    def read(self, clock: lf.Clock) -> Iterator[lf.AngularRate]:
        yield from reversed(list(super().read(clock)))


class NotFinite(Counting):
    def value(self, t: int) -> float:
        return np.nan


class OnceOnly(Counting):
    calls = 0

    def value(self, t: int) -> float:
        self.calls += 1
        return float(self.calls)


@pytest.mark.parametrize("plugin", [Doubler, Sum, Seeded, Counting])
def test_a_good_plugin_passes(plugin: type[Any]) -> None:
    check_node(plugin)


@pytest.mark.parametrize(
    ("plugin", "rule"),
    [
        (NeverReset, "start() must reset all state; port 'out' differs from message 0 on"),
        (PerBlock, "any split into blocks must give the same bytes; port 'out' differs"),
        (InSlices, "blocks of one row must give the same bytes; port 'out' differs"),
        (TwoMinds, "single samples must give the same bytes; port 'out' differs"),
        (Spoiler, "inputs must not be modified"),
        (SampleSpoiler, "inputs must not be modified"),
        (Early, "lies before its row minus the lookback of 0 ns"),
        (WrongType, "it must send AngularRate, got SpecificForce"),
        (Late, "no wall clock and no global random generator (time.time_ns in Late)"),
        (Guessing, "no global random generator (random.gauss in helper)"),
        (Unseeded, "(np.random.default_rng() without a seed in Unseeded)"),
        (SeededWithNone, "(np.random.default_rng() without a seed in SeededWithNone)"),
        (Backwards, "after a yield that reached stamp T nothing at or below T may follow"),
        (NotFinite, "what it yields must be finite"),
        (OnceOnly, "start() must reset all state, and two runs give the same bytes"),
    ],
)
def test_a_broken_rule_is_told_with_the_plugin(plugin: type[Any], rule: str) -> None:
    with pytest.raises(lf.ContractError) as raised:
        check_node(plugin)
    assert str(raised.value).startswith(f"{plugin.__module__}.{plugin.__qualname__}")
    assert rule in str(raised.value)


class Needy(Doubler):
    class Params(lf.Params):
        gain: float
        offset: float
        note: str = ""


class NeedySource(Counting):
    Params = Needy.Params


class Fed(Needy):
    example: ClassVar = {"gain": 1.0, "offset": 2.0}


@pytest.mark.parametrize("plugin", [Needy, NeedySource])
def test_parameters_without_a_value_are_told(plugin: type[Any]) -> None:
    path = f"{plugin.__module__}.{plugin.__qualname__}"
    with pytest.raises(lf.NodeError) as raised:
        check_node(plugin)
    assert str(raised.value) == (
        f"{path}: give `example` a value for gain, offset, without default"
    )
    with pytest.raises(lf.NodeError) as raised:
        check_node(plugin, {"gain": 1.0})
    assert str(raised.value) == f"{path}: give a value for offset, without default"
    with pytest.raises(lf.NodeError) as raised:
        check_node(plugin, {"gain": "much", "offset": 1.0, "gian": 2.0})
    assert str(raised.value).startswith(f"{path}: gain: Input should be a valid number")
    assert "; gian: Extra inputs are not permitted" in str(raised.value)


def test_what_numba_compiles_is_compiled_at_the_start() -> None:
    check_node(CompiledAtStart)
    late = r"compiled in start\(\).*\.twice\(array\(float64, 2d, C\)\)"
    with pytest.raises(lf.ContractError, match=late):
        check_node(CompiledLate)


def test_the_example_fills_in_what_has_no_default() -> None:
    check_node(Fed)


def test_run_node_returns_a_block_per_port() -> None:
    samples = [lf.AngularRate.of(t, angular_rate=[1, 2, t]) for t in (3, 8)]
    block = lf.AngularRate.concat([sample.as_block() for sample in samples])
    for given in (samples, block):
        out = run_node(Doubler, rate=given)
        assert out.keys() == {"out"}
        assert out["out"].t.tolist() == [3, 8]
        assert out["out"].angular_rate.tolist() == [[2, 4, 6], [2, 4, 16]]


def test_run_node_tells_an_input_that_is_not_there() -> None:
    with pytest.raises(TypeError, match="Doubler has no input rat"):
        run_node(Doubler, rat=[])


def test_run_node_fails_as_a_run_does() -> None:
    with pytest.raises(lf.ContractError, match="lies before its row"):
        run_node(Early, rate=[lf.AngularRate.of(9, angular_rate=[1, 2, 3])])
