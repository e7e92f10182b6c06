"""Output of the sample driver: the calls that the messages and bounds of a port lead to."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from lodeflow.messages.message import Message
from lodeflow.node import OutputPort
from lodeflow.runtime.plan import PlanNode, Tap, check_sample
from lodeflow.sync import END, NEVER

Accept = Callable[[Any], None]
Advance = Callable[[int], None]


class Output:
    """An output port: the calls that its messages and bounds lead to.

    Attributes:
        bound: no later message has a stamp below it; a message at t has moved it to t + 1.
        sent: messages sent.
        expected: type of the messages, once the first has been looked at in full.
        forward: hands a message to all taps and readers; `retap` makes it.
        listeners: readers that need to hear of every bound.
        enders: the other readers; they hear of the end alone.
    """

    __slots__ = (
        "_taps",
        "bound",
        "calls",
        "enders",
        "expected",
        "forward",
        "listeners",
        "node",
        "port",
        "sent",
    )

    def __init__(self, node: PlanNode, port: OutputPort, taps: Sequence[Tap]) -> None:
        self.node = node
        self.port = port
        self.bound = NEVER
        self.sent = 0
        self.expected: type[Message] | None = None
        self.forward: Accept = _fan([])
        self.listeners: list[Advance] = []
        self.enders: list[Advance] = []
        self.calls: list[Accept] = []
        self._taps = taps

    def retap(self) -> None:
        """Use the readers and the taps as they are now."""
        self.forward = _fan([*self._taps, *self.calls])

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

    def send(self, message: Any, row: int) -> None:
        """Send a sample for a row at some stamp.

        The first message is looked at in full, later ones as far as is cheap: their type and
        their stamp.

        Raises:
            ContractError: it is no sample of the port, or its stamp is none that may come.
        """
        t = message.t if type(message) is self.expected else None
        if type(t) is not int or t < self.bound or (t < row and t < row - self.node.lookback):
            self._look(message, row)
            t = message.t
        self.bound = t + 1  # the message itself tells its readers
        self.sent += 1
        forward = self.forward
        forward(message)

    def _look(self, message: Any, row: int) -> None:
        check_sample(self.node, self.port, message, row - self.node.lookback, thorough=True)
        self.expected = self.port.type
        if message.t < self.bound:
            raise self.node.broken(
                self.port.name,
                f"stamps must strictly increase, got {message.t} where {self.bound} is the least",
            )


def _fan(calls: list[Accept]) -> Accept:
    """Return one call that makes them all."""
    if not calls:
        return lambda message: None
    if len(calls) == 1:
        return calls[0]
    if len(calls) == 2:
        first, second = calls

        def both(message: Any) -> None:
            first(message)
            second(message)

        return both
    everyone = tuple(calls)

    def each(message: Any) -> None:
        for call in everyone:
            call(message)

    return each
