"""One process of a split run: a group of nodes, linked to the other groups."""

from __future__ import annotations

import json
import logging
import signal
from collections import deque
from collections.abc import Callable
from typing import Any

from lodeflow.clock import monotonic
from lodeflow.errors import LodeflowError, RunError
from lodeflow.recording.events import in_range, log_fields
from lodeflow.runtime.engine import Engine
from lodeflow.runtime.exchange import part_of
from lodeflow.runtime.plan import Plan
from lodeflow.supervisor.answers import Answers
from lodeflow.supervisor.interrupt import interruptible, interruption
from lodeflow.supervisor.run import keep_scores
from lodeflow.supervisor.rundir import link_socket, look_socket
from lodeflow.supervisor.setup import Report, Setup
from lodeflow.supervisor.summary import Summary
from lodeflow.transport.links import Links
from lodeflow.transport.meeting import Reach, barrier, farewell
from lodeflow.transport.session import LINKS, close_session, open_session
from lodeflow.transport.window import Window

LOOK_EVERY = 0.005
"""Seconds between looks at what else there is to do than to work on messages."""
PATIENCE = 0.3
"""Seconds that a group waits longer than a plugin is given to end after a stop: it gets what is
left of groups whose plugins were interrupted."""

Tell = Callable[[Any], None]
"""Tells the supervisor something: "ready", or a Report."""


def open_links(
    setup: Setup,
    name: str,
    orders: deque[Any],
    on_note: Callable[[str, str], None] = lambda group, text: None,
) -> tuple[Links, Callable[[], None]]:
    """Open the links of a group; return them, and what closes them.

    What the supervisor orders is done whenever frames are looked for.

    Each pair of groups of a host has one link: the later one in the list connects.
    """
    part, index = setup.parts[name], setup.groups.index(name)
    near = [setup.groups.index(peer) for peer in part.peers if peer in setup.here]
    session = open_session(
        listen=[link_socket(setup.run_dir, index), *setup.listen.get(name, ())],
        connect=[
            *[link_socket(setup.run_dir, other) for other in near if other < index],
            *setup.connect,
        ],
        settings=LINKS,
        config=setup.config,
    )
    links = Links(
        session,
        setup.graph,
        part,
        setup.groups,
        setup.digest,
        rounds=setup.rounds,
        on_note=on_note,
        attend=lambda links: obey(links, orders),
    )

    def close() -> None:
        links.close()
        close_session(session)

    return links, close


def run_group(setup: Setup, name: str, tell: Tell, orders: deque[Any], awake: list[Any]) -> Report:
    """Run a group to the end of its sources and inlets.

    Args:
        setup: the run.
        name: of the group.
        tell: tells the supervisor that the group is ready.
        orders: what the supervisor says; see `obey`.
        awake: is given what ends a wait, to be called after an order was added.

    Returns:
        The report; an error that ended the group is in it.
    """
    part = setup.parts[name]
    plan = Plan(part_of(setup.graph, part.nodes, part.inlets))
    report = Report({node: plan.nodes[node].counters for node in part.nodes})
    keep_scores(plan, report.scores)
    links, close = open_links(setup, name, orders)
    awake.append(links.wake)
    for wire in part.outlets:
        plan.tap(wire, links.tap(wire))
    log = _LogSender(links)
    shown = looked = 0.0
    logging.getLogger("lodeflow").addHandler(log)

    def watch(t: int) -> None:
        nonlocal shown, looked
        log.reached = t
        if (now := monotonic()) - looked < LOOK_EVERY and not links.woken:
            return
        looked, links.woken = now, False
        if setup.shown and monotonic() - shown >= 0.2:
            shown = monotonic()
            engine.count()
            tell(("reached", t, report.counters))
        reach.look()
        window.tend(engine.driver)
        answers.tend()
        for peer in links.left_early():
            if peer in setup.here:
                continue  # the supervisor says what follows
            group = setup.graph.processes.get(peer)
            if group is not None and group.on_crash == "continue":
                if not links.by_name[peer].stops:  # it may still send what it has
                    links.gone(peer)
            elif not engine.stopping.is_set():
                what = "has been stopped" if links.by_name[peer].stops else "has left"
                logging.getLogger("lodeflow").warning("group '%s' %s: ending", peer, what)
                engine.stop()
        if engine.stopping.is_set():
            links.say_stop(setup.far(name))

    reach = Reach(links, setup.far(name), logging.getLogger("lodeflow").warning)
    engine = Engine(
        plan,
        speed=setup.speed,
        duration=setup.duration,
        watch=watch,
        exchange=links,
        samples=setup.samples,
    )

    def changed(t: int, node: str, use: str, params: str) -> None:
        links.later(json.dumps({"change": {"t": t, "node": node, "use": use, "params": params}}))
        tell(("changed", node, use, params))

    answers = Answers(
        setup.graph, name, plan, engine, lambda: tell("stop"), changed, links, setup.groups
    )
    window = open_window(setup, name, plan, answers, links.wake)
    with interruptible(
        engine.stop, patience=PATIENCE, begun=lambda: engine.begun, by=(signal.SIGTERM,)
    ) as closing:
        interrupted: KeyboardInterrupt | None = None
        try:
            plan.start()
            if barrier(
                links,
                engine.stopping.is_set,
                lambda missing: tell(("waiting", missing)),
            ):
                tell("ready")
                engine.begin()
            elif links.has_unread:  # others had begun
                links.break_off()
        except KeyboardInterrupt as error:
            engine.stop()
            interrupted = None if engine.first is None else error
        except LodeflowError as error:
            report.error = str(error)
        except Exception as error:
            report.error = f"lodeflow itself failed: {type(error).__name__}: {error}"
            logging.getLogger("lodeflow").exception("in group '%s'", name)
        closing()
        if interrupted is not None:
            report.lossless = setup.graph.processes[name].allow_gaps
            logging.getLogger("lodeflow").warning(interruption(interrupted))
        window.close()
        _close(setup, name, plan, engine, links, report, tell)
        close()
    return report


def open_window(
    setup: Setup, name: str, plan: Plan, answers: Answers, wake: Callable[[], None]
) -> Window:
    """Open the window of a group that runs on this host."""
    return Window(
        setup.graph.name,
        name,
        plan,
        listen=[look_socket(setup.run_dir, setup.here.index(name)), *setup.open_to.get(name, ())],
        connect=setup.outside,
        config=setup.config,
        answer=answers,
        wake=wake,
    )


def _close(
    setup: Setup,
    name: str,
    plan: Plan,
    engine: Engine,
    links: Links,
    report: Report,
    tell: Tell,
) -> None:
    """Say what there was, and see that it arrives."""
    report.first, report.reached = engine.first, engine.last
    report.stopped = engine.stopping.is_set()
    report.links = {peer: losses.as_dict() for peer, losses in links.losses.items()}
    group = setup.graph.processes[name]
    report.lossless = report.lossless and plan.lossless and links.lossless
    links.note(json.dumps({"report": as_summary(setup, report).as_dict()}))
    tell(report)  # now, because whoever does not take the rest may take too long
    patience = 0.6 if report.stopped or report.error else None
    # One that may be started again is not gone; if it is not, its supervisor says so.
    again = bool(report.error) and group.restart != "never"
    left = farewell(links, patience, silent=again, begun=engine.begun or links.has_unread)
    if left and report.stopped:
        report.lossless = report.lossless and group.allow_gaps
        logging.getLogger("lodeflow").warning("%d samples could not be handed over in time", left)
    elif left and report.error is None:
        report.error = str(RunError(f"group '{name}' could not hand over {left} samples"))


def as_summary(setup: Setup, report: Report) -> Summary:
    """Return the report of a group as a summary of its own."""
    summary = Summary(setup.graph.name, report.counters, report.scores)
    summary.stopped, summary.lossless = report.stopped, report.lossless
    summary.span = 0.0 if report.first is None else (report.reached - report.first) / 1e9
    summary.error = None if report.error is None else RunError(report.error)
    return summary


def obey(links: Links, orders: deque[Any]) -> None:
    """Do what the supervisor has said since the last time.

    ("gone", group): it has crashed, and will not come back. ("finished", group): it has handed
    over everything, and ended.
    """
    while orders:
        what, group = orders.popleft()
        links.gone(group, lost=what == "gone")


class _LogSender(logging.Handler):
    """Sends log records to the recorder."""

    def __init__(self, links: Links) -> None:
        super().__init__()
        self.links = links
        self.reached = 0

    def emit(self, record: logging.LogRecord) -> None:
        try:
            self.links.later(json.dumps({"log": [in_range(self.reached), *log_fields(record)]}))
        except Exception:  # a wrong format must not end the step that logged it
            self.handleError(record)
