"""The sample driver: single messages go through the graph as direct calls, with least delay.

Every node becomes a few closures over its state: `accept` for the messages of an input, `advance`
for its bound. A chain of nodes is a chain of calls; only joins queue.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Any

import numpy as np

from lodeflow.graph.model import Wire
from lodeflow.messages.message import Message
from lodeflow.node import OutputPort
from lodeflow.runtime.joins import make_join
from lodeflow.runtime.plan import Plan, PlanNode, Tap, check_output, check_sample, last_words
from lodeflow.sync import END, NEVER, Each, Sparse

Accept = Callable[[Any], None]
Advance = Callable[[int], None]


class Output:
    """An output port: the calls that its messages and bounds lead to."""

    def __init__(self, node: PlanNode, port: OutputPort, taps: Sequence[Tap]) -> None:
        self.node = node
        self.port = port
        self.last = NEVER
        self.bound = NEVER
        self.sent = 0
        self.listeners: list[Advance] = []  # readers that need to hear of every bound
        self.enders: list[Advance] = []  # readers that need to hear of the end alone
        self.calls: list[Accept] = list(taps)

    def connect(self, accept: Accept, advance: Advance, *, hears: bool) -> None:
        """Add a reader."""
        self.calls.append(accept)
        (self.listeners if hears else self.enders).append(advance)

    def promise(self, bound: int) -> None:
        """Move the bound; never back."""
        if bound > self.bound:
            self.bound = bound
            for advance in self.listeners:
                advance(bound)
            if bound == END:
                for advance in self.enders:
                    advance(bound)

    def sender(self) -> Accept:
        """Return the call that sends a sample; all readers are connected by now."""
        forward = _fan(self.calls)

        def send(message: Any) -> None:
            t = message.t
            if t <= self.last:
                raise self.node.broken(
                    self.port.name, f"stamps must strictly increase, got {t} after {self.last}"
                )
            self.last = t
            if t >= self.bound:
                self.bound = t + 1  # the message itself tells its readers
            self.sent += 1
            forward(message)

        return send


def _fan(calls: list[Accept]) -> Accept:
    """Return one call that makes them all."""
    if not calls:
        return lambda message: None
    if len(calls) == 1:
        return calls[0]
    everyone = tuple(calls)

    def each(message: Any) -> None:
        for call in everyone:
            call(message)

    return each


class SampleNode:
    """A node as closures: `accept` and `advance`, per wired input and then per gate."""

    def __init__(self, node: PlanNode, taps: dict[Wire, list[Tap]]) -> None:
        self.node = node
        self.outputs = [
            Output(node, port, taps[Wire(node.name, port.name)]) for port in node.spec.outputs
        ]
        self.stepped = [output for output in self.outputs if output.port.by_step]
        self.ended = False
        self.last_row = NEVER
        self.joins = node.sync is not None or bool(node.gates)
        self.accept: list[Accept] = []
        self.advance: list[Advance] = []
        self.senders: list[Accept] = []

    def compile(self, *, hears: bool) -> None:
        """Make the closures, once all readers are connected.

        Args:
            hears: whether this node, or one downstream, waits for bounds.
        """
        self.senders = [output.sender() for output in self.outputs]
        if self.node.spec.is_source:
            return
        if self.joins:
            join = make_join(self.node, self._run(), self.move, hears=hears)
            self.accept, self.advance = join.accept, join.advance
            return
        single = len(self.stepped) == 1 and not self.node.spec.step_tuple
        if single and len(self.node.spec.inputs) == 1:
            self.accept = [self._direct(hears)]
        else:
            self.accept = [self._alone(hears)]
        self.advance = [self.move]

    def _direct(self, hears: bool) -> Accept:
        """Return the path of one input and one output: every nanosecond counts here."""
        node = self.node
        (output,) = self.stepped
        send = self.senders[self.outputs.index(output)]
        kind = output.port.type
        step, emit, move = self._sample_step(), self._emit, self.move
        counters, lookback = node.counters, node.lookback
        fresh = True

        def accept(message: Any) -> None:
            nonlocal fresh
            row = self.last_row = message.t
            counters.stepped += 1
            try:
                out = step(message)
            except Exception as error:
                raise node.failure("step", row, error) from error
            if out is not None:
                if fresh or type(out) is not kind or out.t < row - lookback:
                    emit(0, out, row)  # the thorough way, which finds what is wrong
                    fresh = False
                else:
                    send(out)
            if hears:
                move(row + 1)

        return accept

    def _alone(self, hears: bool) -> Accept:
        """Return the path of one wired input."""
        run, move = self._run(), self.move

        def accept(message: Any) -> None:
            run(message.t, (message,))
            if hears:
                move(message.t + 1)

        return accept

    def _run(self) -> Callable[[int, tuple[Any, ...]], None]:
        """Return the call that steps one aligned row and sends what comes of it."""
        node, stepped, emit = self.node, self.stepped, self._emit
        step = self._sample_step()
        wired = [port.name in node.wires for port in node.spec.inputs]
        complete, is_tuple = all(wired), node.spec.step_tuple
        counters = node.counters

        def run(t: int, samples: tuple[Any, ...]) -> None:
            self.last_row = t
            counters.stepped += 1
            if not complete:
                present = iter(samples)
                samples = tuple([next(present) if has else None for has in wired])
            try:
                returned = step(*samples)
            except Exception as error:
                raise node.failure("step", t, error) from error
            if returned is None:
                return
            if not is_tuple:
                emit(0, returned, t)
                return
            if not isinstance(returned, tuple) or len(returned) != len(stepped):
                names = ", ".join(output.port.name for output in stepped)
                raise node.broken(names, f"it must return these ports, got {returned!r}")
            for index, message in enumerate(returned):
                if message is not None:
                    emit(index, message, t)

        return run

    def _emit(self, index: int, message: Any, row: int) -> None:
        """Check and send what a step gave for the port `index` of those that steps write."""
        if not self.stepped:
            raise self.node.broken("(none)", f"it declares no output, got {message!r}")
        output = self.stepped[index]
        earliest = row - self.node.lookback
        send = self.senders[self.outputs.index(output)]
        for sample in message if type(message) is list else (message,):
            thorough = output.last == NEVER
            check_sample(self.node, output.port, sample, earliest, thorough=thorough)
            send(sample)

    def _sample_step(self) -> Callable[..., Any]:
        """Return a step on samples, whichever form the plugin has.

        A block step may return any number of rows: none become None, one a sample, more a list.
        """
        plugin: Any = self.node.plugin
        if self.node.spec.has_step:
            step: Callable[..., Any] = plugin.step
            return step
        step_block, rows = plugin.step_block, self._rows
        is_tuple = self.node.spec.step_tuple
        kinds = [port.type for port in self.node.spec.inputs]
        sparse = isinstance(self.node.spec.sync, Each)

        def through_block(*samples: Any) -> Any:
            if sparse:
                returned = step_block(*_sparse(samples, kinds))
            else:
                returned = step_block(*[s if s is None else s.as_block() for s in samples])
            if is_tuple and isinstance(returned, tuple):
                return tuple([rows(index, block) for index, block in enumerate(returned)])
            return rows(0, returned)

        return through_block

    def _rows(self, index: int, block: Any) -> Any:
        if block is None or index >= len(self.stepped):
            return block
        port = self.stepped[index].port
        if type(block) is not port.type or not block.is_block:
            check_output(self.node, port, block)
            raise self.node.broken(port.name, "a block step must send blocks, got a sample")
        count = len(block.t)
        if count == 1:
            return block.row(0)
        return [block.row(i) for i in range(count)] or None

    def move(self, floor: int) -> None:
        """Pass on that no later row will have a stamp below `floor`."""
        for output in self.outputs:
            if self.node.promises_freely(output.port):
                output.promise(floor)
            elif output.port.by_step and self.last_row > NEVER:
                output.promise(self.last_row + 1 - self.node.lookback)
        if floor == END and not self.ended:
            self.ended = True
            self._finish()

    def _finish(self) -> None:
        finish = getattr(self.node.plugin, "finish", None)
        if finish is not None:
            try:
                returned = finish()
            except Exception as error:
                raise self.node.failure("finish", self.last_row, error) from error
            for output, message in last_words(self.node, self.outputs, returned):
                rows = message if message.is_block else message.as_block()
                for i in range(len(rows)):
                    sample = rows.row(i)
                    row = self.last_row if self.last_row > NEVER else sample.t
                    earliest = row - self.node.lookback
                    check_sample(self.node, output.port, sample, earliest, thorough=False)
                    self.senders[self.outputs.index(output)](sample)
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
    """Runs a plan on single messages."""

    def __init__(self, plan: Plan) -> None:
        self.nodes = {name: SampleNode(node, plan.taps) for name, node in plan.nodes.items()}
        hearing = _hearing(self.nodes)
        position = {name: index for index, name in enumerate(self.nodes)}
        for name in reversed(self.nodes):  # readers first, so that calls can be bound directly
            node = self.nodes[name]
            for other, output, index in self._readers(node):
                if position[other.node.name] <= position[name]:  # a delayed wire, leading back
                    output.connect(*_later(other, index), hears=True)
                else:
                    output.connect(
                        other.accept[index],
                        other.advance[index],
                        hears=other.node.name in hearing,
                    )
            node.compile(hears=name in hearing)

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
        self.nodes[source].senders[port](sample)

    def promise(self, source: str, bound: int) -> None:
        """Say that nothing below `bound` will come on any port of a source."""
        for output in self.nodes[source].outputs:
            output.promise(bound)

    def count(self) -> None:
        """Bring the plan's counters of sent messages up to date."""
        for node in self.nodes.values():
            for output in node.outputs:
                node.node.counters.sent[output.port.name] = output.sent

    def unfinished(self) -> list[str]:
        """Return the nodes whose inputs have not ended."""
        return [name for name, n in self.nodes.items() if not n.ended and not n.node.spec.is_source]


def _hearing(nodes: dict[str, SampleNode]) -> set[str]:
    """Return the nodes that wait for bounds, or lead to one that does."""
    hearing = {name for name, node in nodes.items() if node.joins}
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
