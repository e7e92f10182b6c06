"""Both drivers: every broken contract and failure, by its text."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from runtime_toys import (
    Pair,
    Reading,
    block,
    block_stepping,
    drive,
    fail,
    plan_of,
    ramp,
    rows,
    stepping,
    tapped,
    told,
)

import lodeflow as lf
from lodeflow.errors import ContractError, NodeFailure
from lodeflow.runtime.blocks import BlockDriver
from lodeflow.runtime.plan import Plan

both = pytest.mark.parametrize("form", ["blocks", "samples"])


def broken(form: str, plan: Plan, data: Any = None) -> str:
    with pytest.raises(ContractError) as found:
        drive(form, plan, ramp(3) if data is None else data)
    text = told(found.value)
    start = "node 'n' (Node) broke the contract of port "
    assert text.startswith(start), text
    return text.removeprefix(start)


@both
@pytest.mark.parametrize("hears", [False, True])
@pytest.mark.parametrize("first", [True, False])
@pytest.mark.parametrize(
    ("bad", "text"),
    [
        (lambda x: 3.5, "'out': it must send Reading, got float"),
        (lambda x: lf.Heading(x.t, 1.0), "'out': it must send Reading, got Heading"),
        (lambda x: [x, x], "'out': it must send Reading, got list"),
        (lambda x: (x,), "'out': it must send Reading, got tuple"),
        (lambda x: x.as_block(), "'out': a sample step must send samples, got a block"),
        (
            lambda x: x.replace(t=np.int64(x.t)),
            "'out': Reading.t must be an int in nanoseconds, or an int64 array for a block, got "
            "np.int64(2) (int64)",
        ),
        (
            lambda x: x.replace(t=x.t - 1),
            "'out': stamp 1 lies before its row minus the lookback of 0 ns",
        ),
    ],
)
def test_a_wrong_sample_is_refused_first_and_later(
    form: str, hears: bool, first: bool, bad: Callable[[Any], Any], text: str
) -> None:
    def step(x: Any) -> Any:
        return bad(x) if x.t == 2 else None if first else x

    assert broken(form, stepping(step, hears=hears)) == text


@both
@pytest.mark.parametrize("hears", [False, True])
def test_the_first_sample_is_looked_at_in_full(form: str, hears: bool) -> None:
    plan = stepping(lambda x: x.replace(x=np.ones(2)), hears=hears)
    assert broken(form, plan) == "'out': Reading.x must be a float, got float64 of shape (2,)"


@both
@pytest.mark.parametrize("hears", [False, True])
def test_stamps_must_strictly_increase(form: str, hears: bool) -> None:
    plan = stepping(lambda x: x.replace(t=5), hears=hears)
    assert broken(form, plan) == "'out': stamps must strictly increase, got 5 where 6 is the least"


@both
def test_stamps_must_strictly_increase_in_a_block_too(form: str) -> None:
    plan = block_stepping(lambda x: block((9, 1.0), (7, 2.0)))
    assert broken(form, plan) == "'out': stamps must strictly increase, got 7 where 10 is the least"


def test_stamps_must_strictly_increase_between_blocks() -> None:
    plan = block_stepping(lambda x: block((9, 1.0)))
    plan.start()
    driver = BlockDriver(plan)
    driver.push("s", [(0, ramp(1))], 1)
    with pytest.raises(ContractError, match="got 9 where 10 is the least"):
        driver.push("s", [(0, block((1, 0.0)))], 2)


@both
def test_the_lookback_is_in_the_text(form: str) -> None:
    plan = stepping(lambda x: x.replace(t=x.t - 4), lookback=3)
    assert broken(form, plan) == "'out': stamp -4 lies before its row minus the lookback of 3 ns"
    good = stepping(lambda x: x.replace(t=x.t - 3), lookback=3)
    sent = tapped(good, "n")
    drive(form, good, ramp(3))
    assert [t for t, _ in rows(sent["n"])] == [-3, -2, -1]


@both
def test_a_block_step_sends_blocks(form: str) -> None:
    assert broken(form, block_stepping(lambda x: x.row(0))) == (
        "'out': a block step must send blocks, got a sample"
    )
    assert broken(form, block_stepping(lambda x: 7)) == "'out': it must send Reading, got int"


@both
def test_a_node_without_output_sends_nothing(form: str) -> None:
    class Node(lf.Node):
        def step(self, x: Reading) -> None:
            return x

    assert broken(form, plan_of(Node)) == (
        "'(none)': it declares no output, got Reading(t=0, x=0.0)"
    )


@both
def test_several_ports_are_all_returned(form: str) -> None:
    class Node(lf.Node):
        def step(self, x: Reading) -> Pair | None:
            return x if x.t == 2 else Pair(x, None)

    assert broken(form, plan_of(Node)) == (
        "'a, b': it must return these ports, got Reading(t=2, x=2.0)"
    )


@both
@pytest.mark.parametrize(
    ("last", "text"),
    [
        (7, "'out': finish returned 7"),
        (lf.Heading(9, 1.0), "'out': it must send Reading, got Heading"),
        (Pair(None, None), "'out': finish returned Pair(a=None, b=None)"),
        (Reading(1, 0.0), "'out': stamp 1 lies before its row minus the lookback of 0 ns"),
    ],
)
def test_wrong_last_words(form: str, last: Any, text: str) -> None:
    class Node(lf.Node):
        def step(self, x: Reading) -> None: ...

        def finish(self) -> Reading | None:
            return last

    assert broken(form, plan_of(Node)) == text


@both
def test_last_words_after_the_last_sample(form: str) -> None:
    class Node(lf.Node):
        def step(self, x: Reading) -> Reading | None:
            return x

        def finish(self) -> Reading | None:
            return Reading(2, 9.0)

    assert broken(form, plan_of(Node)) == (
        "'out': stamps must strictly increase, got 2 where 3 is the least"
    )


@both
def test_a_value_that_does_not_fit_its_field_is_not_cut(form: str) -> None:
    class Node(lf.Node):
        def step(self, x: Reading) -> lf.Mode | None:
            return lf.Mode(x.t, 1 if x.t < 2 else 1.5)

    plan = plan_of(Node)
    if form == "blocks":
        assert broken(form, plan) == "'out': Mode.mode: not every sample has int64 of shape ()"
    else:
        sent = tapped(plan, "n")
        drive(form, plan, ramp(3))
        assert [m.mode for m in sent["n"]] == [1, 1, 1.5]  # the encoder refuses it


def failure(form: str, plan: Plan) -> str:
    with pytest.raises(NodeFailure) as found:
        drive(form, plan, ramp(3))
    assert isinstance(found.value.__cause__, ZeroDivisionError)
    return told(found.value)


ZERO = "ZeroDivisionError: integer division or modulo by zero"


@both
def test_a_failing_step_is_named_with_its_stamp_and_inputs(form: str) -> None:
    plan = stepping(lambda x: fail(x) if x.t == 2 else x)
    assert failure(form, plan) == f"node 'n' (Node.step) failed at t=2 on x=s.a: {ZERO}"
    assert plan.nodes["n"].counters.stepped >= 3


def test_a_failing_block_step_is_named_with_its_span() -> None:
    text = f"node 'n' (Node.step_block) failed at t=0..2 on x=s.a: {ZERO}"
    assert failure("blocks", block_stepping(fail)) == text
    one = block_stepping(fail)
    with pytest.raises(NodeFailure, match=r"failed at t=4 on x=s\.a"):
        drive("blocks", one, block((4, 0.0)))


def test_a_failing_block_step_in_the_sample_driver() -> None:
    assert failure("samples", block_stepping(fail)) == (
        f"node 'n' (Node.step_block) failed at t=0 on x=s.a: {ZERO}"
    )


@both
def test_a_failing_start_and_finish(form: str) -> None:
    class Start(lf.Node):
        def start(self) -> None:
            fail(None)

        def step(self, x: Reading) -> None: ...

    assert failure(form, plan_of(Start)) == (
        f"node 'n' (Start.start) failed before its first message on x=s.a: {ZERO}"
    )

    class Finish(lf.Node):
        def step(self, x: Reading) -> None: ...

        def finish(self) -> None:
            fail(None)

    assert failure(form, plan_of(Finish)) == (
        f"node 'n' (Finish.finish) failed at t=2 on x=s.a: {ZERO}"
    )
    with pytest.raises(NodeFailure, match=r"\(Finish.finish\) failed before its first message on"):
        drive(form, plan_of(Finish), Reading.empty())
