"""The sample driver: single messages go through the graph as direct calls, with least delay.

Every node becomes a few closures over its state: `accept` for the messages of an input, `advance`
for its bound. A chain of nodes is a chain of calls; only joins queue.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

import numpy as np

from lodeflow.errors import RunError
from lodeflow.graph.model import Wire
from lodeflow.messages.message import Message
from lodeflow.node import OutputPort
from lodeflow.runtime.gaps import without
from lodeflow.runtime.joins import Join, Run, make_join
from lodeflow.runtime.output import Accept, Advance, Output
from lodeflow.runtime.plan import (
    RAISED,
    Plan,
    PlanNode,
    Tap,
    check_output,
    last_words,
)
from lodeflow.sync import END, NEVER, Each, Sparse


class SampleNode:
    """A node as closures: `accept` and `advance`, per wired input and then per gate."""

    def __init__(self, node: PlanNode, taps: dict[Wire, list[Tap]]) -> None:
        self.node = node
        self.outputs = [
            Output(node, port, taps[Wire(node.name, port.name)]) for port in node.spec.outputs
        ]
        self.stepped = [output for output in self.outputs if output.port.by_step]
        self.free = [o for o in self.outputs if node.promises_freely(o.port)]
        self.tied = [o for o in self.stepped if o not in self.free]
        self.ended = False
        self.last_row = NEVER
        self.joins = node.sync is not None or bool(node.gates)
        self.join: Join | None = None
        self.accept: list[Accept] = []
        self.advance: list[Advance] = []
        self.senders: dict[str, Callable[[Any, int], None]] = {}
        self._rerun: Callable[[Run], None] = lambda run: None

    def compile(self, *, hears: bool) -> None:
        """Make the closures, once all readers are connected.

        Args:
            hears: whether this node, or one downstream, waits for bounds.
        """
        self.senders = {output.port.name: output.sender() for output in self.outputs}
        if self.node.spec.is_source:
            return
        run = self._changing_run()
        if self.joins:
            self.join = join = make_join(self.node, run, self.move, hears=hears)
            self.accept, self.advance = join.accept, join.advance
            self._rerun = join.use
            return

        def use(other: Run) -> None:
            nonlocal run
            run = other

        self._rerun = use
        move, lone = self.move, self.free[0] if len(self.outputs) == len(self.free) == 1 else None

        def accept(message: Any) -> None:
            row = message.t
            run(row, (message,))
            if not lone or lone.bound <= row:  # else its message has said it
                move(row + 1)

        def accept_deaf(message: Any) -> None:
            run(message.t, (message,))

        self.accept, self.advance = [accept if hears else accept_deaf], [move]
        single = len(self.stepped) == len(self.outputs) == 1 and not self.node.spec.step_tuple
        if single and not hears and self.node.spec.has_step and len(self.node.spec.inputs) == 1:
            self.accept = [self._direct()]

    def _changing_run(self) -> Run:
        """Return the call that steps one aligned row, by the instance whose turn it is."""
        if not self.node.changes:
            return self._run()
        due, before = self.node.changes[0].t, self._run()

        def run(t: int, samples: tuple[Any, ...]) -> None:
            if t < due:
                before(t, samples)
                return
            self.node.change()
            after = self._changing_run()
            self._rerun(after)
            after(t, samples)

        return run

    def rerun(self) -> None:
        """Look at the changes of the node, which have been added to."""
        self._rerun(self._changing_run())

    def _direct(self) -> Accept:
        """Return the path of one input and one output: every nanosecond counts here.

        It is `_run` and `Output.sender` in one call, with the same checks.
        """
        node, (output,) = self.node, self.outputs
        send, counters = self.senders[output.port.name], node.counters
        step: Callable[..., Any]

        def use(run: Run) -> None:
            nonlocal step
            # A change may have come with it, and need not have a sample step: the general way.
            step = partial(_by_run, run)

        def _by_run(run: Run, message: Any) -> None:
            counters.stepped -= 1
            run(message.t, (message,))

        step = self._sample_step()
        if node.changes:
            use(self._changing_run())
        self._rerun = use
        lookback, kind = node.lookback, output.port.type
        expected: type[Message] | None = None

        forward: Accept

        def replace(other: Accept) -> None:
            nonlocal forward
            forward = other

        forward = output.forwarding(replace)

        def accept(message: Any) -> None:
            nonlocal expected
            row = self.last_row = message.t
            counters.stepped += 1
            try:
                out = step(message)
            except RunError:  # told already, by the general way
                raise
            except RAISED as error:
                raise node.failure("step", row, error) from error
            if out is None:
                return
            t = out.t if type(out) is expected else None
            if type(t) is not int or t < output.bound or t < row - lookback:
                send(out, row)  # the first message, or one that is wrong
                expected = kind
                return
            output.bound = t + 1
            output.sent += 1
            forward(out)

        return accept

    def _run(self) -> Callable[[int, tuple[Any, ...]], None]:
        """Return the call that steps one aligned row and sends what comes of it."""
        node = self.node
        step = self._sample_step()
        wired = [port.name in node.wires for port in node.spec.inputs]
        complete, is_tuple = all(wired), node.spec.step_tuple
        counters = node.counters
        what = "step" if node.spec.has_step else "step_block"
        senders = [self.senders[output.port.name] for output in self.stepped]
        if not node.spec.has_step:
            senders = [self._rows(o.port, s) for o, s in zip(self.stepped, senders, strict=True)]
        names = ", ".join(output.port.name for output in self.stepped) or "(none)"

        def run(t: int, samples: tuple[Any, ...]) -> None:
            self.last_row = t
            counters.stepped += 1
            if not complete:
                present = iter(samples)
                samples = tuple([next(present) if has else None for has in wired])
            try:
                returned = step(*samples)
            except RAISED as error:
                raise node.failure(what, t, error) from error
            if returned is None:
                return
            if not is_tuple:
                if not senders:
                    raise node.broken(names, f"it declares no output, got {returned!r}")
                senders[0](returned, t)
                return
            if not isinstance(returned, tuple) or len(returned) != len(senders):
                raise node.broken(names, f"it must return these ports, got {returned!r}")
            for send, message in zip(senders, returned):  # noqa: B905 (the lengths are equal)
                if message is not None:
                    send(message, t)

        return run

    def _sample_step(self) -> Callable[..., Any]:
        """Return a step that takes samples, whichever form the plugin has."""
        plugin: Any = self.node.plugin
        if self.node.spec.has_step:
            step: Callable[..., Any] = plugin.step
            return step
        step_block = plugin.step_block
        kinds = [port.type for port in self.node.spec.inputs]
        sparse = isinstance(self.node.spec.sync, Each)

        def through_block(*samples: Any) -> Any:
            if sparse:
                return step_block(*_sparse(samples, kinds))
            return step_block(*[s if s is None else s.as_block() for s in samples])

        return through_block

    def _rows(self, port: OutputPort, send: Callable[[Any, int], None]) -> Callable[..., None]:
        """Return the call that sends what a block step gave: any number of rows."""
        node, kind = self.node, port.type

        def send_rows(block: Any, t: int) -> None:
            if type(block) is not kind or not block.is_block:
                check_output(node, port, block)
                raise node.broken(port.name, "a block step must send blocks, got a sample")
            for i in range(len(block.t)):
                send(block.row(i), t)

        return send_rows

    def move(self, floor: int) -> None:
        """Pass on that no later row will have a stamp below `floor`."""
        if floor == END:
            self._end()
            return
        for output in self.free:
            if floor > output.bound:
                output.bound = floor
                for advance in output.listeners:
                    advance(floor)
        if self.tied and self.last_row > NEVER:
            for output in self.tied:
                output.promise(self.node.bound_after(output.port, self.last_row))

    def _end(self) -> None:
        if self.ended:
            return
        self.ended = True
        for output, block in last_words(self.node, self.outputs, self.last_row):
            for i in range(len(block)):
                sample = block.row(i)
                row = self.last_row if self.last_row > NEVER else sample.t
                self.senders[output.port.name](sample, row)
        for output in self.outputs:
            output.promise(END)


def _sparse(samples: tuple[Any, ...], kinds: list[type[Message]]) -> list[Sparse[Any]]:
    """Return the samples of one row as inputs of a block step under `Each`."""
    t = np.array([next(s.t for s in samples if s is not None)], dtype=np.int64)
    absent, present = np.array([-1]), np.array([0])
    return [
        Sparse(kind.empty(), absent, t) if s is None else Sparse(s.as_block(), present, t)
        for s, kind in zip(samples, kinds, strict=True)
    ]


class SampleDriver:
    """Runs a plan on single messages.

    Args:
        plan: live nodes.
        outlets: streams whose bounds others ask for, by `bound`.
    """

    def __init__(self, plan: Plan, outlets: frozenset[Wire] = frozenset()) -> None:
        self.nodes = {name: SampleNode(node, plan.taps) for name, node in plan.nodes.items()}
        hearing = _hearing(self.nodes, {wire.node for wire in outlets})
        position = {name: index for index, name in enumerate(self.nodes)}
        for name in reversed(self.nodes):  # readers first, so that calls can be bound directly
            node = self.nodes[name]
            for other, output, index in self._readers(node):
                hears = other.node.name in hearing
                if position[other.node.name] <= position[name]:  # a delayed wire, leading back
                    (accept, advance), hears = _later(other, index), True
                else:
                    accept, advance = other.accept[index], other.advance[index]
                wire = Wire(node.node.name, output.port.name)
                if spans := other.node.gaps.get(str(wire)):
                    accept = without(accept, spans)
                output.connect(accept, advance, hears=hears)
            node.compile(hears=name in hearing)
        self.outputs = {
            Wire(name, output.port.name): output
            for name, node in self.nodes.items()
            for output in node.outputs
        }
        self.pushes = {
            name: list(node.senders.values())
            for name, node in self.nodes.items()
            if node.node.spec.is_source
        }

    def _readers(self, node: SampleNode) -> Iterator[tuple[SampleNode, Output, int]]:
        """Yield who reads the outputs of a node, which output, and at which of their inputs."""
        outputs = {Wire(node.node.name, o.port.name): o for o in node.outputs}
        for other in self.nodes.values():
            wires = [other.node.wires[port.name] for port in other.node.wired]
            wires += [gate.wire for gate in other.node.gates]
            for index, wire in enumerate(wires):
                if wire in outputs:
                    yield other, outputs[wire], index

    def push(self, source: str, port: int, sample: Any) -> None:
        """Bring in one sample of a source."""
        self.pushes[source][port](sample, sample.t)

    def promise(self, source: str, bound: int, port: int | None = None) -> None:
        """Say that nothing below `bound` will come on a port of a source, or on any."""
        outputs = self.nodes[source].outputs
        for output in outputs if port is None else (outputs[port],):
            output.promise(bound)

    def receive(self, source: str, port: int, message: Any, bound: int) -> None:
        """Bring in what came for one port of a node that runs elsewhere."""
        if message is not None:
            send = self.pushes[source][port]
            if type(message.t) is int:
                send(message, message.t)
            else:
                for index, t in enumerate(message.t.tolist()):
                    send(message.row(index), t)
        self.nodes[source].outputs[port].promise(bound)

    def bound(self, wire: Wire) -> int:
        """Return the bound that a port has promised."""
        return self.outputs[wire].bound

    def earliest_change(self, name: str) -> int:
        """Return the least stamp, ns, from which on a node can be another one."""
        node = self.nodes[name]
        return max(node.last_row + 1, *[output.bound for output in node.stepped], NEVER + 1)

    def change(self, name: str) -> None:
        """Look at the changes of a node, which have been added to."""
        self.nodes[name].rerun()

    def retap(self, wire: Wire) -> None:
        """Use the plan's taps of a port as they are now."""
        self.outputs[wire].retap()

    def waiting(self) -> dict[str, int]:
        """Return how many messages wait at each node for others; safe in any thread."""
        return {
            name: sum(map(len, node.join.queues)) + len(node.join.pending)
            for name, node in self.nodes.items()
            if node.join is not None
        }

    def count(self) -> None:
        """Bring the plan's counters of sent messages up to date."""
        for node in self.nodes.values():
            for output in node.outputs:
                node.node.counters.sent[output.port.name] = output.sent

    def unfinished(self) -> list[str]:
        """Return the nodes whose inputs have not ended."""
        return [name for name, n in self.nodes.items() if not n.ended and not n.node.spec.is_source]


def _hearing(nodes: dict[str, SampleNode], asked: set[str]) -> set[str]:
    """Return the nodes that wait for bounds, or lead to one that does, or to one asked for its."""
    hearing = {name for name, node in nodes.items() if node.joins} | asked
    grown = True
    while grown:
        before = len(hearing)
        for name in list(hearing):
            node = nodes[name].node
            hearing |= {wire.node for wire in node.wires.values()}
            hearing |= {gate.wire.node for gate in node.gates}
        grown = len(hearing) > before
    return hearing


def _later(node: SampleNode, index: int) -> tuple[Accept, Advance]:
    """Return calls into a node that is not compiled yet."""
    return lambda message: node.accept[index](message), lambda bound: node.advance[index](bound)
