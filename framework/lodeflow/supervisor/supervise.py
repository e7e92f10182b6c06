"""Supervisor of a split run: forks a process per group, looks after them, and sums up.

It opens no Zenoh session and starts no thread, so that it can fork at any time: what the graph
needs is imported once, and a child has it at once.
"""

from __future__ import annotations

import os
import selectors
import signal
import sys
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import partial
from pathlib import Path
from types import FrameType, MappingProxyType

from lodeflow.clock import monotonic, seconds
from lodeflow.errors import RunError, did_you_mean
from lodeflow.graph import Graph
from lodeflow.graph.changes import with_change
from lodeflow.graph.groups import RECORDER
from lodeflow.graph.model import Group
from lodeflow.graph.partition import farthest, partition
from lodeflow.runtime.plan import Counters
from lodeflow.supervisor import rundir
from lodeflow.supervisor.child import Child
from lodeflow.supervisor.janitor import Janitor
from lodeflow.supervisor.run import LONGEST, Progress, recording_of
from lodeflow.supervisor.setup import Recording, Report, Setup, digest
from lodeflow.supervisor.summary import Summary

PATIENCE = 1.5
"""Seconds that children have to end after Ctrl-C; then they are killed."""
SHOWN_EVERY = 0.2
"""Seconds between two looks at the progress."""
BACKOFF, BACKOFF_MOST = 0.1, 5.0
"""Seconds until a group is started again; doubled each time."""

Say = Callable[[str, str], None]
"""Prints a line that a group has printed, or that is said of it."""


def supervise(
    graph: Graph,
    *,
    only: Sequence[str] = (),
    listen: Mapping[str, Sequence[str]] = MappingProxyType({}),
    connect: Sequence[str] = (),
    open_to: Mapping[str, Sequence[str]] = MappingProxyType({}),
    outside: Sequence[str] = (),
    config: Path | None = None,
    record: str | None = None,
    speed: float | None = None,
    duration: float | None = None,
    command: Sequence[str] = (),
    say: Say = lambda group, line: None,
    progress: Progress | None = None,
) -> Summary:
    """Run a graph in a process per group.

    Args:
        graph: a checked graph with `processes`.
        only: groups to run here, others run elsewhere; none for all.
        listen: endpoints of each group, for other hosts.
        connect: endpoints on other hosts.
        open_to: endpoints of each group at which other programs can look in.
        outside: endpoints of other programs.
        config: Zenoh configuration file with certificates, users and access control.
        record: path of the recording; None for the graph's own, "" for no recording.
        speed: event time per wall time; None for as fast as the data allows.
        duration: seconds of event time; None for all there is.
        command: arguments of the command line, kept in the recording.
        say: gets what children print, line by line.
        progress: called now and then with the counters of all nodes and the event time reached.

    Returns:
        The summary of the groups that ran here.

    Raises:
        RunError: the run could not start.
    """
    if duration is not None and not 0 < duration < LONGEST:
        raise RunError(f"a duration is above 0 and below {LONGEST} s, got {duration}")
    found = recording_of(graph, record, command, {})
    recording = None if found is None else Recording(found[0], found[2])
    recorded = () if found is None else found[1]
    parts = partition(graph, recorded)
    here = tuple(only) or tuple(parts)
    for name in [*here, *listen, *open_to]:
        if name not in parts:
            near = did_you_mean(name, parts) or f" (groups: {', '.join(parts)})"
            raise RunError(f"no group '{name}' in graph '{graph.name}'{near}")
    samples = speed is not None or any(
        getattr(node.plugin, "max_delay", None) is not None for node in graph.nodes.values()
    )
    setup = Setup(
        graph,
        digest(graph, *recorded, samples, duration),
        parts,
        here,
        rundir.place(graph.name),
        farthest(parts) + 1,
        samples=samples,
        speed=speed,
        duration=None if duration is None else seconds(duration),
        recording=recording,
        listen=listen,
        connect=connect,
        open_to=open_to,
        outside=outside,
        config=config,
        shown=progress is not None,
    )
    return _Supervisor(setup, say, progress or (lambda counters, t: None)).run()


class _Supervisor:
    """The groups of one host, from their start to their end."""

    def __init__(self, setup: Setup, say: Say, progress: Progress) -> None:
        self.setup, self.say, self.progress = setup, say, progress
        self.reached, self.shown = 0, 0.0
        self.counters = {
            node: Counters() for part in setup.here for node in setup.parts[part].nodes
        }
        self.summary = Summary(setup.graph.name)
        self.children: dict[str, Child] = {}
        self.finished: list[str] = []
        self.gone: list[str] = []
        self.due: dict[str, float] = {}
        self.reports: dict[str, Report] = {}
        self.stop_asked = 0
        self.deadline = float("inf")
        self.selector = selectors.DefaultSelector()

    def run(self) -> Summary:
        """Start all groups, wait for them, and sum up."""
        started = monotonic()
        woken, wake = os.pipe()
        for descriptor in (woken, wake):
            os.set_blocking(descriptor, False)
        self.selector.register(woken, selectors.EVENT_READ)
        setup = self.setup
        self.janitor = Janitor(setup.run_dir)  # before there is anything to clear away
        self.own = (woken, wake, *self.janitor.descriptors)
        before = {
            number: signal.signal(number, handler)
            for number, handler in (
                (signal.SIGINT, self._interrupted),
                (signal.SIGTERM, self._interrupted),
                (signal.SIGHUP, self._interrupted),
                (signal.SIGCHLD, lambda *_: None),
            )
        }
        old_wake = signal.set_wakeup_fd(wake, warn_on_full_buffer=False)
        try:
            nodes = [setup.parts[name].nodes for name in setup.here]
            rundir.begin(setup.run_dir, setup.graph.name, setup.here, nodes)
            _warm_up()
            for name in setup.here:
                if not self.stop_asked:
                    self._start(name)
            while self.children or self.due:
                self._look(woken)
        finally:
            for child in self.children.values():  # only if something failed here
                child.signal(signal.SIGKILL)
            signal.set_wakeup_fd(old_wake)
            for number, handler in before.items():
                signal.signal(number, handler)
            self.janitor.dismiss()
            self.selector.close()
            os.close(woken)
            os.close(wake)
        self._sum_up(monotonic() - started)
        return self.summary

    def _interrupted(self, number: int, frame: FrameType | None) -> None:
        self.stop_asked += 1

    def _start(self, name: str) -> None:
        from lodeflow.supervisor.group import run_group
        from lodeflow.supervisor.obituary import run_obituary
        from lodeflow.supervisor.recorder_process import run_recorder

        work = partial(run_recorder, self.setup)
        if name in self.gone:
            work = partial(run_obituary, self.setup, name, self.deadline < float("inf"))
        elif name != RECORDER:
            work = partial(run_group, self.setup, name)
        others = [d for child in self.children.values() for d in child.descriptors]
        child = Child(name, work, (*others, *self.own, self.selector.fileno()))
        self.janitor.add(child.pid)
        self.children[name] = child
        self.selector.register(child.pipe.read, selectors.EVENT_READ, child)
        self.selector.register(child.output, selectors.EVENT_READ, child)
        for other in self.finished:
            child.pipe.send(("finished", other))
        for other in self.gone:
            child.pipe.send(("gone", other))

    def _look(self, woken: int) -> None:
        """Wait for something to happen, and react."""
        now = monotonic()
        until = min([*self.due.values(), self.deadline], default=now + 1.0)
        for key, _ in self.selector.select(max(0.0, min(until - now, 1.0))):
            if key.fd == woken:
                with suppress(BlockingIOError):
                    os.read(woken, 4096)
            elif key.fd == key.data.output:
                self._printed(key.data)
            else:
                self._told(key.data)
        if self.stop_asked and self.deadline == float("inf"):
            self._stop()
        for name, child in list(self.children.items()):
            pid, status = os.waitpid(child.pid, os.WNOHANG)
            if pid:
                self._ended(name, child, os.waitstatus_to_exitcode(status))
        now = monotonic()
        if now > self.deadline:
            for child in self.children.values():
                child.signal(signal.SIGKILL)
        for name, due in list(self.due.items()):
            if now >= due:
                del self.due[name]
                self._start(name)

    def _stop(self) -> None:
        """Ask all groups to end their sources; kill what does not end in time."""
        self.deadline = monotonic() + PATIENCE
        self.due.clear()
        for child in self.children.values():
            child.signal(signal.SIGTERM)

    def _printed(self, child: Child) -> None:
        data = os.read(child.output, 1 << 16)
        if not data:
            self.selector.unregister(child.output)
        *lines, child.rest = (child.rest + data).split(b"\n")
        if not data and child.rest:
            lines, child.rest = [child.rest], b""
        for line in lines:
            self.say(child.name, line.decode("utf-8", "replace"))

    def _told(self, child: Child) -> None:
        for what in child.pipe.receive():
            match what:
                case None:
                    with suppress(KeyError):
                        self.selector.unregister(child.pipe.read)
                case "ready":
                    child.ready = True
                case "stop":
                    self.stop_asked += 1
                case ("changed", node, use, params):
                    changed = with_change(self.setup.graph, node, use, params)
                    self.setup = replace(self.setup, graph=changed)  # for groups started again
                case ("waiting", missing):
                    self.say(child.name, _waiting(missing, self.setup.here))
                case ("reached", t, counters):
                    self.reached = max(self.reached, t)
                    self.counters.update(counters)
                    if (now := monotonic()) - self.shown >= SHOWN_EVERY:
                        self.shown = now
                        self.progress(self.counters, self.reached)
                case Report():
                    child.report = what

    def _ended(self, name: str, child: Child, code: int) -> None:
        """Read what a group has left, and decide what follows."""
        self._drain(child)
        del self.children[name]
        self.janitor.drop(child.pid)
        report = child.report
        child.close()
        if name in self.gone:  # it only told others so
            return
        self.reports[name] = report or Report(error=None)
        if code == 0 and report is not None:
            self.finished.append(name)
            self._tell(("finished", name))
            return
        why = _why(name, code, report)
        group = self.setup.graph.processes.get(name, Group(()))
        if self.stop_asked or self.deadline < float("inf"):
            # With one that had to be killed before it began nothing is lost, but a file left open.
            begun = child.ready or code != -signal.SIGKILL or name == RECORDER
            self._tell(("gone" if begun else "finished", name))
            if begun and (report is None or report.error is not None):
                self.summary.error = self.summary.error or RunError(why)
            return
        count = self.summary.restarts.get(name, 0)
        ended_early = code == -signal.SIGTERM
        if group.restart == "always" or (group.restart == "on-failure" and not ended_early):
            if count < group.limit:
                wait = min(BACKOFF * 2**count, BACKOFF_MOST)
                self.summary.restarts[name] = count + 1
                self.due[name] = monotonic() + wait
                self.say(name, f"{why}; starting it again, without its state, in {wait:g} s")
                return
            why = f"{why}; it was started again {count} times"
        self.gone.append(name)
        self._tell(("gone", name))
        if group.on_crash == "continue" and name != RECORDER:
            self.say(name, f"{why}; the others go on")
            self.reports[name].error = None if group.allow_gaps else why
        else:
            self.summary.error = self.summary.error or RunError(why)
            self._stop()
        if self.setup.far(name):
            self._start(name)

    def _drain(self, child: Child) -> None:
        """Read the pipes of a process that has ended to their ends."""
        registered = self.selector.get_map()
        while child.pipe.read in registered:
            self._told(child)
        while child.output in registered:
            self._printed(child)

    def _tell(self, order: tuple[str, str]) -> None:
        for child in self.children.values():
            child.pipe.send(order)

    def _sum_up(self, wall: float) -> None:
        summary = self.summary
        summary.wall = wall
        summary.stopped = bool(self.stop_asked)
        spans = [
            (report.first, report.reached)
            for report in self.reports.values()
            if report.first is not None
        ]
        if spans:
            first, last = min(a for a, _ in spans), max(b for _, b in spans)
            summary.span = (last - first) / 1e9
        nodes = {n: c for report in self.reports.values() for n, c in report.counters.items()}
        summary.counters = {name: nodes[name] for name in self.setup.graph.nodes if name in nodes}
        for name, report in self.reports.items():
            summary.scores.update(report.scores)
            summary.lossless = summary.lossless and report.lossless
            losses = {peer: found for peer, found in report.links.items() if any(found.values())}
            if losses:
                summary.links[name] = losses
            if report.error is not None and summary.error is None:
                summary.error = RunError(report.error)
        for name in summary.restarts:
            if not self.setup.graph.processes[name].allow_gaps:
                summary.lossless = False
        if self.setup.recording is not None and RECORDER in self.reports:
            summary.recording = self.setup.recording.path


def _warm_up() -> None:
    """Let numba set itself up once, and not in each child: its first call takes long."""
    numba = sys.modules.get("numba")
    if numba is not None:
        numba.njit(lambda x: x)(0)


def _why(name: str, code: int, report: Report | None) -> str:
    if report is not None and report.error is not None:
        return f"group '{name}' failed: {report.error}"
    if code < 0:
        return f"group '{name}' was ended by {signal.Signals(-code).name}"
    return f"group '{name}' ended with code {code}"


def _waiting(missing: Sequence[str], here: Sequence[str]) -> str:
    elsewhere = [name for name in missing if name not in here]
    what = f"waiting for {', '.join(missing)}"
    if elsewhere:
        what += f"; start it on its host: --only {elsewhere[0]}, with --listen or --connect"
    return what
