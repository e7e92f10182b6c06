"""Meter: when messages pass where paths begin and end in a process; only while somebody asks."""

from __future__ import annotations

import base64
import resource
from collections import deque
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lodeflow.clock import monotonic, seconds, wall_time
from lodeflow.graph import Wire, edges
from lodeflow.graph.model import Graph
from lodeflow.runtime.exchange import Driver
from lodeflow.runtime.plan import Plan

LASTS = 5.0
"""Seconds after a question in which passings are measured."""
KEPT = 4096
"""Passings kept of each place."""


def ends(graph: Graph) -> dict[str, Wire]:
    """Return where paths end: streams that nobody reads, and the inputs of sinks.

    A path ends where a message is sent, or comes to a sink: the name of the stream, or of the
    sink's input, and the stream that is measured.
    """
    nodes = graph.nodes
    read = {edge.wire for edge in edges(nodes)}
    found: dict[str, Wire] = {}
    for node in nodes.values():
        spec = node.plugin.spec
        if not spec.outputs:
            found |= {f"{node.name}.{port}": wire for port, wire in node.inputs.items()}
        elif not spec.is_source:
            wires = [Wire(node.name, port.name) for port in spec.outputs if port.by_step]
            found |= {str(wire): wire for wire in wires if wire not in read}
    return found


def paths(graph: Graph) -> list[tuple[str, str]]:
    """Return every (source, end) where messages of the source lead to the end."""
    before: dict[str, set[str]] = {name: set() for name in graph.nodes}
    for edge in edges(graph.nodes):
        before[edge.to].add(edge.wire.node)
    found = []
    for end, wire in ends(graph).items():
        seen, pending = {wire.node}, [wire.node]
        while pending:
            more = before[pending.pop()] - seen
            seen |= more
            pending += more
        sources = [name for name in graph.nodes if graph.nodes[name].plugin.spec.is_source]
        found += [(name, end) for name in sources if name in seen]
    return found


class Meter:
    """Stamps and wall times of messages, where they leave a source and where paths end.

    Args:
        graph: the whole graph.
        plan: what runs here.
    """

    def __init__(self, graph: Graph, plan: Plan) -> None:
        self._plan = plan
        mine = {node.name for node in plan.mine}
        self._sources = {node.name: deque[Any](maxlen=KEPT) for node in plan.sources}
        self._ends: dict[str, deque[Any]] = {}
        self._places: list[tuple[Wire, deque[Any]]] = [
            (Wire(node.name, port.name), self._sources[node.name])
            for node in plan.sources
            for port in node.spec.outputs
        ]
        for end, wire in ends(graph).items():
            at = wire.node if end == str(wire) else end.split(".")[0]  # a sink, where it runs
            if at in mine:
                self._ends[end] = deque(maxlen=KEPT)
                self._places.append((wire, self._ends[end]))
        self._taps: list[tuple[Wire, Callable[[Any], None]]] = []
        self._asked = float("-inf")

    def tend(self, driver: Driver | None) -> None:
        """Begin or end measuring; called on the engine's thread."""
        wanted = monotonic() - self._asked < LASTS
        if driver is None or wanted == bool(self._taps) or not self._places:
            return
        if wanted:
            self._taps = [(wire, _passing(kept)) for wire, kept in self._places]
        for wire, tap in self._taps:
            taps = self._plan.taps[wire]
            # First in the row: what other taps take is no part of the path.
            taps.insert(0, tap) if wanted else taps.remove(tap)
            driver.retap(wire)
        if not wanted:
            self._taps = []
            for _, kept in self._places:
                kept.clear()

    def passings(self, window: float) -> dict[str, dict[str, str]]:
        """Return what passed in the last seconds, and go on measuring.

        Args:
            window: so many seconds.

        Returns:
            Under "sources", by node, and "ends", by name: see `unpack`.
        """
        self._asked = monotonic()
        since = wall_time() - seconds(window)
        return {
            "sources": {name: _pack(kept, since) for name, kept in self._sources.items()},
            "ends": {name: _pack(kept, since) for name, kept in self._ends.items()},
        }


def _passing(kept: deque[Any]) -> Callable[[Any], None]:
    def note(message: Any) -> None:
        t = message.t
        kept.append((t if type(t) is int else int(t[-1]), wall_time()))

    return note


def _pack(kept: deque[Any], since: int) -> str:
    """Return passings as base64: JSON of that many numbers would hold the run up."""
    passed = np.array(kept.copy(), dtype="<i8").reshape(-1, 2)
    return base64.b64encode(passed[passed[:, 1] >= since].tobytes()).decode()


def unpack(packed: str) -> NDArray[np.int64]:
    """Return passings as (N, 2): stamp and wall time, ns."""
    return np.frombuffer(base64.b64decode(packed), dtype="<i8").reshape(-1, 2)


def latencies(source: NDArray[np.int64], end: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return how long each message at the end of a path took since it left the source, ns.

    Where its stamp is none of the source's (a join follows another input), its delay against the
    stamps is compared to that of the source's last message at or before it; so the run must keep
    the pace of the stamps.

    Args:
        source: (N, 2) stamp and wall time of messages that left the source.
        end: (M, 2) likewise at the end.
    """
    if not len(source) or not len(end):
        return np.empty(0, dtype=np.int64)
    t, first = np.unique(source[:, 0], return_index=True)
    at = np.searchsorted(t, end[:, 0], side="right") - 1
    end, at = end[at >= 0], at[at >= 0]
    took: NDArray[np.int64] = (end[:, 1] - source[first[at], 1]) - (end[:, 0] - t[at])
    return took


def process_usage() -> dict[str, float]:
    """Return CPU seconds used and resident bytes of this process."""
    used = resource.getrusage(resource.RUSAGE_SELF)
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return {
        "cpu_seconds": used.ru_utime + used.ru_stime,
        "resident_bytes": pages * resource.getpagesize(),
    }
