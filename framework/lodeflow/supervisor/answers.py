"""Answers: what a running process says of itself when it is asked over Zenoh."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from lodeflow.clock import monotonic
from lodeflow.errors import RunError, did_you_mean
from lodeflow.graph import Graph, dump
from lodeflow.graph.drawing import draw
from lodeflow.graph.model import Wire
from lodeflow.messages.ros import schema_text
from lodeflow.runtime.engine import Engine
from lodeflow.runtime.plan import Plan
from lodeflow.supervisor.changes import Changes, Tell
from lodeflow.supervisor.meter import Meter, paths, process_usage
from lodeflow.transport import keys


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
        groups: names of all process groups of the run.
    """

    def __init__(
        self,
        graph: Graph,
        group: str,
        plan: Plan,
        engine: Engine,
        stop: Callable[[], None],
        tell: Tell = lambda t, node, use, params: None,
        links: Any = None,
        groups: Sequence[str] = (),
    ) -> None:
        self.group, self.plan, self.engine = group, plan, engine
        self.changes = Changes(graph, plan, engine, tell)
        self.links = links
        self.groups = tuple(groups) or (group,)
        self.stop = stop
        self.meter = Meter(graph, plan)
        self.started = monotonic()
        self.questions: dict[str, Callable[[Mapping[str, Any]], Any]] = {
            "about": self.about,
            "stats": self.stats,
            "graph": lambda asked: {"yaml": dump(self.graph)},
            "drawing": self._drawing,
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
        """Return what runs here: nodes, and streams with their keys, types and definitions."""
        ports = {
            Wire(n.name, port.name): port.type for n in self.plan.mine for port in n.spec.outputs
        }
        return {
            "graph": self.graph.name,
            "group": self.group,
            "groups": list(self.groups),
            "pid": os.getpid(),
            "host": os.uname().nodename,
            "seconds": monotonic() - self.started,
            "nodes": {node.name: self.graph.nodes[node.name].use for node in self.plan.mine},
            "order": list(self.graph.nodes),
            "streams": {
                str(wire): {"key": keys.stream(self.graph.name, wire), "type": kind.ros}
                for wire, kind in ports.items()
            },
            "schemas": {kind.ros: schema_text(kind) for kind in ports.values()},
            "paths": paths(self.graph),
        }

    def stats(self, asked: Mapping[str, Any]) -> dict[str, Any]:
        """Return counters, queues, losses, passings of messages, and what the process uses."""
        links, driver = self.links, self.engine.driver
        by_samples = self.engine.by_samples
        self.engine.count()
        return {
            "group": self.group,
            "pid": os.getpid(),
            "seconds": monotonic() - self.started,
            "first": self.engine.first,
            "last": self.engine.last,
            "reached": self.engine.reached,
            "paced": by_samples,
            **process_usage(),
            "nodes": {
                node.name: {
                    "stepped": node.counters.stepped,
                    "unmatched": node.counters.unmatched,
                    "gated": node.counters.gated,
                    "sent": {
                        str(Wire(node.name, port)): n for port, n in node.counters.sent.items()
                    },
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
            "waiting": {} if driver is None else driver.waiting(),
            "passings": self.meter.passings(float(asked.get("window", 1.0))) if by_samples else {},
        }

    def _drawing(self, asked: Mapping[str, Any]) -> dict[str, Any]:
        """Draw the graph, with a text at each stream that there is one for."""
        return {"drawing": draw(self.graph, asked.get("format", "text"), asked.get("notes", {}))}

    def _stop(self, asked: Mapping[str, Any]) -> dict[str, Any]:
        self.stop()
        return {"stopping": self.group}
