"""Joins of the sample driver: how single messages of several inputs meet.

The same rules as `align.py`, row by row. A join is never re-entered: what arrives while a row is
being stepped (over a cycle) is queued, and looked at when the row is done.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from typing import Any

from lodeflow.runtime.plan import PlanNode
from lodeflow.sync import END, NEVER, Each, Exact, Hold, Nearest

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
                if own or early or bounds[1 - index] > self.moved:
                    general(message)
                else:
                    own.append(message)
                    bounds[index] = t + 1
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


class ExactJoin(Join):
    """Stamps that all inputs share."""

    def __init__(self, *args: Any) -> None:
        super().__init__(*args)
        if len(self.queues) == 2:
            self.decide = self._decide_two  # type: ignore[method-assign]
            if not self.gates:
                self.accept = [self._meeting(0, early=self.hears), self._meeting(1)]

    def decide(self) -> None:
        lead, bounds, queues = self.queues[0], self.bounds, self.queues
        while lead:
            t = lead[0].t
            for i in self.others:
                queue = queues[i]
                while queue and queue[0].t < t:
                    queue.popleft()
                if queue and queue[0].t == t:
                    continue
                if bounds[i] <= t:
                    return
                lead.popleft()
                self.counters.unmatched += 1
                break
            else:
                self.deliver(t, tuple([queue.popleft() for queue in queues]))

    def _decide_two(self) -> None:
        """The common case, the same rule."""
        lead, other = self.queues
        while lead:
            t = lead[0].t
            while other and other[0].t < t:
                other.popleft()
            if other and other[0].t == t:
                self.deliver(t, (lead.popleft(), other.popleft()))
            elif self.bounds[1] <= t:
                return
            else:
                lead.popleft()
                self.counters.unmatched += 1

    def floor(self) -> int:
        queue = self.queues[0]
        floor: int = queue[0].t if queue else self.bounds[0]
        if END not in self.bounds:
            return floor
        for i, queue in enumerate(self.queues):
            if self.bounds[i] == END:
                while queue and queue[0].t < floor:
                    queue.popleft()
                if not queue:
                    return END
        return floor

    def forget(self, floor: int) -> None:
        super().forget(floor)
        for i in self.others:
            queue = self.queues[i]
            while queue and queue[0].t < floor:
                queue.popleft()


class NearestJoin(Join):
    """The nearest message of every other input, within a distance."""

    def __init__(self, *args: Any, within: int) -> None:
        super().__init__(*args)
        self.within = within

    def decide(self) -> None:
        lead = self.queues[self.lead]
        while lead:
            t = lead[0].t
            samples: list[Any] = [None] * len(self.queues)
            samples[self.lead] = lead[0]
            matched = True
            for i in self.others:
                best, distance = self._best(i, t)
                if self.bounds[i] < t + distance:
                    return
                samples[i] = best
                matched = matched and best is not None
            lead.popleft()
            if matched:
                self.deliver(t, tuple(samples))
            else:
                self.counters.unmatched += 1

    def forget(self, floor: int) -> None:
        super().forget(floor)
        for i in self.others:
            queue = self.queues[i]
            while len(queue) > 1 and queue[1].t <= floor:
                queue.popleft()

    def _best(self, i: int, t: int) -> tuple[Any, int]:
        """Return the nearest message so far and its distance; None, within + 1 if none is near."""
        queue = self.queues[i]
        while len(queue) > 1 and queue[1].t <= t:
            queue.popleft()
        best, least = None, self.within + 1
        for k in range(min(2, len(queue))):
            distance = abs(queue[k].t - t)
            if distance < least:
                best, least = queue[k], distance
        return best, least


class HoldJoin(Join):
    """The last value of every other input at, or strictly before, the lead's stamp."""

    def __init__(self, *args: Any, initial: list[Any], delay: bool) -> None:
        super().__init__(*args)
        self.values = initial
        self.ahead = 0 if delay else 1  # a value at the lead's own stamp counts without delay

    def decide(self) -> None:
        lead, ahead, values = self.queues[self.lead], self.ahead, self.values
        while lead:
            message = lead[0]
            limit = message.t + ahead
            for i in self.others:
                if self.bounds[i] < limit:
                    return
            lead.popleft()
            for i in self.others:
                queue = self.queues[i]
                while queue and queue[0].t < limit:
                    values[i] = queue.popleft()
            values[self.lead] = message
            if any(values[i] is None for i in self.others):
                self.counters.unmatched += 1
            else:
                self.deliver(message.t, tuple(values))

    def forget(self, floor: int) -> None:
        super().forget(floor)
        for i in self.others:
            queue = self.queues[i]
            while queue and queue[0].t < floor + self.ahead:
                self.values[i] = queue.popleft()


class EachJoin(Join):
    """Every distinct stamp of any input."""

    def __init__(self, *args: Any) -> None:
        self.limit = NEVER  # the least bound when it was last looked at
        super().__init__(*args)
        if len(self.queues) == 2:
            self.decide = self._decide_two  # type: ignore[method-assign]
            if not self.gates:
                self.accept = [self._meeting(i) for i in range(2)]

    def _acceptor(self, index: int) -> Callable[[Any], None]:
        append, bounds, pump = self.queues[index].append, self.bounds, self.pump

        def accept(message: Any) -> None:
            append(message)
            bounds[index] = message.t + 1
            if min(bounds) > self.limit:  # else another input holds the rows back
                pump()

        return accept

    def _advancer(self, index: int) -> Callable[[int], None]:
        bounds, pump = self.bounds, self.pump

        def advance(bound: int) -> None:
            if bound > bounds[index]:
                bounds[index] = bound
                if min(bounds) > self.limit:
                    pump()

        return advance

    def decide(self) -> None:
        limit = min(self.bounds)
        while True:
            t = min([queue[0].t for queue in self.queues if queue], default=END)
            if t >= limit:
                return
            row = [q.popleft() if q and q[0].t == t else None for q in self.queues]
            self.deliver(t, tuple(row))

    def _decide_two(self) -> None:
        """The common case, the same rule."""
        first, second = self.queues
        bounds = self.bounds
        while True:
            a = first[0].t if first else END
            b = second[0].t if second else END
            t = a if a < b else b
            if t >= bounds[0] or t >= bounds[1]:
                return
            x = first.popleft() if a == t else None
            self.deliver(t, (x, second.popleft() if b == t else None))

    def floor(self) -> int:
        self.limit = min(self.bounds)
        return self.limit


def make_join(node: PlanNode, run: Run, move: Callable[[int], None], *, hears: bool) -> Join:
    """Return the join of a node's wired inputs and gates."""
    match node.sync:
        case Exact():
            return ExactJoin(node, run, move, hears)
        case Nearest(_, within):
            return NearestJoin(node, run, move, hears, within=within)
        case Hold() as sync:
            initial = [sync.first(port.name) for port in node.wired]
            return HoldJoin(node, run, move, hears, initial=initial, delay=sync.delay)
        case Each():
            return EachJoin(node, run, move, hears)
        case None:
            return Join(node, run, move, hears)
