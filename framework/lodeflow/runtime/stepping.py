"""Stepping: the call that gives a node one row and sends what comes of it.

Live, every message goes through these lines at every node. They are therefore written for the
node at hand, as the methods of the message types are: without a loop over ports, and without a
call for what can be looked at in place.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator
from functools import cache
from types import CodeType, FunctionType
from typing import Any, Protocol

import numpy as np

from lodeflow.messages.message import Message
from lodeflow.runtime.output import Accept, Output
from lodeflow.runtime.plan import RAISED, PlanNode, check_output
from lodeflow.sync import Each, Sparse

ROW = """
def call(t, samples):
"""
MESSAGE = """
def call(message):
    if instead is not None:
        instead(message)
        return
    t = message.t
"""
STEP = """
    owner.last_row = t
    counters.stepped += 1
    try:
        returned = step({arguments})
    except RAISED as error:
        raise failure({what!r}, t, error) from error
    if returned is not None:
"""
UNPACK = """
        if type(returned) is not ports:
            look(returned)
        {names} = returned
"""
# What fails the quick look, and the first message, is looked at by `send` as a whole.
SEND = """
        if {m} is not None:
            u = {m}.t if type({m}) is out{i}.expected else None
            if type(u) is int and u >= t and u >= out{i}.bound:
                out{i}.bound = u + 1
                out{i}.sent += 1
                forward = out{i}.forward
                forward({m})
            else:
                out{i}.send({m}, t)
"""
SEND_ROWS = """
        if {m} is not None:
            send_rows{i}({m}, t)
"""
REFUSE = """
        refuse({m})
"""
PROMISE = """
    if lone is None or lone.bound <= t:  # else its message has said it
        move(t + 1)
"""


class Stepped(Protocol):
    """The node of a driver.

    Attributes:
        node: of the plan.
        stepped: the outputs that its step sends to, in the step's order.
        last_row: stamp of the last row that it was given.
    """

    node: PlanNode
    stepped: list[Output]
    last_row: int


def stepping(owner: Stepped) -> Callable[[int, tuple[Any, ...]], None]:
    """Return the call that takes a row: its stamp, and a sample per wired input."""
    samples = (f"samples[{index}]" for index in itertools.count())
    call: Callable[..., None] = _written(owner, ROW, samples)["call"]
    return call


def accepting(
    owner: Stepped, lone: Output | None, move: Callable[[int], None] | None
) -> tuple[Accept, Callable[[Accept], None]]:
    """Return the call that takes a message of the only input, and one that puts another into it.

    Args:
        owner: the node.
        lone: the output whose bound alone is waited for, if there is one.
        move: is told the least stamp that may still come; None if nobody waits for that.
    """
    tail = PROMISE if move is not None else ""
    scope = _written(owner, MESSAGE, iter(["message"]), tail)
    scope.update(instead=None, lone=lone, move=move)

    def put(instead: Accept) -> None:
        scope["instead"] = instead

    return scope["call"], put


def _written(owner: Stepped, head: str, samples: Iterator[str], tail: str = "") -> dict[str, Any]:
    """Write the code of a node and run it; return its names."""
    node, outputs, spec = owner.node, owner.stepped, owner.node.spec
    ports = ", ".join(output.port.name for output in outputs) or "(none)"

    def refuse(returned: Any) -> None:
        raise node.broken(ports, f"it declares no output, got {returned!r}")

    def look(returned: Any) -> None:
        if not isinstance(returned, tuple) or len(returned) != len(outputs):
            raise node.broken(ports, f"it must return these ports, got {returned!r}")
        if type(returned) is not tuple:  # a named one always has this length
            scope["ports"] = type(returned)

    arguments = [next(samples) if p.name in node.wires else "None" for p in spec.inputs]
    what = "step" if spec.has_step else "step_block"
    source = head + STEP.format(arguments=", ".join(arguments), what=what)
    taken = [f"m{i}" for i in range(len(outputs))] if spec.step_tuple else ["returned"]
    if spec.step_tuple:
        source += UNPACK.format(names=", ".join([*taken, ""]))
    send = REFUSE if not outputs else SEND if spec.has_step else SEND_ROWS
    source += "".join(send.format(m=m, i=i) for i, m in enumerate(taken))
    scope: dict[str, Any] = {
        "RAISED": RAISED,
        "counters": node.counters,
        "failure": node.failure,
        "look": look,
        "owner": owner,
        "ports": None,
        "refuse": refuse,
        "step": _sample_step(node),
        **{f"out{i}": output for i, output in enumerate(outputs)},
        **{f"send_rows{i}": _rows(output) for i, output in enumerate(outputs)},
    }
    # A copy, for the interpreter keeps with the code what it has learnt of one node's names.
    scope["call"] = FunctionType(_code(source + tail).replace(), scope)
    return scope


def _sample_step(node: PlanNode) -> Callable[..., Any]:
    """Return a step that takes samples, whichever form the plugin has."""
    plugin: Any = node.plugin
    if node.spec.has_step:
        step: Callable[..., Any] = plugin.step
        return step
    step_block = plugin.step_block
    kinds = [port.type for port in node.spec.inputs]
    sparse = isinstance(node.spec.sync, Each)

    def through_block(*samples: Any) -> Any:
        if sparse:
            return step_block(*_sparse(samples, kinds))
        return step_block(*[s if s is None else s.as_block() for s in samples])

    return through_block


def _sparse(samples: tuple[Any, ...], kinds: list[type[Message]]) -> list[Sparse[Any]]:
    """Return the samples of one row as inputs of a block step under `Each`."""
    t = np.array([next(s.t for s in samples if s is not None)], dtype=np.int64)
    absent, present = np.array([-1]), np.array([0])
    return [
        Sparse(kind.empty(), absent, t) if s is None else Sparse(s.as_block(), present, t)
        for s, kind in zip(samples, kinds, strict=True)
    ]


def _rows(output: Output) -> Callable[[Any, int], None]:
    """Return the call that sends what a block step gave: any number of rows."""
    node, port = output.node, output.port

    def send_rows(block: Any, t: int) -> None:
        if type(block) is not port.type or not block.is_block:
            check_output(node, port, block)
            raise node.broken(port.name, "a block step must send blocks, got a sample")
        for i in range(len(block.t)):
            output.send(block.row(i), t)

    return send_rows


@cache
def _code(source: str) -> CodeType:
    (code,) = [c for c in compile(source, "<step>", "exec").co_consts if isinstance(c, CodeType)]
    return code
