"""The sample driver: single messages go through the graph as direct calls, with least delay.

Every node becomes a few closures over its state: `accept` for the messages of an input, `advance`
for its bound. A chain of nodes is a chain of calls; only joins queue.
"""

from __future__ import annotations

from collections.abc import Callable, Container, Iterator
from typing import Any

from lodeflow.graph.model import Wire
from lodeflow.runtime.exchange import Enter
from lodeflow.runtime.gaps import without
from lodeflow.runtime.join import Join, Run
from lodeflow.runtime.joins import make_join
from lodeflow.runtime.output import Accept, Advance, Output
from lodeflow.runtime.plan import (
    Plan,
    PlanNode,
    Tap,
    last_words,
)
from lodeflow.runtime.stepping import accepting, stepping
from lodeflow.sync import END, NEVER


class SampleNode:
    """A node as closures: `accept` and `advance`, per wired input and then per gate."""

    def __init__(self, node: PlanNode, taps: dict[Wire, list[Tap]]) -> None:
        self.node = node
        self.outputs = [
            Output(node, port, taps[Wire(node.name, port.name)]) for port in node.spec.outputs
        ]
        self.stepped = [output for output in self.outputs if output.port.by_step]
        self.free: list[Output] = []
        self.tied: list[Output] = []
        self.ended = False
        self.last_row = NEVER
        self.joins = node.sync is not None or bool(node.gates)
        self.join: Join | None = None
        self.accept: list[Accept] = []
        self.advance: list[Advance] = []
        self._rerun: Callable[[Run], None] = lambda run: None

    def compile(self, heard: Container[Wire]) -> None:
        """Make the closures, once all readers are connected.

        Args:
            heard: outputs whose bounds somebody waits for; those of others need not be told.
        """
        for output in self.outputs:
            output.retap()
        for output in self.stepped:
            if Wire(self.node.name, output.port.name) in heard:
                is_free = self.node.promises_freely(output.port)
                (self.free if is_free else self.tied).append(output)
        hears = bool(self.free or self.tied)
        if self.node.spec.is_source:
            return
        if self.joins:
            run = self._changing_run()
            self.join = join = make_join(self.node, run, self.move, hears=hears)
            self.accept, self.advance = join.accept, join.advance
            self._rerun = join.use
            return
        lone = self.free[0] if len(self.free) == 1 and not self.tied else None
        accept, put = accepting(self, lone, self.move if hears else None)
        self.accept, self.advance = [accept], [self.move]

        def use(run: Run) -> None:
            def instead(message: Any) -> None:
                row = message.t
                run(row, (message,))
                self.move(row + 1)

            put(instead)

        self._rerun = use
        if self.node.changes:
            use(self._changing_run())

    def _changing_run(self) -> Run:
        """Return the call that steps one aligned row, by the instance whose turn it is."""
        if not self.node.changes:
            return stepping(self)
        due, before = self.node.changes[0].t, stepping(self)

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
                output.send(sample, row)
        for output in self.outputs:
            output.promise(END)


class SampleDriver:
    """Runs a plan on single messages.

    Args:
        plan: live nodes.
        outlets: streams whose bounds others ask for, by `bound`.
    """

    def __init__(self, plan: Plan, outlets: frozenset[Wire] = frozenset()) -> None:
        self.nodes = {name: SampleNode(node, plan.taps) for name, node in plan.nodes.items()}
        heard = _heard(self.nodes, outlets)
        hearing = {wire.node for wire in heard}
        position = {name: index for index, name in enumerate(self.nodes)}
        for name in reversed(self.nodes):  # readers first, so that calls can be bound directly
            node = self.nodes[name]
            for other, output, index in self._readers(node):
                hears = other.joins or other.node.name in hearing
                if position[other.node.name] <= position[name]:  # a delayed wire, leading back
                    (accept, advance), hears = _later(other, index), True
                else:
                    accept, advance = other.accept[index], other.advance[index]
                wire = Wire(node.node.name, output.port.name)
                if spans := other.node.gaps.get(str(wire)):
                    accept = without(accept, spans)
                output.connect(accept, advance, hears=hears)
            node.compile(heard)
        self.outputs = {
            Wire(name, output.port.name): output
            for name, node in self.nodes.items()
            for output in node.outputs
        }
        self.pushes = {
            name: [output.send for output in node.outputs]
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

    def entry(self, wire: Wire, saw: Callable[[int, int], None]) -> Enter:
        """Return what brings in the messages of a port of a node that runs elsewhere."""
        output = self.outputs[wire]
        send, promise = output.send, output.promise

        def enter(message: Any, bound: int) -> None:
            if message is not None:
                t = message.t
                if type(t) is int:
                    saw(t, t)
                    send(message, t)
                else:
                    saw(int(t[0]), int(t[-1]))
                    for index, one in enumerate(t.tolist()):
                        send(message.row(index), one)
            if bound > output.bound:
                promise(bound)

        return enter

    def port(self, wire: Wire) -> Output:
        """Return an output port."""
        return self.outputs[wire]

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


def _heard(nodes: dict[str, SampleNode], asked: frozenset[Wire]) -> set[Wire]:
    """Return the outputs whose bounds a join, there or further on, waits for, or is asked for."""
    heard = set(asked)
    hearing = {name for name, node in nodes.items() if node.joins}
    grown = True
    while grown:
        before = len(heard)
        hearing |= {wire.node for wire in heard}
        for name in hearing:
            node = nodes[name].node
            heard |= {*node.wires.values(), *[gate.wire for gate in node.gates]}
        grown = len(heard) > before
    return heard


def _later(node: SampleNode, index: int) -> tuple[Accept, Advance]:
    """Return calls into a node that is not compiled yet."""
    return lambda message: node.accept[index](message), lambda bound: node.advance[index](bound)
