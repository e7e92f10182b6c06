"""The block driver: data at rest goes through the graph as columns, as fast as it can."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from lodeflow.errors import ContractError, LodeflowError, MessageError
from lodeflow.graph.model import Wire
from lodeflow.node import InputPort, OutputPort
from lodeflow.runtime.align import Column, GateColumn, Rows, join_rows, make_aligner
from lodeflow.runtime.exchange import Enter
from lodeflow.runtime.gaps import without
from lodeflow.runtime.plan import (
    RAISED,
    Plan,
    PlanNode,
    Tap,
    check_output,
    check_sample,
    last_words,
)
from lodeflow.sync import END, NEVER, Each, Sparse


class Output:
    """An output port: checks what is sent, and hands it to the columns that read it."""

    def __init__(self, node: PlanNode, port: OutputPort, taps: Sequence[Tap]) -> None:
        self.node = node
        self.port = port
        self.taps = taps
        self.readers: list[tuple[BlockNode, Column]] = []
        self.last = NEVER
        self.bound = NEVER

    def send(self, block: Any, earliest: int) -> None:
        """Send a block; `earliest` is the least stamp that the contract allows."""
        check_output(self.node, self.port, block)
        if not block.is_block:
            raise self.node.broken(self.port.name, "a block step must send blocks, got a sample")
        self.pass_on(block, earliest)

    def pass_on(self, block: Any, earliest: int = NEVER) -> None:
        """Send a block whose form has been looked at."""
        if not len(block):
            return
        t = block.t
        if t[0] <= self.last or (t[1:] <= t[:-1]).any():
            before = np.concatenate([[self.last], t[:-1]])
            at = int(np.argmax(t <= before))
            raise self.node.broken(
                self.port.name,
                f"stamps must strictly increase, got {t[at]} where {before[at] + 1} is the least",
            )
        if t[0] < earliest:
            raise self.node.broken(
                self.port.name,
                f"stamp {t[0]} lies before its row minus the lookback of {self.node.lookback} ns",
            )
        self.last = int(t[-1])
        self.bound = max(self.bound, self.last + 1)
        self.node.counters.sent[self.port.name] += len(block)
        for tap in self.taps:
            tap(block)
        for reader, column in self.readers:
            if spans := reader.node.gaps.get(str(Wire(self.node.name, self.port.name))):
                without(column.push, spans)(block)
            else:
                column.push(block)
            reader.dirty = True

    def promise(self, bound: int) -> None:
        """Move the bound; never back."""
        if bound > self.bound:
            self.bound = bound
            for reader, column in self.readers:
                column.bound = max(column.bound, bound)
                reader.dirty = True


class BlockNode:
    """A node with its columns: aligns, gates, steps and sends what the bounds decide."""

    def __init__(self, node: PlanNode, taps: dict[Wire, list[Tap]], kinds: dict[Wire, Any]) -> None:
        self.node = node
        self.dirty = False
        self.outputs = [
            Output(node, port, taps[Wire(node.name, port.name)]) for port in node.spec.outputs
        ]
        self.stepped = [output for output in self.outputs if output.port.by_step]
        wired = node.wired
        self.columns = {port.name: Column(port.type) for port in wired}
        self.gates = [GateColumn(kinds[g.wire], g.field, g.allowed) for g in node.gates]
        self.finished = node.spec.is_source
        if not node.spec.is_source:
            names = [port.name for port in wired]
            self.aligner = make_aligner(node.sync, list(self.columns.values()), names, node.lead)
        self.pending: list[Rows] = []
        self.last_row = NEVER
        self.failure: LodeflowError | None = None

    def run(self) -> None:
        """Do all that the bounds decide now; nothing more once the node has failed."""
        self.dirty = False
        if self.failure is not None:
            return
        rows, floor = self._gated(self.aligner.take())
        self.node.counters.unmatched, self.aligner.unmatched = (
            self.node.counters.unmatched + self.aligner.unmatched,
            0,
        )
        while self.node.changes and len(rows.t) and rows.t[-1] >= self.node.changes[0].t:
            before = int(np.searchsorted(rows.t, self.node.changes[0].t))
            if before:
                self._step(rows.select(slice(0, before)))
                rows = rows.select(slice(before, None))
            self.node.change()
        if len(rows.t):
            self._step(rows)
            if self.failure is not None:
                return
        for output in self.outputs:
            if self.node.promises_freely(output.port):
                output.promise(floor)
            elif output.port.by_step and self.last_row > NEVER:
                output.promise(self.node.bound_after(output.port, self.last_row))
        if floor == END and not self.finished:
            self._finish()

    def _gated(self, rows: Rows) -> tuple[Rows, int]:
        """Return the rows that the gates let pass now, and the floor of those to come."""
        if not self.gates:
            return rows, self.aligner.floor
        if len(rows.t):
            self.pending.append(rows)
        if not self.pending:
            for gate in self.gates:
                gate.forget(self.aligner.floor)
            return rows, self.aligner.floor
        waiting = join_rows(self.pending)
        count = int(np.searchsorted(waiting.t, min(gate.bound for gate in self.gates)))
        decided, rest = waiting.select(slice(0, count)), waiting.select(slice(count, None))
        self.pending = [rest] if len(rest.t) else []
        floor = int(rest.t[0]) if len(rest.t) else self.aligner.floor
        passes = np.ones(count, dtype=bool)
        for gate in self.gates:
            passes &= gate.is_open(decided.t)
            gate.forget(floor)
        self.node.counters.gated += count - int(passes.sum())
        return (decided if passes.all() else decided.select(passes)), floor

    def _step(self, rows: Rows) -> None:
        columns = iter(rows.columns)
        arguments = [
            next(columns) if port.name in self.node.wires else self._unwired(port, rows)
            for port in self.node.spec.inputs
        ]
        self.last_row = int(rows.t[-1])
        plugin: Any = self.node.plugin
        if self.node.spec.has_block:
            self.node.counters.stepped += len(rows.t)
            try:
                returned = plugin.step_block(*arguments)
            except RAISED as error:
                span = int(rows.t[0]) if len(rows.t) == 1 else f"{rows.t[0]}..{rows.t[-1]}"
                raise self.node.failure("step_block", span, error) from error
            messages = self._by_port(returned)
        else:
            messages = self._loop(plugin.step, arguments, rows)
        earliest = int(rows.t[0]) - self.node.lookback
        for output, message in zip(self.stepped, messages, strict=True):
            if message is not None:
                output.send(message, earliest)

    def _unwired(self, port: InputPort, rows: Rows) -> Any:
        if not isinstance(self.node.spec.sync, Each):
            return None
        return Sparse(port.type.empty(), np.full(len(rows.t), -1), rows.t)

    def _by_port(self, returned: Any) -> Any:
        """Return what a step returned as one message, or None, per port that steps write."""
        if returned is None:
            return (None,) * len(self.stepped)
        if not self.stepped:
            raise self.node.broken("(none)", f"it declares no output, got {returned!r}")
        if not self.node.spec.step_tuple:
            return (returned,)
        if not isinstance(returned, tuple) or len(returned) != len(self.stepped):
            names = ", ".join(output.port.name for output in self.stepped)
            raise self.node.broken(names, f"it must return these ports, got {returned!r}")
        return returned

    def _loop(self, step: Any, arguments: list[Any], rows: Rows) -> list[Any]:
        """Run a sample step over the rows; return a block, or None, per port that steps write.

        If a row fails, what the rows before it sent goes on its way first, as it does live.
        """
        collected: list[list[Any]] = [[] for _ in self.stepped]
        getters = [_row_getter(argument) for argument in arguments]
        lookback = self.node.lookback
        for index, t in enumerate(rows.t.tolist()):
            samples = [get(index) for get in getters]
            self.node.counters.stepped += 1
            try:
                returned = step(*samples)
                if returned is None:
                    continue
                messages = self._by_port(returned)
                for output, into, message in zip(self.stepped, collected, messages, strict=True):
                    if message is not None:
                        first = not into
                        check_sample(self.node, output.port, message, t - lookback, thorough=first)
                        into.append(message)
            except ContractError as error:
                self.failure = error
                break
            except RAISED as error:
                self.failure = self.node.failure("step", t, error)
                break
        return [
            self._stack(output, samples) if samples else None
            for output, samples in zip(self.stepped, collected, strict=True)
        ]

    def _stack(self, output: Output, samples: list[Any]) -> Any:
        try:
            return output.port.type.stack(samples)
        except MessageError as error:
            raise self.node.broken(output.port.name, str(error)) from error

    def _finish(self) -> None:
        self.finished = True
        earliest = self.last_row - self.node.lookback if self.last_row > NEVER else NEVER
        for output, block in last_words(self.node, self.outputs, self.last_row):
            output.send(block, earliest)
        for output in self.outputs:
            output.promise(END)


def _row_getter(argument: Any) -> Any:
    if argument is None:
        return lambda index: None
    return argument.row


class BlockDriver:
    """Runs a plan on blocks."""

    def __init__(self, plan: Plan) -> None:
        kinds = {
            Wire(node.name, port.name): port.type
            for node in plan.nodes.values()
            for port in node.spec.outputs
        }
        built = {name: BlockNode(node, plan.taps, kinds) for name, node in plan.nodes.items()}
        for name, node in plan.nodes.items():
            gates = [(g.wire, c) for g, c in zip(node.gates, built[name].gates, strict=True)]
            inputs = [(node.wires[port], c) for port, c in built[name].columns.items()]
            for wire, column in [*inputs, *gates]:
                for output in built[wire.node].outputs:
                    if output.port.name == wire.port:
                        output.readers.append((built[name], column))
        self.outputs = {name: node.outputs for name, node in built.items()}
        self.sources = {
            name: built[name].outputs for name, node in plan.nodes.items() if node.spec.is_source
        }
        self.nodes = [node for node in built.values() if not node.node.spec.is_source]

    def push(self, source: str, blocks: Sequence[tuple[int, Any]], bound: int) -> None:
        """Bring in blocks of a source, as (port index, block), and promise `bound` on its ports."""
        outputs = self.sources[source]
        for port, block in blocks:
            outputs[port].pass_on(block)
        for output in outputs:
            output.promise(bound)
        self._settle()

    def entry(self, wire: Wire, saw: Callable[[int, int], None]) -> Enter:
        """Return what brings in the messages of a port of a node that runs elsewhere."""
        output = self.port(wire)

        def enter(message: Any, bound: int) -> None:
            if message is not None:
                block = message if message.is_block else message.as_block()
                saw(int(block.t[0]), int(block.t[-1]))
                output.pass_on(block)
            output.promise(bound)
            self._settle()

        return enter

    def port(self, wire: Wire) -> Output:
        """Return an output port."""
        return next(o for o in self.outputs[wire.node] if o.port.name == wire.port)

    def earliest_change(self, name: str) -> int:
        """Return the least stamp, ns, from which on a node can be another one."""
        node = next(node for node in self.nodes if node.node.name == name)
        return max(node.last_row + 1, *[output.bound for output in node.stepped], NEVER + 1)

    def change(self, name: str) -> None:
        """Look at the changes of a node, which have been added to: it does so by itself."""

    def retap(self, wire: Wire) -> None:
        """Use the plan's taps of a port as they are now: its outputs do so by themselves."""

    def waiting(self) -> dict[str, int]:
        """Return how many messages wait at each node for others; safe in any thread."""
        return {
            node.node.name: sum(len(p.t) for c in node.columns.values() for p in list(c.parts))
            for node in self.nodes
        }

    def _settle(self) -> None:
        again = True
        while again:  # more than once only where a cycle leads back
            again = False
            for node in self.nodes:
                if node.dirty:
                    node.run()
                    again = True
        for node in self.nodes:
            if node.failure is not None:
                raise node.failure

    def unfinished(self) -> list[str]:
        """Return the nodes whose inputs have not ended."""
        return [node.node.name for node in self.nodes if not node.finished]
