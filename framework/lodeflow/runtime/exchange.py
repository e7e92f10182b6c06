"""Exchange: what an engine gets from, and owes to, the groups that run elsewhere.

The engine knows no transport. What other groups send enters through stand-ins for the nodes that
run there; what they read leaves through taps.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import suppress
from dataclasses import replace
from functools import partial
from typing import Any, NamedTuple, Protocol

from lodeflow.graph.model import Graph, GraphNode, Wire
from lodeflow.node import Source
from lodeflow.params import Params
from lodeflow.runtime.plan import Inlet
from lodeflow.sync import END, NEVER

Enter = Callable[[Any, int], None]
"""Brings in what came over one stream: a sample, a block with at least one row, or None; and the
bound."""


class Port(Protocol):
    """An output port as its readers elsewhere need to know it.

    Attributes:
        bound: what it has promised.
    """

    bound: int


class Silent:
    """A port that has promised nothing."""

    bound = NEVER


class Driver(Protocol):
    """What an exchange asks of a driver."""

    def port(self, wire: Wire) -> Port:
        """Return an output port."""

    def entry(self, wire: Wire, saw: Callable[[int, int], None]) -> Enter:
        """Return what brings in the messages of a port of a node that runs elsewhere.

        Args:
            wire: the port.
            saw: told of the first and the last stamp of each message.
        """

    def retap(self, wire: Wire) -> None:
        """Use the plan's taps of a port as they are now."""

    def earliest_change(self, name: str) -> int:
        """Return the least stamp, ns, from which on a node can be another one."""

    def change(self, name: str) -> None:
        """Look at the changes of a node, which have been added to."""

    def waiting(self) -> dict[str, int]:
        """Return how many messages wait at each node for others; safe in any thread."""


class Exchange(Protocol):
    """The other groups of a run, as an engine sees them.

    Attributes:
        outlets: streams that other groups read.
    """

    outlets: frozenset[Wire]

    def attach(self, driver: Driver, saw: Callable[[int, int], None]) -> None:
        """Take the driver that what comes is brought in to, and whose bounds are passed on."""

    def take(self) -> bool:
        """Bring in what has come and may be worked on now; return whether anything was."""

    def flush(self) -> None:
        """Pass on what the outlets have sent, and their bounds."""

    def has_room(self) -> bool:
        """Whether all readers keep up; else the sources here are held back."""

    def behind(self) -> int:
        """Return the stamp up to which the other groups have come, for sources to keep step."""

    def is_open(self) -> bool:
        """Whether anything may still come."""

    def wait(self, timeout: float) -> None:
        """Wait until something comes, `wake` is called, or the time is up (seconds)."""

    def wake(self, *, look: bool = True) -> None:
        """End a wait; safe in a signal handler and in any thread.

        Args:
            look: something has been asked for. Else there is only data to bring in.
        """


class Bell:
    """Wakes one thread that waits. A bare lock costs a tenth of an Event, and lets signals in."""

    def __init__(self) -> None:
        self._silent = threading.Lock()
        self._silent.acquire()
        self.wait = partial(self._silent.acquire, True)

    wait: Callable[[float], Any]
    """Wait for `ring`, or until the time is up (seconds)."""

    @property
    def rung(self) -> bool:
        """Whether `wait` would return at once."""
        return not self._silent.locked()

    def ring(self) -> None:
        """End the wait, or the next one; safe in a signal handler and in any thread."""
        if self._silent.locked():
            with suppress(RuntimeError):  # another thread was quicker
                self._silent.release()


class Alone:
    """The exchange of a graph that runs in one process."""

    outlets: frozenset[Wire] = frozenset()

    def __init__(self) -> None:
        self._bell = Bell()

    def attach(self, driver: Driver, saw: Callable[[int, int], None]) -> None:
        """There is nobody to pass bounds on to."""

    def take(self) -> bool:
        """Nothing ever comes."""
        return False

    def flush(self) -> None:
        """There is nobody to pass anything on to."""

    def has_room(self) -> bool:
        """Nobody holds the sources back."""
        return True

    def behind(self) -> int:
        """Nobody is behind."""
        return END

    def is_open(self) -> bool:
        """Nothing will come."""
        return False

    def wait(self, timeout: float) -> None:
        """Wait for `wake`, or until the time is up."""
        self._bell.wait(timeout)

    def wake(self, *, look: bool = True) -> None:
        """End a wait."""
        self._bell.ring()


def stand_in(node: GraphNode, ports: Iterable[str]) -> GraphNode:
    """Return a source in the place of a node that runs elsewhere, with those ports of it."""
    kinds = {p.name: p.type for p in node.plugin.spec.outputs if p.name in set(ports)}
    yielded: Any = NamedTuple("Ports", list(kinds.items()))  # type: ignore[misc]

    def read(self: Source, clock: Any) -> Iterator[Any]:
        raise NotImplementedError

    read.__annotations__["return"] = Iterator[yielded]
    made = type("Elsewhere", (Inlet,), {"read": read})
    return GraphNode(node.name, node.use, made, Params())


def part_of(graph: Graph, nodes: Iterable[str], inlets: Mapping[Wire, Any]) -> Graph:
    """Return the graph of one group: its nodes, and stand-ins for those that they read from."""
    mine = set(nodes)
    ports: dict[str, list[str]] = {}
    for wire in inlets:
        ports.setdefault(wire.node, []).append(wire.port)
    return replace(
        graph,
        nodes={
            name: node if name in mine else stand_in(node, ports[name])
            for name, node in graph.nodes.items()
            if name in mine or name in ports
        },
    )
