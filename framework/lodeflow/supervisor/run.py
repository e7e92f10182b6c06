"""One run in one process: plan, engine, recorder, and what is said of it at the end."""

from __future__ import annotations

import datetime
import gc
import json
import signal
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from types import MappingProxyType
from typing import Any

from lodeflow.clock import monotonic, seconds, wall_time
from lodeflow.errors import LodeflowError, RunError
from lodeflow.graph import Graph, dump
from lodeflow.graph.model import Wire
from lodeflow.messages.message import Message
from lodeflow.messages.vocabulary import Score
from lodeflow.recording.provenance import provenance
from lodeflow.recording.recorder import Recorder
from lodeflow.runtime.engine import Engine
from lodeflow.runtime.plan import Plan
from lodeflow.supervisor.summary import Summary

GRACE = 1.0
"""Seconds that a run has to end by itself after Ctrl-C, before it is interrupted where it is."""


LONGEST = 2**31
"""Seconds of event time that stamps can tell apart."""

Progress = Callable[[Plan, int], None]
"""Called now and then with the plan and the event time reached."""


def run(
    graph: Graph,
    *,
    record: str | None = None,
    speed: float | None = None,
    duration: float | None = None,
    progress: Progress = lambda plan, t: None,
    command: Sequence[str] = (),
    about: Mapping[str, str] = MappingProxyType({}),
) -> Summary:
    """Run a graph to its end.

    Args:
        graph: a checked graph.
        record: path of the recording; None for the graph's own, "" for no recording.
        speed: event time per wall time, 1 for real time; None for as fast as the data allows.
        duration: seconds of event time; None for all there is.
        progress: called about ten times a second.
        command: arguments of the command line, kept in the recording.
        about: what else is kept in the recording's provenance.

    Returns:
        The summary; an error that ended the run is in it, with the recording closed.

    Raises:
        LodeflowError: the run could not start (nothing is left behind).
    """
    if duration is not None and not 0 < duration < LONGEST:
        raise RunError(f"a duration is above 0 and below {LONGEST} s, got {duration}")
    plan = Plan(graph)
    summary = Summary(graph.name, {name: plan.nodes[name].counters for name in graph.nodes})
    _keep_scores(plan, summary)
    watch = _Watch(plan, progress)
    engine = Engine(
        plan,
        speed=speed,
        duration=None if duration is None else seconds(duration),
        watch=watch,
    )
    started = monotonic()
    with _interruptible(engine) as closing:  # before the file is begun: it must be closed too
        watch.recorder = recorder = _recorder(graph, plan, record, command, about)
        try:
            with _unswept():
                engine.run()
        except KeyboardInterrupt:
            engine.stop()
        except LodeflowError as error:
            summary.error = error
        except Exception as error:
            failure = RunError(f"lodeflow itself failed: {type(error).__name__}: {error}")
            failure.__cause__ = error
            summary.error = failure
        closing()
        summary.wall = monotonic() - started
        summary.stopped = engine.stopping.is_set()
        summary.lossless = plan.lossless
        summary.span = engine.span / seconds(1)
        if recorder is not None:
            summary.recording = recorder.path
            try:
                recorder.close({"summary": json.dumps(summary.as_dict())})
            except LodeflowError as error:
                summary.error = summary.error or error
            summary.wall = monotonic() - started  # what was still to be written counts
    return summary


def _keep_scores(plan: Plan, summary: Summary) -> None:
    for name, node in plan.nodes.items():
        for port in node.spec.outputs:
            if not issubclass(port.type, Score):
                continue
            wire = Wire(name, port.name)

            def keep(message: Message, key: str = str(wire)) -> None:
                summary.scores[key] = message[-1] if message.is_block else message

            plan.tap(wire, keep)


def _recorder(
    graph: Graph,
    plan: Plan,
    record: str | None,
    command: Sequence[str],
    about: Mapping[str, str],
) -> Recorder | None:
    begun = datetime.datetime.fromtimestamp(wall_time() / 1e9, tz=datetime.UTC)
    path, streams = record, None
    if graph.record is not None:
        fields = {**graph.args, "name": graph.name, "start": begun.strftime("%Y%m%d-%H%M%S-%f")}
        path = graph.record.to.format(**fields) if record is None else record
        streams = graph.record.streams
    if not path:
        return None
    recorder = Recorder(
        Path(path),
        graph=dump(graph),
        provenance={**provenance(graph, command=command, started=begun.isoformat()), **about},
    )
    recorder.attach(plan, tuple(graph.streams()) if streams is None else streams)
    return recorder


class _Watch:
    """Between batches: is the recorder keeping up, and is it time to show progress?"""

    def __init__(self, plan: Plan, progress: Progress) -> None:
        self.plan = plan
        self.recorder: Recorder | None = None
        self.progress = progress
        self.shown = 0.0

    def __call__(self, t: int) -> None:
        if self.recorder is not None:
            self.recorder.keep_up(t)
        now = monotonic()
        if now - self.shown >= 0.1:
            self.shown = now
            self.progress(self.plan, t)


@contextmanager
def _unswept() -> Iterator[None]:
    """Keep the garbage collector off what was there before the run.

    That is tens of thousands of objects of imported packages, looked through again and again.
    """
    gc.freeze()
    try:
        yield
    finally:
        gc.unfreeze()


@contextmanager
def _interruptible(engine: Engine) -> Iterator[Callable[[], None]]:
    """Let Ctrl-C and SIGTERM end the sources; what does not react in time is interrupted.

    Yields what is to be called when the run is over: from then on nothing interrupts the closing
    of the recording, which takes no user code.
    """
    if threading.current_thread() is not threading.main_thread():
        yield lambda: None
        return

    def interrupt(*_: Any) -> None:
        if engine.stopping.is_set():
            raise KeyboardInterrupt
        engine.stop()
        signal.setitimer(signal.ITIMER_REAL, GRACE)

    def give_up(*_: Any) -> None:
        raise KeyboardInterrupt

    def closing() -> None:
        signal.setitimer(signal.ITIMER_REAL, 0)
        for number in handlers:
            signal.signal(number, signal.SIG_IGN)

    handlers = {signal.SIGINT: interrupt, signal.SIGTERM: interrupt, signal.SIGALRM: give_up}
    before = {number: signal.signal(number, handler) for number, handler in handlers.items()}
    try:
        yield closing
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        for number, handler in before.items():
            signal.signal(number, handler)
