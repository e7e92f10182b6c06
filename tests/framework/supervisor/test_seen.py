"""A visible run has a directory of its own, and leaves that of another alone."""

from __future__ import annotations

import logging
from pathlib import Path

import pytest

from lodeflow.graph.model import Graph
from lodeflow.runtime.engine import Engine
from lodeflow.runtime.plan import Plan
from lodeflow.supervisor import rundir
from lodeflow.supervisor.seen import Look, Seen


def seen(graph: Graph) -> Seen:
    plan = Plan(graph)
    return Seen(graph, plan, Engine(plan), Look(), lambda *change: None)


def test_a_second_run_of_a_graph_in_a_process_leaves_the_first_visible(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    graph = Graph("twice", {})
    first = seen(graph)
    with caplog.at_level(logging.WARNING, logger="lodeflow"):
        second = seen(graph)
    assert "nobody can look in" in caplog.text
    second.close()
    assert [run.graph for run in rundir.running()] == ["twice"]
    first.close()
    assert list(rundir.base().iterdir()) == []
