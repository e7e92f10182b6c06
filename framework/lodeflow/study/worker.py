"""The process that runs cells, one after the other, and says what came of each."""

from __future__ import annotations

import logging
import os
import threading
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from multiprocessing import parent_process
from multiprocessing.connection import Connection
from typing import Any

import numpy as np

from lodeflow.errors import LodeflowError
from lodeflow.graph import load_graph_text
from lodeflow.graph.model import Wire
from lodeflow.messages.message import Message
from lodeflow.recording.columns import components
from lodeflow.recording.reader import Recording
from lodeflow.recording.replay import replaying
from lodeflow.supervisor.run import run
from lodeflow.supervisor.summary import Summary

STARTED = "started"
"""Sent when all nodes of a cell have started: its kernels are compiled."""
MOST_LOGS = 20


@dataclass(frozen=True)
class Job:
    """A cell as a worker gets it.

    Attributes:
        graph: the resolved graph, as text.
        filename: what problems name.
        recording: whose streams are fed; "" for none.
        start: nodes to compute from.
        streams: what is collected.
    """

    graph: str
    filename: str
    recording: str
    start: tuple[str, ...]
    streams: tuple[Wire, ...]


@dataclass(frozen=True)
class Outcome:
    """What came of a cell.

    Attributes:
        numbers: by column; NaN and what was never sent are None.
        error: why it failed; "" if it did not.
        logs: warnings of its nodes.
    """

    numbers: dict[str, float | int | None]
    error: str = ""
    logs: tuple[str, ...] = ()


def serve(pipe: Connection) -> None:
    """Take jobs from a pipe and send outcomes, until the pipe is closed."""
    os.dup2(2, 1)  # what plugins print is no result
    threading.Thread(target=_end_with_parent, daemon=True).start()
    logs = _Logs()
    logging.getLogger("lodeflow").addHandler(logs)
    with suppress(EOFError, OSError):  # nobody is there any more
        while True:
            job = pipe.recv()
            logs.kept.clear()
            numbers, error = perform(job, lambda: pipe.send(STARTED))
            pipe.send(Outcome(numbers, error, tuple(logs.kept)))


def perform(
    job: Job, started: Callable[[], object] = lambda: None
) -> tuple[dict[str, float | int | None], str]:
    """Run a cell; return its numbers, and why it failed."""
    waiting = [started]

    def progress(*_: object) -> None:
        if waiting:
            waiting.pop()()

    try:
        graph = load_graph_text(job.graph, filename=job.filename)
        if job.recording:
            with Recording(job.recording) as recording:
                graph = replaying(graph, recording, start=job.start, complete=False).graph
        summary = run(graph, record="", progress=progress, collect=job.streams)
    except LodeflowError as error:
        return {}, str(error)
    return numbers_of(summary, job.streams), _failure(summary)


def _failure(summary: Summary) -> str:
    if summary.error is not None:
        return str(summary.error)
    if summary.stopped:
        return "stopped before the end of the data"
    lost = [
        f"'{name}' lost {count} samples ({why})"
        for name, counters in summary.counters.items()
        for why, count in counters.lost.items()
    ]
    return "" if summary.lossless else "; ".join(lost)


def numbers_of(summary: Summary, streams: tuple[Wire, ...]) -> dict[str, float | int | None]:
    """Return what a run gave as a number per column."""
    found: dict[str, float | int | None] = {"wall": summary.wall, "data": summary.span}
    for wire in streams:
        message = summary.scores.get(str(wire))
        if message is not None:
            found.update(_components(str(wire), message))
    return found


def _components(stream: str, message: Message) -> dict[str, float | int | None]:
    found: dict[str, float | int | None] = {}
    for field, value in zip(message.fields, message.values(), strict=True):
        numbers: list[Any] = np.asarray(value).reshape(-1).tolist()
        for name, number in zip(components(field), numbers, strict=True):
            finite = field.integer or np.isfinite(number)
            found[f"{stream}.{name}"] = number if finite else None
    return found


class _Logs(logging.Handler):
    """Keeps the first warnings of a cell."""

    def __init__(self) -> None:
        super().__init__(logging.WARNING)
        self.kept: list[str] = []

    def emit(self, record: logging.LogRecord) -> None:
        if len(self.kept) < MOST_LOGS:
            self.kept.append(f"{record.name}: {record.getMessage()}")


def _end_with_parent() -> None:
    """A worker whose parent was killed does not go on."""
    parent = parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)
