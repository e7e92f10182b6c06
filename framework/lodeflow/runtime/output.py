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
        listeners: readers that need to hear of every bound.
        enders: the other readers; they hear of the end alone.
    """

    __slots__ = (
        "_forwarders",
        "_taps",
        "bound",
        "calls",
        "enders",
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
        self.listeners: list[Advance] = []
        self.enders: list[Advance] = []
        self.calls: list[Accept] = []
        self._taps = taps
        self._forwarders: list[Callable[[Accept], None]] = []

    def forwarding(self, replace: Callable[[Accept], None]) -> Accept:
        """Return the call that hands a message to all taps and readers.

        Args:
            replace: takes another such call, when the taps have changed.
        """
        self._forwarders.append(replace)
        return _fan([*self._taps, *self.calls])

    def retap(self) -> None:
        """Use the taps as they are now."""
        for replace in self._forwarders:
            replace(_fan([*self._taps, *self.calls]))

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

    def sender(self) -> Callable[[Any, int], None]:
        """Return the call that sends a sample for a row at some stamp.

        All readers are connected by now. The first message is looked at in full, later ones as
        far as is cheap: their type and their stamp.
        """
        kind, lookback = self.port.type, self.node.lookback
        expected: type[Message] | None = None

        forward: Accept

        def replace(other: Accept) -> None:
            nonlocal forward
            forward = other

        forward = self.forwarding(replace)

        def send(message: Any, row: int) -> None:
            nonlocal expected
            if type(message) is not expected:
                check_sample(self.node, self.port, message, row - lookback, thorough=True)
                expected = kind
            t = message.t
            if type(t) is not int or t < self.bound or t < row - lookback:
                check_sample(self.node, self.port, message, row - lookback, thorough=True)
                raise self.node.broken(
                    self.port.name,
                    f"stamps must strictly increase, got {t} where {self.bound} is the least",
                )
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
