"""A window on a small plan, and an onlooker at it, over a socket of their own."""

from __future__ import annotations

import shutil
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

import lodeflow as lf
from lodeflow.graph.model import Graph, GraphNode, Wire
from lodeflow.runtime.blocks import BlockDriver
from lodeflow.runtime.plan import Plan
from lodeflow.runtime.samples import SampleDriver
from lodeflow.transport.onlooker import Onlooker, Sighting
from lodeflow.transport.viewing import StreamView
from lodeflow.transport.window import Window

RATE, TURNED = "lodeflow/panes/source/out", "lodeflow/panes/turn/out"


class Rates(lf.Source):
    """Pushed by hand."""

    def read(self, clock: lf.Clock) -> Iterator[lf.AngularRate]:
        yield from ()


class Turn(lf.Node):
    def step_block(self, rate: lf.AngularRate) -> lf.AngularRate:
        return lf.AngularRate(rate.t, -rate.angular_rate)


def graph() -> Graph:
    wire = {"rate": Wire("source", "out")}
    return Graph(
        "panes",
        {
            "source": GraphNode("source", "Rates", Rates, Rates.Params()),
            "turn": GraphNode("turn", "Turn", Turn, Turn.Params(), wire),
        },
    )


def rates(first: int, count: int) -> lf.AngularRate:
    n = np.arange(first, first + count, dtype=np.int64)
    return lf.AngularRate(n * 1000, np.stack([n, n, n], axis=1).astype(float))


class Panes:
    """A window, and what runs behind it."""

    def __init__(self, folder: Path, form: str, answer: Callable[[Mapping[str, Any]], Any]) -> None:
        self.endpoint = f"unixsock-stream/{folder}/w"
        self.plan = Plan(graph())
        self.plan.start()
        self.form = form
        self.driver: Any = (SampleDriver if form == "samples" else BlockDriver)(self.plan)
        self.window = Window(
            "panes", "main", self.plan, listen=[self.endpoint], answer=answer, wake=lambda: None
        )
        self.onlookers: list[Onlooker] = []

    def onlooker(self, *watched: str, also: str | None = None) -> Onlooker:
        found = Onlooker([self.endpoint, *([] if also is None else [also])])
        self.onlookers.append(found)
        for key in watched:
            found.watch(key)
        return found

    def push(self, first: int, count: int) -> None:
        block = rates(first, count)
        if self.form == "blocks":
            self.driver.push("source", [(0, block)], int(block.t[-1]) + 1)
            return
        for index in range(count):
            self.driver.push("source", 0, block.row(index))

    def taps(self, node: str) -> int:
        return len(self.plan.taps[Wire(node, "out")])

    def until_taps(self, node: str, count: int) -> None:
        """Tend until a stream has so many taps."""
        until = time.monotonic() + 10
        while self.taps(node) != count:
            assert time.monotonic() < until, f"{node} has {self.taps(node)} taps"
            self.window.tend(self.driver)
            time.sleep(0.005)


@contextmanager
def panes(
    form: str = "samples", answer: Callable[[Mapping[str, Any]], Any] = lambda asked: dict(asked)
) -> Iterator[Panes]:
    folder = Path(tempfile.mkdtemp(prefix="lf"))  # the path of a socket is short
    made = Panes(folder, form, answer)
    try:
        yield made
    finally:
        for onlooker in made.onlookers:
            onlooker.close()
        made.window.close()
        shutil.rmtree(folder)


def taken(onlooker: Onlooker, view: StreamView, rows: int, seconds: float = 10) -> list[Sighting]:
    """Take until so many messages of a stream have come, or it has ended."""
    found: list[Sighting] = []
    until = time.monotonic() + seconds
    while view.rows < rows and not view.ended and time.monotonic() < until:
        came = [sighting for sighting in onlooker.take(0.1) if sighting.key == view.key]
        found += [sighting for sighting in came if view.see(sighting)]
    return found
