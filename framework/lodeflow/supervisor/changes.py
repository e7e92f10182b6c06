"""Changes of a running graph: checked like a graph file, and in force from one event time on."""

from __future__ import annotations

import json
import threading
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from lodeflow.clock import monotonic
from lodeflow.errors import GraphError, LodeflowError, RunError
from lodeflow.graph import Graph, GraphNode, dump, load_graph_text
from lodeflow.graph.changes import changed_nodes
from lodeflow.runtime.engine import Engine
from lodeflow.runtime.exchange import Driver
from lodeflow.runtime.plan import Change, Plan, PlanNode
from lodeflow.sync import NEVER

PATIENCE = 2.0
"""Seconds that a change may wait for the run, and a run that is held for its order to go on."""

Tell = Callable[[int, str, str, str], None]
"""Told of each change: stamp, node, plugin, and parameters as JSON."""


class Changes:
    """Takes orders on the window's thread, and carries them out on the engine's.

    A change of nodes in one process is made at once. Where several processes take part, each
    first holds its run ("prepare"), tells the earliest stamp that it can still change at, and
    goes on with the order to change at the greatest of them ("commit").

    Args:
        graph: the whole graph, as it is now.
        plan: what runs here.
        engine: that runs it.
        tell: told of each change that was made.
    """

    def __init__(self, graph: Graph, plan: Plan, engine: Engine, tell: Tell) -> None:
        self.graph = graph
        self._plan, self._engine, self._tell = plan, engine, tell
        self._orders: deque[_Order] = deque()

    def answer(self, asked: Mapping[str, Any]) -> dict[str, Any]:
        """Carry out {"sets": [...], "swaps": [...], "phase": "now" | "prepare"}.

        Returns:
            {"nodes": what changes here, "t": from when on}; after "prepare" the run is held until
            "commit" with a stamp, "abort", or for `PATIENCE`.

        Raises:
            GraphError: the graph would not check; nothing has changed.
            RunError: a node cannot be changed while it runs, or the run does not react.
        """
        phase = asked.get("phase", "now")
        if phase in ("commit", "abort"):
            return self._go_on(asked)
        new = load_graph_text(
            dump(self.graph),
            filename=f"graph '{self.graph.name}', running",
            sets=_texts(asked, "sets"),
            swaps=_texts(asked, "swaps"),
        )
        found = changed_nodes(self.graph, new)
        if not found:
            raise RunError("nothing would change: the nodes are like this already")
        mine = [node for node in found if node.name in {n.name for n in self._plan.mine}]
        problems = [why for node in mine if (why := _obstacle(self._plan.nodes[node.name], node))]
        if problems:
            raise GraphError(problems)
        order = _Order(new, [self._started(node) for node in mine], hold=phase == "prepare")
        if not mine and phase == "now":  # it changes in another process; here it is only known
            self.graph = new
            return {"nodes": [], "t": int(asked.get("t", NEVER)), "notes": []}
        self._orders.append(order)
        self._engine.exchange.wake()
        if not order.reached.wait(PATIENCE):
            order.aborted = True
            raise RunError(f"the run did not react within {PATIENCE:g} s; nothing has changed")
        if order.error is not None:
            raise order.error
        return {"nodes": [node.name for node in mine], "t": order.t, "notes": list(new.notes)}

    def tend(self) -> None:
        """Carry out orders; called on the engine's thread, between batches."""
        driver = self._engine.driver
        while self._orders and driver is not None:
            order = self._orders[0]
            if not order.aborted:
                order.t = self._earliest(order, driver)
                if order.hold:
                    order.reached.set()
                    order.released.wait(PATIENCE)  # the run is held: nothing moves meanwhile
                    if order.released.is_set() and not order.aborted:
                        self._apply(order, driver)
                    order.done.set()
                else:
                    self._apply(order, driver)
                    order.reached.set()
            self._orders.popleft()

    def _go_on(self, asked: Mapping[str, Any]) -> dict[str, Any]:
        order = next(iter(self._orders), None)
        if order is None or not order.hold or not order.reached.is_set():
            raise RunError("no change is waiting; it may have waited for too long")
        if asked["phase"] == "abort":
            order.aborted = True
        else:
            order.t = int(asked["t"])
        order.released.set()
        order.done.wait(PATIENCE)
        if order.error is not None:
            raise order.error
        return {"t": order.t}

    def _earliest(self, order: _Order, driver: Driver) -> int:
        return max(
            [driver.earliest_change(node.name) for node, _ in order.nodes],
            default=self._engine.reached,
        )

    def _apply(self, order: _Order, driver: Driver) -> None:
        try:
            earliest = self._earliest(order, driver)
            if order.nodes and order.t < earliest:
                raise RunError(
                    f"t={order.t} is past: the earliest stamp that can still change is {earliest}"
                )
            for node, plugin in order.nodes:
                self._plan.nodes[node.name].changes.append(Change(order.t, node, plugin))
                driver.change(node.name)
                params = order.graph.document["nodes"][node.name].get("params") or {}
                self._tell(order.t, node.name, node.use, json.dumps(params))
            self.graph = order.graph
        except LodeflowError as error:
            order.error = error

    def _started(self, node: GraphNode) -> tuple[GraphNode, Any]:
        try:
            plugin: Any = node.plugin(node.params, name=node.name)
            plugin.start()
        except (Exception, SystemExit) as error:
            raise RunError(
                f"'{node.name}': {node.use} does not start: {type(error).__name__}: {error}"
            ) from error
        return node, plugin


class _Order:
    """A change that waits for the engine."""

    def __init__(self, graph: Graph, nodes: list[tuple[GraphNode, Any]], *, hold: bool) -> None:
        self.graph, self.nodes, self.hold = graph, nodes, hold
        self.t = NEVER
        self.aborted = False
        self.error: LodeflowError | None = None
        self.reached = threading.Event()
        self.released = threading.Event()
        self.done = threading.Event()
        self.asked = monotonic()


def _texts(asked: Mapping[str, Any], name: str) -> Sequence[str]:
    found = asked.get(name, [])
    if not isinstance(found, list) or not all(isinstance(text, str) for text in found):
        raise RunError(f"{name} should be a list of texts, got {found!r}")
    return found


def _obstacle(now: PlanNode, node: GraphNode) -> str | None:
    """Return why a node cannot become another one while it runs."""
    old, new = now.spec, node.plugin.spec
    if new.is_source or old.is_source:
        return f"'{node.name}' is a source; what it reads cannot be changed while it runs"
    if old.inputs != new.inputs or old.outputs != new.outputs:
        return f"'{node.name}': {node.use} has other ports than what runs"
    if old.sync != new.sync:
        return (
            f"'{node.name}': the inputs of {node.use} meet in another way than those of what runs"
        )
    if (was := now.lookback) != (will := node.plugin(node.params).lookback):  # type: ignore[union-attr]
        return f"'{node.name}': the lookback would change from {was} to {will} ns"
    return None
