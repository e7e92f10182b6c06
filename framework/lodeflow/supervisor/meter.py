"""Meter: how late messages are where they enter a process and where they end; only while asked."""

from __future__ import annotations

import resource
from collections import deque
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from lodeflow.clock import monotonic, wall_time
from lodeflow.graph import Wire, edges
from lodeflow.graph.model import Graph
from lodeflow.runtime.exchange import Driver
from lodeflow.runtime.plan import Plan

LASTS = 5.0
"""Seconds after a question in which ages are measured."""
KEPT = 4096


class Meter:
    """Ages of messages: wall time less stamp, where they leave a source and where paths end.

    The age at the end of a path less that at its source is the path's latency, also where stamps
    are not wall time, as long as the run keeps their pace.

    Args:
        graph: the whole graph.
        plan: what runs here.
    """

    def __init__(self, graph: Graph, plan: Plan) -> None:
        self._plan = plan
        read = {edge.wire for edge in edges(graph.nodes)}
        sinks = {
            edge.wire for edge in edges(graph.nodes) if not graph.nodes[edge.to].plugin.spec.outputs
        }
        here = [w for w in graph.streams() if plan.nodes.get(w.node) in plan.mine]
        self._starts = [w for w in here if plan.nodes[w.node].spec.is_source]
        self._ends = [w for w in here if w not in read or w in sinks]
        self._ages: dict[Wire, deque[int]] = {
            wire: deque(maxlen=KEPT) for wire in {*self._starts, *self._ends}
        }
        self._taps: dict[Wire, Callable[[Any], None]] = {}
        self._asked = float("-inf")

    def tend(self, driver: Driver | None) -> None:
        """Begin or end measuring; called on the engine's thread."""
        wanted = monotonic() - self._asked < LASTS
        if driver is None or wanted == bool(self._taps):
            return
        if wanted:
            self._taps = {wire: _age_of(ages) for wire, ages in self._ages.items()}
        for wire, tap in list(self._taps.items()):
            taps = self._plan.taps[wire]
            (taps.append if wanted else taps.remove)(tap)
            driver.retap(wire)
        if not wanted:
            self._taps = {}

    def ages(self) -> dict[str, dict[str, Any]]:
        """Return the ages measured since the last question, in ns, and go on measuring."""
        self._asked = monotonic()
        found = {}
        for wire, ages in self._ages.items():
            values = np.array([ages.popleft() for _ in range(len(ages))], dtype=np.int64)
            if len(values):
                p50, p99 = np.percentile(values, [50, 99])
                found[str(wire)] = {
                    "source": wire in self._starts,
                    "count": len(values),
                    "p50": int(p50),
                    "p99": int(p99),
                }
        return found


def _age_of(ages: deque[int]) -> Callable[[Any], None]:
    def measure(message: Any) -> None:
        t = message.t
        ages.append(wall_time() - (t if type(t) is int else int(t[-1])))

    return measure


def process_usage() -> dict[str, float]:
    """Return CPU seconds used and resident bytes of this process."""
    used = resource.getrusage(resource.RUSAGE_SELF)
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return {
        "cpu_seconds": used.ru_utime + used.ru_stime,
        "resident_bytes": pages * resource.getpagesize(),
    }
