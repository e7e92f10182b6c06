"""One run in one process: plan, engine, recorder, and what is said of it at the end."""

from __future__ import annotations

import datetime
import gc
import json
import logging
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from types import MappingProxyType

from lodeflow.clock import monotonic, seconds, wall_time
from lodeflow.errors import LodeflowError, RunError
from lodeflow.graph import Graph, dump
from lodeflow.graph.model import Wire
from lodeflow.messages.message import Message
from lodeflow.messages.vocabulary import Score
from lodeflow.recording.events import CHANGE
from lodeflow.recording.past import NOTHING, Past
from lodeflow.recording.provenance import provenance
from lodeflow.recording.recorder import Recorder
from lodeflow.runtime.engine import Engine
from lodeflow.runtime.plan import Counters, Plan
from lodeflow.supervisor.interrupt import interruptible, interruption
from lodeflow.supervisor.seen import Look, Seen
from lodeflow.supervisor.summary import Summary

LONGEST = 2**31
"""Seconds of event time that stamps can tell apart."""

Progress = Callable[[Mapping[str, Counters], int], None]
"""Called now and then with the counters of the nodes and the event time reached."""


def run(
    graph: Graph,
    *,
    record: str | None = None,
    speed: float | None = None,
    duration: float | None = None,
    progress: Progress = lambda counters, t: None,
    command: Sequence[str] = (),
    about: Mapping[str, str] = MappingProxyType({}),
    collect: Collection[Wire] = (),
    look: Look | None = None,
    past: Past = NOTHING,
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
        collect: streams whose last message is kept as a score is, whatever its type.
        look: how other processes can look in; None if they cannot.
        past: changes and gaps of a recorded run, to be repeated.

    Returns:
        The summary; an error that ended the run is in it, with the recording closed.

    Raises:
        LodeflowError: the run could not start (nothing is left behind).
    """
    if duration is not None and not 0 < duration < LONGEST:
        raise RunError(f"a duration is above 0 and below {LONGEST} s, got {duration}")
    plan = Plan(graph)
    past.prepare(plan)
    summary = Summary(graph.name, {name: plan.nodes[name].counters for name in graph.nodes})
    keep_scores(plan, summary.scores, collect)
    watch = _Watch(plan, progress)
    engine = Engine(
        plan,
        speed=speed,
        duration=None if duration is None else seconds(duration),
        watch=watch,
    )
    watch.count = engine.count
    started = monotonic()
    # Before the file is begun: it must be closed too.
    with interruptible(engine.stop, begun=lambda: engine.begun) as closing:
        watch.recorder = recorder = _recorder(graph, plan, record, command, about, past)
        if look is not None:

            def changed(t: int, node: str, use: str, params: str) -> None:
                if recorder is not None:
                    recorder.event(CHANGE, t, node, use, params)

            watch.seen = seen = Seen(graph, plan, engine, look, changed)
        interrupted: KeyboardInterrupt | None = None
        try:
            with _unswept():
                engine.run()
        except KeyboardInterrupt as error:
            engine.stop()
            interrupted = None if engine.first is None else error
        except LodeflowError as error:
            summary.error = error
        except Exception as error:
            failure = RunError(f"lodeflow itself failed: {type(error).__name__}: {error}")
            failure.__cause__ = error
            summary.error = failure
        closing()
        if interrupted is not None:
            logging.getLogger("lodeflow").warning(interruption(interrupted))
            if recorder is not None:
                sources = {node.name for node in plan.sources}
                recorder.break_off([w for w in graph.streams() if w.node not in sources])
        if look is not None:
            seen.close()
        summary.wall = monotonic() - started
        summary.stopped = engine.stopping.is_set()
        summary.lossless = plan.lossless and interrupted is None
        summary.span = engine.span / seconds(1)
        if recorder is not None:
            summary.recording = recorder.path
            try:
                recorder.close({"summary": json.dumps(summary.as_dict())})
            except LodeflowError as error:
                summary.error = summary.error or error
            summary.wall = monotonic() - started  # what was still to be written counts
    return summary


def keep_scores(plan: Plan, scores: dict[str, Message], collect: Collection[Wire] = ()) -> None:
    """Keep the last message of each stream of scores, or to `collect`, under its name."""
    for name, node in plan.nodes.items():
        for port in node.spec.outputs:
            wire = Wire(name, port.name)
            if not issubclass(port.type, Score) and wire not in collect:
                continue

            def keep(message: Message, key: str = str(wire)) -> None:
                scores[key] = message[-1] if message.is_block else message

            plan.tap(wire, keep)


def recording_of(
    graph: Graph, record: str | None, command: Sequence[str], about: Mapping[str, str]
) -> tuple[Path, tuple[Wire, ...], dict[str, str]] | None:
    """Return where a run is recorded, which streams, and its provenance; None for not at all."""
    begun = datetime.datetime.fromtimestamp(wall_time() / 1e9, tz=datetime.UTC)
    path, streams = record, None
    if graph.record is not None:
        fields = {**graph.args, "name": graph.name, "start": begun.strftime("%Y%m%d-%H%M%S-%f")}
        path = graph.record.to.format(**fields) if record is None else record
        streams = graph.record.streams
    if not path:
        return None
    wires = tuple(graph.streams()) if streams is None else streams
    found = provenance(graph, command=command, started=begun.isoformat())
    return Path(path), wires, {**found, **about}


def _recorder(
    graph: Graph,
    plan: Plan,
    record: str | None,
    command: Sequence[str],
    about: Mapping[str, str],
    past: Past,
) -> Recorder | None:
    found = recording_of(graph, record, command, about)
    if found is None:
        return None
    constants = plan.constants()  # may fail; nothing is left behind then
    path, wires, texts = found
    recorder = Recorder(path, graph=dump(graph), provenance=texts)
    recorder.attach(plan, wires, constants, past.filtered)
    past.write(recorder)
    return recorder


class _Watch:
    """Between batches: is the recorder keeping up, and is it time to show progress?"""

    def __init__(self, plan: Plan, progress: Progress) -> None:
        self.counters = {name: node.counters for name, node in plan.nodes.items()}
        self.recorder: Recorder | None = None
        self.seen: Seen | None = None
        self.progress = progress
        self.count: Callable[[], None] = lambda: None
        self.shown = 0.0

    def __call__(self, t: int) -> None:
        if self.seen is not None:
            self.seen.tend()
        if self.recorder is not None:
            self.recorder.keep_up(t)
        now = monotonic()
        if now - self.shown >= 0.1:
            self.shown = now
            self.count()
            self.progress(self.counters, t)


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
