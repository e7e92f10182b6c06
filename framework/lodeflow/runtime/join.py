"""What the joins of the sample driver share: queues, bounds and gates.

A join is never re-entered: what arrives while a row is being stepped (over a cycle) is queued, and
looked at when the row is done.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from typing import Any

from lodeflow.runtime.plan import PlanNode
from lodeflow.sync import END, NEVER

Run = Callable[[int, tuple[Any, ...]], None]
"""Steps one row: its stamp, and a sample per wired input."""


class Join:
    """One input, perhaps gated; the base of the joins of several.

    Attributes:
        accept: per wired input, then per gate: takes a message.
        advance: likewise: takes a bound.
    """

    def __init__(self, node: PlanNode, run: Run, move: Callable[[int], None], hears: bool) -> None:
        names = [port.name for port in node.wired]
        self.counters = node.counters
        self.lead = names.index(node.lead)
        self.others = [i for i in range(len(names)) if i != self.lead]
        self.queues: list[deque[Any]] = [deque() for _ in names]
        self.bounds = [NEVER] * len(names)
        self.gates = [_Gate(gate.field, gate.allowed) for gate in node.gates]
        self.run = run
        self.deliver: Run = self._hold_back if self.gates else run
        self.pending: deque[tuple[int, tuple[Any, ...]]] = deque()
        self.move, self.hears, self.moved = move, hears, NEVER
        self.busy = self.again = False
        self.accept = [self._acceptor(i) for i in range(len(names))]
        self.advance = [self._advancer(i) for i in range(len(names))]
        for gate in self.gates:
            accept, advance = gate.closures(self.pump)
            self.accept.append(accept)
            self.advance.append(advance)

    def use(self, run: Run) -> None:
        """Step rows by another call from now on."""
        self.run = run
        if not self.gates:
            self.deliver = run

    def _acceptor(self, index: int) -> Callable[[Any], None]:
        append, bounds, pump = self.queues[index].append, self.bounds, self.pump
        first, lead = self.lead, self.queues[self.lead]
        if index == self.lead:

            def accept(message: Any) -> None:
                append(message)
                bounds[index] = message.t + 1
                pump()

        else:

            def accept(message: Any) -> None:
                append(message)
                bounds[index] = message.t + 1
                if lead or bounds[first] == END:
                    pump()  # else no row waits for it, and the floor is the lead's

        return accept

    def _advancer(self, index: int) -> Callable[[int], None]:
        bounds, pump, lead = self.bounds, self.pump, self.queues[self.lead]
        held = index != self.lead

        def advance(bound: int) -> None:
            if bound > bounds[index]:
                bounds[index] = bound
                if lead or not held or bound == END:
                    pump()
                if not held:
                    self.forget(self.moved)

        return advance

    def _meeting(self, index: int, *, early: bool = False) -> Callable[[Any], None]:
        """Return the acceptor of one of two inputs that mostly bring the same stamps.

        A message that meets its partner goes straight on, if nothing waits before the two.

        Args:
            index: of the input.
            early: whether a message moves the floor before its partner has come.
        """
        general = self.accept[index]
        own, other, bounds = self.queues[index], self.queues[1 - index], self.bounds

        def accept(message: Any) -> None:
            t = message.t
            if not other:
                if own or self.busy or bounds[1 - index] > self.moved:
                    general(message)
                    return
                own.append(message)
                bounds[index] = t + 1
                if early and t > self.moved:
                    self._promise(t)
                return
            if own or other[0].t != t or len(other) > 1 or self.busy:
                general(message)
                return
            bounds[index] = t + 1
            self.busy, self.again = True, False
            partner = other.popleft()
            self.deliver(t, (partner, message) if index else (message, partner))
            if not self.again and (floor := self.floor()) != END:
                self.moved = floor
                if self.hears:
                    self.move(floor)
                self.busy = False
                if not self.again:
                    return
            self.busy = False
            self.pump()

        return accept

    def _promise(self, floor: int) -> None:
        """Say that no row comes before a floor that has risen while no row waits."""
        self.busy, self.again, self.moved = True, False, floor
        self.move(floor)
        self.busy = False
        if self.again:
            self.pump()

    def pump(self) -> None:
        """Do all that the bounds decide now."""
        if self.busy:
            self.again = True
            return
        self.busy = True
        while True:
            self.again = False
            self.decide()
            if self.gates:
                self._release()
            if self.again:  # more came over a cycle: no promise before that is decided
                continue
            floor = self.pending[0][0] if self.pending else self.floor()
            if floor == END:
                self.forget(END)
            if floor > self.moved:
                self.moved = floor
                if self.hears or floor == END:
                    self.move(floor)
            if not self.again:
                break
        self.busy = False

    def decide(self) -> None:
        """Deliver the rows that the bounds decide."""
        queue = self.queues[0]
        while queue:
            message = queue.popleft()
            self.deliver(message.t, (message,))

    def floor(self) -> int:
        """Return the stamp below which no later row can lie."""
        queue = self.queues[self.lead]
        floor: int = queue[0].t if queue else self.bounds[self.lead]
        return floor

    def forget(self, floor: int) -> None:
        """Let go of what no row from `floor` on needs, or a silent lead would fill the memory."""
        for gate in self.gates:
            gate.follow(floor)

    def _hold_back(self, t: int, samples: tuple[Any, ...]) -> None:
        self.pending.append((t, samples))

    def _release(self) -> None:
        while self.pending:
            t = self.pending[0][0]
            if any(gate.bound <= t for gate in self.gates):
                return
            opened = [gate.is_open(t) for gate in self.gates]
            t, samples = self.pending.popleft()
            if all(opened):
                self.run(t, samples)
            else:
                self.counters.gated += 1


class _Gate:
    """The last value of a gating stream."""

    def __init__(self, field: str, allowed: frozenset[int]) -> None:
        self.field, self.allowed = field, allowed
        self.queue: deque[Any] = deque()
        self.value: int | None = None
        self.bound = NEVER

    def closures(
        self, pump: Callable[[], None]
    ) -> tuple[Callable[[Any], None], Callable[[int], None]]:
        def accept(message: Any) -> None:
            self.queue.append(message)
            self.bound = message.t + 1
            pump()

        def advance(bound: int) -> None:
            if bound > self.bound:
                self.bound = bound
                pump()

        return accept, advance

    def follow(self, t: int) -> None:
        while self.queue and self.queue[0].t <= t:
            self.value = getattr(self.queue.popleft(), self.field)

    def is_open(self, t: int) -> bool:
        self.follow(t)
        return self.value in self.allowed
