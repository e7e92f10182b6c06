"""What makes a run in one process visible to others: its run directory, window and answers."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from lodeflow.errors import RunError
from lodeflow.graph import Graph
from lodeflow.runtime.engine import Engine
from lodeflow.runtime.plan import Plan
from lodeflow.supervisor import rundir
from lodeflow.supervisor.answers import Answers
from lodeflow.supervisor.changes import Tell
from lodeflow.transport.window import Window

MAIN = "main"
"""Name of the one group of a graph that runs in one process."""


@dataclass(frozen=True)
class Look:
    """How others can look in, beside the processes of this user on this host.

    Attributes:
        listen: endpoints for other hosts.
        connect: endpoints of other programs.
        config: Zenoh configuration file with certificates, users and access control.
    """

    listen: Sequence[str] = ()
    connect: Sequence[str] = ()
    config: Path | None = None


class Seen:
    """A visible run. It runs unseen, with a warning, where there is no place for its socket.

    Args:
        graph: the graph.
        plan: its nodes.
        engine: that runs them.
        look: how others can look in.
        tell: told of each change that was made while it ran.

    Raises:
        RunError: an endpoint that was asked for cannot be used.
    """

    def __init__(self, graph: Graph, plan: Plan, engine: Engine, look: Look, tell: Tell) -> None:
        self._engine = engine
        self._answers = Answers(graph, MAIN, plan, engine, engine.stop, tell)
        self._window: Window | None = None
        self._run_dir: Path | None = None
        try:
            run_dir = rundir.place(graph.name)
            rundir.begin(run_dir, graph.name, [MAIN], [list(graph.nodes)])
            self._run_dir = run_dir  # one that could not be made may be another run's
            self._window = Window(
                graph.name,
                MAIN,
                plan,
                listen=[rundir.look_socket(self._run_dir, 0), *look.listen],
                connect=look.connect,
                config=look.config,
                answer=self._answers,
                wake=engine.exchange.wake,
            )
        except RunError as error:
            if look != Look():
                self.close()
                raise
            logging.getLogger("lodeflow").warning("nobody can look in: %s", error)

    def tend(self) -> None:
        """Called on the engine's thread, between batches."""
        if self._window is not None:
            self._window.tend(self._engine.driver)
            self._answers.tend()

    def close(self) -> None:
        """End the window and remove the run directory."""
        if self._window is not None:
            self._window.close()
        if self._run_dir is not None:
            rundir.end(self._run_dir)
