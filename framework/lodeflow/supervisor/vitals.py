"""Vitals: what two looks at a running graph say of the time between them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np

from lodeflow.supervisor.meter import latencies, unpack


@dataclass(frozen=True)
class NodeVitals:
    """One node.

    Attributes:
        group: its process group.
        stepped: rows per second.
        sent: messages per second, by stream.
        waiting: messages that wait at it for those of other inputs, or in a device's inbox.
        unmatched: rows without partner, since the start.
        gated: rows held back by a gate, since the start.
        lost: messages dropped, by reason, since the start.
    """

    group: str
    stepped: float
    sent: Mapping[str, float]
    waiting: int
    unmatched: int
    gated: int
    lost: Mapping[str, int]


@dataclass(frozen=True)
class ProcessVitals:
    """One process.

    Attributes:
        pid: its number.
        cpu: share of one processor, 1 for all of it.
        memory: resident bytes.
        waiting: frames sent to other groups and not taken yet.
        arrived: frames that have come and not been worked on.
        lost: what its links lost, by what and peer, since the start.
        foreign: messages of strangers on its keys.
    """

    pid: int
    cpu: float
    memory: int
    waiting: int
    arrived: int
    lost: Mapping[str, int]
    foreign: int


@dataclass(frozen=True)
class PathVitals:
    """From a source to where its messages end.

    Attributes:
        source: the node.
        end: a stream that nobody reads, or the input of a sink.
        count: messages measured.
        p50: median latency, s; None where nothing was measured.
        p99: the latency that one in a hundred exceeds, s.
    """

    source: str
    end: str
    count: int
    p50: float | None
    p99: float | None


@dataclass
class Vitals:
    """A running graph over a while.

    Attributes:
        seconds: how long.
        paced: whether it keeps the pace of its stamps; else there are no latencies.
        reached: event time reached, ns.
        nodes: by name, in the order of the graph.
        processes: by group.
        paths: latencies.
        silent: groups that did not answer.
    """

    seconds: float
    paced: bool
    reached: int
    nodes: dict[str, NodeVitals] = field(default_factory=dict)
    processes: dict[str, ProcessVitals] = field(default_factory=dict)
    paths: list[PathVitals] = field(default_factory=list)
    silent: list[str] = field(default_factory=list)

    @property
    def rates(self) -> dict[str, float]:
        """Messages per second of each stream."""
        return {name: rate for node in self.nodes.values() for name, rate in node.sent.items()}

    def as_dict(self) -> dict[str, Any]:
        """Return everything as plain data."""
        return asdict(self)


def vitals(
    about: Mapping[str, Mapping[str, Any]],
    before: Mapping[str, Mapping[str, Any]],
    after: Mapping[str, Mapping[str, Any]],
) -> Vitals:
    """Return what happened between two answers of each process.

    Args:
        about: answers to "about", by group.
        before: earlier answers to "stats".
        after: later ones.
    """
    told = next(iter(about.values()))
    both = [
        (group, before[group], after[group])
        for group in told["groups"]
        if group in after and group in before and before[group]["pid"] == after[group]["pid"]
    ]
    found = Vitals(
        seconds=max((new["seconds"] - old["seconds"] for _, old, new in both), default=0.0),
        paced=any(new["paced"] for _, _, new in both),
        reached=max((new["reached"] for _, _, new in both), default=0),
        silent=[group for group in told["groups"] if group not in after],
    )
    nodes = {}
    for group, old, new in both:
        elapsed = max(new["seconds"] - old["seconds"], 1e-9)
        found.processes[group] = _process(old, new, elapsed)
        for name in new["nodes"]:
            nodes[name] = _node(name, group, old, new, elapsed)
    found.nodes = {name: nodes[name] for name in told["order"] if name in nodes}
    passings: dict[str, dict[str, str]] = {"sources": {}, "ends": {}}
    for _, _, new in both:
        for side, places in new["passings"].items():
            passings[side] |= places
    for source, end in told["paths"]:
        if source in passings["sources"] and end in passings["ends"]:
            found.paths.append(_path(source, end, passings))
    return found


def _node(
    name: str, group: str, old: Mapping[str, Any], new: Mapping[str, Any], elapsed: float
) -> NodeVitals:
    was, now = old["nodes"].get(name, {"stepped": 0, "sent": {}}), new["nodes"][name]
    return NodeVitals(
        group,
        (now["stepped"] - was["stepped"]) / elapsed,
        {
            stream: (count - was["sent"].get(stream, 0)) / elapsed
            for stream, count in now["sent"].items()
        },
        new["waiting"].get(name, 0) + new["inboxes"].get(name, 0),
        now["unmatched"],
        now["gated"],
        now["lost"],
    )


def _process(old: Mapping[str, Any], new: Mapping[str, Any], elapsed: float) -> ProcessVitals:
    links = new["links"]
    return ProcessVitals(
        new["pid"],
        (new["cpu_seconds"] - old["cpu_seconds"]) / elapsed,
        int(new["resident_bytes"]),
        sum(link["waiting"] for link in links.values()),
        sum(link["arrived"] for link in links.values()),
        {
            f"{what} {'by' if what == 'missed' else 'from'} {peer}": link[what]
            for peer, link in links.items()
            for what in ("gaps", "restarts", "undecodable", "missed")
            if link[what]
        },
        new["foreign"],
    )


def _path(source: str, end: str, passings: Mapping[str, Mapping[str, str]]) -> PathVitals:
    took = latencies(unpack(passings["sources"][source]), unpack(passings["ends"][end]))
    if not len(took):
        return PathVitals(source, end, 0, None, None)
    p50, p99 = np.percentile(took, [50, 99]) / 1e9
    return PathVitals(source, end, len(took), float(p50), float(p99))
