"""The recorder of a split run: a process that reads all recorded streams and writes one file."""

from __future__ import annotations

import json
import logging
import signal
import threading
from collections import deque
from collections.abc import Callable
from typing import Any

from lodeflow.clock import monotonic
from lodeflow.errors import LodeflowError, RunError
from lodeflow.graph import Wire, dump
from lodeflow.graph.groups import RECORDER
from lodeflow.messages.message import Message
from lodeflow.recording.events import CHANGE, GAP, LOG, in_range
from lodeflow.recording.recorder import Recorder
from lodeflow.runtime.engine import TICK, Engine
from lodeflow.runtime.exchange import Enter, part_of
from lodeflow.runtime.plan import Plan
from lodeflow.runtime.samples import SampleDriver
from lodeflow.supervisor.answers import Answers
from lodeflow.supervisor.group import Tell, open_links, open_window
from lodeflow.supervisor.interrupt import interruptible
from lodeflow.supervisor.setup import Report, Setup
from lodeflow.transport.meeting import Reach, barrier, farewell

GRACE = 1.35
"""Seconds after a stop that the recorder waits for the ends of streams; then it closes the file."""
TOLD = 1.2
"""Seconds after the ends of streams that it waits for what the groups have to tell."""


def run_recorder(setup: Setup, tell: Tell, orders: deque[Any], awake: list[Any]) -> Report:
    """Record until all streams have ended; see `run_group` for the arguments."""
    if setup.recording is None:
        raise RunError("nothing is recorded in this run")
    report = Report()
    reports: dict[str, dict[str, Any]] = {}
    notes: deque[tuple[str, str]] = deque()
    links, close = open_links(
        setup, RECORDER, orders, lambda group, text: notes.append((group, text))
    )
    awake.append(links.wake)
    recorder = Recorder(
        setup.recording.path, graph=dump(setup.graph), provenance=setup.recording.provenance
    )
    kinds = {
        Wire(node.name, port.name): port.type
        for node in setup.graph.nodes.values()
        for port in node.plugin.spec.outputs
    }
    for wire, take in recorder.open(
        {wire: kinds[wire] for wire in setup.parts[RECORDER].inlets}
    ).items():
        links.on_arrival(wire, _into(recorder, take))
    stopping = threading.Event()
    # It runs no node; but like every process of the run it answers questions.
    plan = Plan(part_of(setup.graph, (), {}))
    idle = Engine(plan, exchange=links, samples=setup.samples)
    idle.driver = SampleDriver(plan)
    answers = Answers(
        setup.graph, RECORDER, plan, idle, lambda: tell("stop"), links=links, groups=setup.groups
    )
    window = open_window(setup, RECORDER, plan, answers, links.wake)

    reach = Reach(links, setup.far(RECORDER), logging.getLogger("lodeflow").warning)

    def stop() -> None:
        stopping.set()
        links.wake()

    def write_down() -> None:
        while notes:
            _note(recorder, reports, *notes.popleft())

    def work() -> None:
        links.take()
        write_down()
        answers.tend()
        reach.look()
        if stopping.is_set():
            links.say_stop(setup.far(RECORDER))
        links.flush()
        recorder.keep_up(recorder.reached)

    with interruptible(stop, GRACE, by=(signal.SIGTERM,)) as closing:
        try:
            if barrier(links, stopping.is_set, lambda missing: tell(("waiting", missing))):
                tell("ready")
                while links.is_open():
                    work()
                    links.wait(TICK)
                until = monotonic() + TOLD
                while not _all_told(setup, links, reports) and monotonic() < until:
                    work()
                    links.wait(TICK)
            elif links.has_unread:  # others had begun
                links.break_off()
        except KeyboardInterrupt:
            links.break_off()
        except LodeflowError as error:
            report.error = str(error)
        except Exception as error:
            report.error = f"lodeflow itself failed: {type(error).__name__}: {error}"
            logging.getLogger("lodeflow").exception("in the recorder")
        closing()
        write_down()
        window.close()
        report.lossless = links.lossless
        report.reached = recorder.reached
        report.stopped = stopping.is_set()
        report.links = {peer: losses.as_dict() for peer, losses in links.losses.items()}
        try:
            summary = merged(reports, setup)
            summary["lossless"] = summary["lossless"] and report.lossless
            recorder.close({"summary": json.dumps(summary)})
        except LodeflowError as error:
            report.error = report.error or str(error)
        tell(report)  # now: the file is closed, and whoever hangs may take too long to answer
        farewell(links, 0.3 if report.stopped or report.error else None)
        close()
    return report


def _into(recorder: Recorder, take: Callable[[Message], None]) -> Enter:
    """Return what records the messages of a stream that comes from another group."""

    def enter(message: Any, bound: int) -> None:
        if message is not None:
            take(message)
            last = int(message.t[-1]) if message.is_block else message.t
            recorder.reached = max(recorder.reached, last)

    return enter


def _all_told(setup: Setup, links: Any, reports: dict[str, Any]) -> bool:
    return all(name in reports or links.by_name[name].closed for name in setup.graph.processes)


def _note(recorder: Recorder, reports: dict[str, dict[str, Any]], group: str, text: str) -> None:
    """Write down what a group has to tell."""
    told = json.loads(text)
    if "report" in told:
        reports[group] = told["report"]
    elif "log" in told:
        t, *fields = told["log"]
        recorder.event(LOG, t, *fields)
    elif "gap" in told:
        gap = told["gap"]
        t = in_range(gap["from"])
        recorder.event(GAP, t, gap["stream"], gap["sender"], gap["reader"], gap["from"], gap["to"])
    elif "change" in told:
        change = told["change"]
        recorder.event(CHANGE, change["t"], change["node"], change["use"], change["params"])


def merged(reports: dict[str, dict[str, Any]], setup: Setup) -> dict[str, Any]:
    """Return the summary of a whole run from those of its groups."""
    order = [name for name in setup.graph.processes if name in reports]
    found: dict[str, Any] = {
        "graph": setup.graph.name,
        "streams": {},
        "nodes": {},
        "scores": {},
        "stopped": False,
        "lossless": True,
        "error": None,
        "event_seconds": 0.0,
        "silent_groups": [name for name in setup.graph.processes if name not in reports],
    }
    for name in order:
        one = reports[name]
        for key in ("streams", "nodes", "scores"):
            found[key].update(one[key])
        found["stopped"] = found["stopped"] or one["stopped"]
        found["lossless"] = found["lossless"] and one["lossless"]
        found["error"] = found["error"] or one["error"]
        found["event_seconds"] = max(found["event_seconds"], one["event_seconds"])
    return found
