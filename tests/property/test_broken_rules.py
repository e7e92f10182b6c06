"""The random graphs notice when a rule is broken: each change below must be caught."""

from __future__ import annotations

import numpy as np
import pytest
from definition import compare
from graphs import Case, cases
from hypothesis import HealthCheck, Phase, find, given, settings
from hypothesis import strategies as st
from hypothesis.errors import NoSuchExample

from lodeflow.errors import ContractError
from lodeflow.runtime import align, blocks, joins, plan, samples


def caught() -> bool:
    """Whether some random graph shows a difference (or a contract that the change breaks)."""

    def differs(example: tuple[Case, int]) -> bool:
        try:
            compare(*example)
        except (AssertionError, ContractError):
            return True
        return False

    try:
        find(
            st.tuples(cases(), st.integers(0, 2**32)),
            differs,
            settings=settings(
                max_examples=1200,
                deadline=None,
                derandomize=True,
                database=None,
                phases=[Phase.generate],
                suppress_health_check=list(HealthCheck),
            ),
        )
    except NoSuchExample:
        return False
    return True


def settle_early_in_blocks(patch: pytest.MonkeyPatch) -> None:
    right = align.HoldAligner._decided
    patch.setattr(
        align.HoldAligner,
        "_decided",
        lambda self, t: min(right(self, t - 1), len(t)),  # as if a bound b settled b itself
    )


def settle_early_in_samples(patch: pytest.MonkeyPatch) -> None:
    def acceptor(self: joins.Join, index: int) -> object:
        def accept(message: object) -> None:
            self.queues[index].append(message)
            self.bounds[index] = message.t + 2
            self.pump()

        return accept

    patch.setattr(joins.Join, "_acceptor", acceptor)


def nearest_early_in_blocks(patch: pytest.MonkeyPatch) -> None:
    best = align.NearestAligner._best

    patch.setattr(
        align.NearestAligner,
        "_decided",
        lambda self, t: min(
            int(np.searchsorted(t + best(self, c, t)[1] - 1, c.bound, side="right"))
            for c in self.others
        ),
    )


def other_tie_in_samples(patch: pytest.MonkeyPatch) -> None:
    def best(self: joins.NearestJoin, i: int, t: int) -> tuple[object, int]:
        queue = self.queues[i]
        while len(queue) > 1 and queue[1].t <= t:
            queue.popleft()
        found, least = None, self.within + 1
        for message in list(queue)[:2]:
            if abs(message.t - t) <= min(least, self.within):
                found, least = message, abs(message.t - t)
        return found, least

    patch.setattr(joins.NearestJoin, "_best", best)


def bound_too_high_in_blocks(patch: pytest.MonkeyPatch) -> None:
    promise = blocks.Output.promise
    patch.setattr(
        blocks.Output, "promise", lambda self, bound: promise(self, bound + (bound < 2**62))
    )


def bound_too_high_in_samples(patch: pytest.MonkeyPatch) -> None:
    promise = samples.Output.promise
    patch.setattr(
        samples.Output, "promise", lambda self, bound: promise(self, bound + (bound < 2**62))
    )


def lookback_forgotten(patch: pytest.MonkeyPatch) -> None:
    patch.setattr(plan.PlanNode, "promises_freely", lambda self, port: port.by_step)


def gate_before_its_time(patch: pytest.MonkeyPatch) -> None:
    def release(self: joins.Join) -> None:
        while self.pending:
            t, row = self.pending.popleft()
            if all(gate.is_open(t) for gate in self.gates):
                self.run(t, row)
            else:
                self.counters.gated += 1

    patch.setattr(joins.Join, "_release", release)


def delayed_hold_sees_its_own_stamp(patch: pytest.MonkeyPatch) -> None:
    partners = align.HoldAligner._partners

    def look(self: align.HoldAligner, column: align.Column, t: np.ndarray) -> object:
        return partners(self, column, t + 1 if self.delay else t)

    patch.setattr(align.HoldAligner, "_partners", look)


@pytest.mark.parametrize(
    "change",
    [
        settle_early_in_blocks,
        settle_early_in_samples,
        nearest_early_in_blocks,
        other_tie_in_samples,
        bound_too_high_in_blocks,
        bound_too_high_in_samples,
        lookback_forgotten,
        gate_before_its_time,
        delayed_hold_sees_its_own_stamp,
    ],
    ids=lambda change: change.__name__,
)
def test_a_broken_rule_is_caught(change: object, monkeypatch: pytest.MonkeyPatch) -> None:
    change(monkeypatch)
    assert caught()


def test_the_random_graphs_have_what_they_are_meant_to_have() -> None:
    """Guards the generator: graphs without joins or cycles would prove nothing."""
    seen = {"loops": 0, "gates": 0, "joins": 0, "empty sources": 0, "fan-out": 0}

    @settings(max_examples=300, deadline=None, derandomize=True, database=None)
    @given(cases())
    def look(case: Case) -> None:
        built = case.graph.nodes.values()
        readers = [wire for node in built for wire in node.inputs.values()]
        seen["loops"] += any("back" in node.inputs for node in built)
        seen["gates"] += any(node.gates for node in built)
        seen["joins"] += any(len(node.inputs) > 1 for node in built)
        seen["empty sources"] += any(not any(map(len, b)) for b in case.data.values())
        seen["fan-out"] += len(readers) > len(set(readers))

    look()
    assert all(count > 20 for count in seen.values()), seen
