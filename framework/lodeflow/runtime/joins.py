"""Joins of the sample driver: how single messages of several inputs meet.

The same rules as `align.py`, row by row.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from lodeflow.runtime.join import Join, Run
from lodeflow.runtime.plan import PlanNode
from lodeflow.sync import END, NEVER, Each, Exact, Hold, Nearest


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
