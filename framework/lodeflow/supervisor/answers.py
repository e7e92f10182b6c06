"""Answers: what a running process says of itself when it is asked over Zenoh."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from typing import Any

from lodeflow.clock import monotonic
from lodeflow.errors import RunError, did_you_mean
from lodeflow.graph import Graph, dump
from lodeflow.messages.ros import schema_text
from lodeflow.runtime.engine import Engine
from lodeflow.runtime.plan import Plan
from lodeflow.supervisor.changes import Changes, Tell
from lodeflow.supervisor.meter import Meter, process_usage


class Answers:
    """Answers the questions of other processes; called on the window's thread.

    Args:
        graph: the whole graph.
        group: what runs here.
        plan: its nodes.
        engine: that runs them.
        stop: asks the run to stop.
        tell: told of each change that was made.
        links: the links to other groups, if there are any.
    """

    def __init__(
        self,
        graph: Graph,
        group: str,
        plan: Plan,
        engine: Engine,
        stop: Callable[[], None],
        tell: Tell,
        links: Any = None,
    ) -> None:
        self.group, self.plan, self.engine = group, plan, engine
        self.changes = Changes(graph, plan, engine, tell)
        self.links = links
        self.stop = stop
        self.meter = Meter(graph, plan)
        self.started = monotonic()
        self.questions: dict[str, Callable[[Mapping[str, Any]], Any]] = {
            "about": self.about,
            "stats": self.stats,
            "graph": lambda asked: {"yaml": dump(self.graph)},
            "stop": self._stop,
            "change": self.changes.answer,
        }

    @property
    def graph(self) -> Graph:
        """The graph as it is now."""
        return self.changes.graph

    def tend(self) -> None:
        """Do what was asked for; called on the engine's thread, between batches."""
        self.changes.tend()
        self.meter.tend(self.engine.driver)

    def __call__(self, asked: Mapping[str, Any]) -> Any:
        """Answer {"ask": what, ...}.

        Raises:
            RunError: nobody knows the question.
        """
        what = asked.get("ask")
        if what not in self.questions:
            near = did_you_mean(str(what), self.questions)
            raise RunError(f"no question {what!r}{near} (questions: {', '.join(self.questions)})")
        return self.questions[what](asked)

    def about(self, asked: Mapping[str, Any]) -> dict[str, Any]:
        """Return what runs here: nodes, and streams with their types and definitions."""
        return {
            "graph": self.graph.name,
            "group": self.group,
            "pid": os.getpid(),
            "nodes": {node.name: self.graph.nodes[node.name].use for node in self.plan.mine},
            "streams": {
                f"{node.name}/{port.name}": {
                    "type": port.type.ros,
                    "schema": schema_text(port.type),
                }
                for node in self.plan.mine
                for port in node.spec.outputs
            },
        }

    def stats(self, asked: Mapping[str, Any]) -> dict[str, Any]:
        """Return counters, queues, losses, ages of messages, and what the process uses."""
        links = self.links
        if self.engine.driver is not None:
            self.engine.count()
        return {
            "group": self.group,
            "pid": os.getpid(),
            "seconds": monotonic() - self.started,
            "reached": self.engine.reached,
            "paced": self.engine.by_samples,
            **process_usage(),
            "nodes": {
                node.name: {
                    "stepped": node.counters.stepped,
                    "unmatched": node.counters.unmatched,
                    "gated": node.counters.gated,
                    "sent": dict(node.counters.sent),
                    "lost": dict(node.counters.lost),
                }
                for node in self.plan.mine
            },
            "inboxes": {feed.node.name: len(feed.inbox) for feed in self.engine.inboxes},
            "links": {}
            if links is None
            else {
                link.peer: {
                    "waiting": link.waiting,
                    "arrived": len(link.arrived),
                    "sent_again": link.sent_again,
                    **links.losses[link.peer].as_dict(),
                }
                for link in links.links.values()
            },
            "foreign": 0 if links is None else links.foreign,
            "ages": self.meter.ages(),
        }

    def _stop(self, asked: Mapping[str, Any]) -> dict[str, Any]:
        self.stop()
        return {"stopping": self.group}
