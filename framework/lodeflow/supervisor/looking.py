"""Looking in: finds running graphs, and asks and watches one of them from outside."""

from __future__ import annotations

import contextlib
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple, Self

from lodeflow.clock import monotonic, sleep
from lodeflow.errors import RunError, did_you_mean
from lodeflow.supervisor import rundir
from lodeflow.supervisor.rundir import Running
from lodeflow.transport.keys import DATA
from lodeflow.transport.onlooker import Onlooker

PATIENCE = 4.0
"""Seconds that processes have to answer the first question."""
SETTLED = 0.3
"""Seconds after the first answer from another host in which further ones are waited for."""
QUIET = 2.0
"""Seconds between two looks whether a run on another host is still there."""


@dataclass(frozen=True)
class Where:
    """Where running graphs are looked for.

    Attributes:
        connect: endpoints of runs or routers; none for the runs of this user on this host.
        config: Zenoh configuration file: certificates, user and password.
    """

    connect: tuple[str, ...] = ()
    config: Path | None = None


class Stream(NamedTuple):
    """A stream of a running graph: its name in the graph, its key, type and process group."""

    name: str
    key: str
    type: str
    group: str


class View:
    """A running graph, seen from outside.

    Attributes:
        graph: its name.
        pid: of the process that answers for it on this host; None on another.
        about: what each process group has said of itself.
        silent: groups that did not answer.
        onlooker: the session.
    """

    def __init__(
        self,
        graph: str,
        onlooker: Onlooker,
        about: dict[str, dict[str, Any]],
        silent: Iterable[str] = (),
        running: Running | None = None,
    ) -> None:
        self.graph, self.onlooker, self.about = graph, onlooker, about
        self.silent = tuple(silent)
        self.running = running
        self.pid = None if running is None else running.pid
        self._looked = monotonic()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.onlooker.close()

    @property
    def streams(self) -> dict[str, Stream]:
        """All streams by name, in the order of the graph."""
        found = {
            name: Stream(name, stream["key"], stream["type"], group)
            for group, about in self.about.items()
            for name, stream in about["streams"].items()
        }
        order = next(iter(self.about.values()))["order"]
        return dict(sorted(found.items(), key=lambda item: order.index(item[0].split(".")[0])))

    def keys(self, name: str) -> list[str]:
        """Return the keys of "node.port", or of all ports of "node".

        Raises:
            RunError: there is no such stream.
        """
        streams = self.streams
        if name in streams:
            return [streams[name].key]
        if ports := [s.key for s in streams.values() if s.name.split(".")[0] == name]:
            return ports
        known = did_you_mean(name, streams) or f" (streams: {', '.join(streams) or 'none'})"
        silent = f" (no answer from: {', '.join(self.silent)})" if self.silent else ""
        raise RunError(f"no stream '{name}' in graph '{self.graph}'{known}{silent}")

    def ask(self, what: str, timeout: float = PATIENCE, **details: Any) -> dict[str, Any]:
        """Ask all processes of the run; return the answer of each group that gave one.

        Raises:
            RunError: one refuses.
        """
        answers = self.onlooker.ask(what, graph=self.graph, timeout=timeout, **details)
        for answer in answers:
            if answer.error:
                raise RunError(f"{self.graph}, group '{answer.group}': {answer.error}")
        return {answer.group: answer.told for answer in answers}

    def is_over(self) -> bool:
        """Whether the run has ended, or its processes are gone. Call it when nothing comes."""
        if self.running is not None:
            return not (rundir.is_alive(self.running.pid) and self.running.path.exists())
        if monotonic() - self._looked < QUIET:
            return False
        self._looked = monotonic()
        return not self.ask("about", timeout=PATIENCE / 2)


def split_name(text: str) -> tuple[str | None, str]:
    """Return graph and stream of "[GRAPH/]NODE[.PORT]"; for a key, None and the key.

    A key has two slashes or more, or a wildcard.
    """
    if is_key(text):
        return None, text
    graph, slash, stream = text.rpartition("/")
    return (graph if slash else None), stream


def is_key(text: str) -> bool:
    """Whether a text is a key expression and no name."""
    return text.count("/") > 1 or "*" in text


def graph_of(key: str) -> str | None:
    """Return the graph that a key expression names; None if it names none, or several."""
    first, _, rest = key.partition("/")
    graph = rest.partition("/")[0]
    return graph if first == DATA and graph and "*" not in graph else None


def runs(where: Where, wanted: str | None = None) -> list[View]:
    """Open a view of each running graph of some name, or of all.

    Args:
        where: where to look.
        wanted: name of a graph, or "name@pid".

    Raises:
        RunError: there is none; it says which there are.
    """
    if where.connect:
        return _elsewhere(where, wanted)
    return [_open(run, where) for run in _here(wanted)]


def run(where: Where, wanted: str | None = None) -> View:
    """Open a view of the one running graph of some name, or of the only one there is.

    Raises:
        RunError: there is none, or there are several; it names them.
    """
    if where.connect:
        views = _elsewhere(where, wanted)
        if len(views) > 1:
            views[0].onlooker.close()
            raise RunError(f"several graphs run: {', '.join(v.graph for v in views)}; name one")
        return views[0]
    chosen = _here(wanted)
    if len(chosen) > 1:
        names = [run.graph for run in chosen]
        shown = [run.graph if names.count(run.graph) == 1 else label(run) for run in chosen]
        raise RunError(f"several graphs run: {', '.join(shown)}; name one")
    return _open(chosen[0], where)


def _here(wanted: str | None) -> list[Running]:
    """Return the runs on this host of some name, or all; at least one."""
    there = list(rundir.running())
    chosen = [run for run in there if wanted is None or wanted in (run.graph, label(run))]
    if not chosen:
        raise RunError(_none(wanted, [(run.graph, label(run)) for run in there]))
    return chosen


def label(run: Running) -> str:
    """Return what tells a run from others of the same graph: "name@pid"."""
    return f"{run.graph}@{run.pid}"


def _none(wanted: str | None, there: Sequence[tuple[str, str]]) -> str:
    if not there:
        return (
            "no graph is running here; 'lodeflow run' starts one, and --connect ENDPOINT looks "
            "into one on another host"
        )
    names = list(dict.fromkeys(graph for graph, _ in there))
    near = did_you_mean(str(wanted), [*names, *(label for _, label in there)])
    return f"no graph '{wanted}' is running{near} (running: {', '.join(names)})"


def _open(running: Running, where: Where) -> View:
    """Open a view of a run on this host."""
    onlooker = Onlooker(running.endpoints, where.config)
    try:
        about = _about(onlooker, running.graph, set(running.groups))
        if not about:
            raise RunError(
                f"'{running.graph}' (pid {running.pid}) does not answer: it has just ended, does "
                "not move, or wants a --zenoh-config like its own"
            )
    except BaseException:
        onlooker.close()
        raise
    silent = [name for name in running.groups if name not in about]
    return View(running.graph, onlooker, about, silent, running)


def _about(onlooker: Onlooker, graph: str, expected: set[str]) -> dict[str, dict[str, Any]]:
    """Ask until all have answered: links to their processes come up one by one."""
    until = monotonic() + PATIENCE
    about: dict[str, dict[str, Any]] = {}
    while not expected <= set(about) and (left := until - monotonic()) > 0:
        for answer in onlooker.ask("about", graph=graph, timeout=left):
            if _is_about(answer.told):
                about[answer.group] = answer.told
        sleep(0.01)
    return about


def _elsewhere(where: Where, wanted: str | None) -> list[View]:
    """Open a view of each graph that answers at some endpoints, over one session."""
    onlooker = Onlooker(where.connect, where.config)
    until, first = monotonic() + PATIENCE, True
    found: dict[str, dict[str, dict[str, Any]]] = {}
    try:
        while (left := until - monotonic()) > 0:
            for answer in onlooker.ask("about", timeout=left):
                if not _is_about(answer.told):
                    continue
                groups = found.setdefault(answer.graph, {})
                before = groups.setdefault(answer.group, answer.told)
                if before["pid"] != answer.told["pid"] or before["host"] != answer.told["host"]:
                    raise RunError(
                        f"two runs of graph '{answer.graph}' answer there; connect to endpoints "
                        "of one of them only"
                    )
            if found and first:
                until, first = min(until, monotonic() + SETTLED), False
            if found and all(_is_whole(groups) for groups in found.values()):
                break
            sleep(0.02)
        if not found:
            ends = ", ".join(where.connect)
            raise RunError(f"no running graph answers at {ends}")
        chosen = [graph for graph in found if wanted in (None, graph)]
        if not chosen:
            raise RunError(_none(wanted, [(graph, graph) for graph in found]))
    except BaseException:
        onlooker.close()
        raise
    return [View(g, onlooker, found[g], _silent(found[g])) for g in chosen]


def _is_about(told: Any) -> bool:
    """Whether an answer is one of ours: strangers may answer on any key."""
    wanted = {"graph", "pid", "host", "groups", "order", "streams", "paths"}
    return isinstance(told, dict) and wanted <= told.keys()


def _silent(about: dict[str, dict[str, Any]]) -> list[str]:
    return [name for name in next(iter(about.values()))["groups"] if name not in about]


def _is_whole(about: dict[str, dict[str, Any]]) -> bool:
    return not _silent(about)


def close(views: Iterable[View]) -> None:
    """Close the sessions of several views."""
    for onlooker in {id(view.onlooker): view.onlooker for view in views}.values():
        with contextlib.suppress(RunError):
            onlooker.close()
