"""Finding a running graph by its name, and its streams by theirs."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from lodeflow.errors import RunError
from lodeflow.supervisor.looking import View, Where, graph_of, is_key, run, split_name
from lodeflow.supervisor.rundir import ABOUT, base


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return the folder of run directories, empty."""
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    return base()


def directory(here: Path, graph: str, pid: int) -> None:
    path = here / f"{graph}-{pid}"
    path.mkdir()
    about = {"graph": graph, "pid": pid, "groups": ["main"], "nodes": [["a"]], "started": "now"}
    (path / ABOUT).write_text(json.dumps(about))


def view(**streams: str) -> View:
    told = {
        "order": ["imu", "mag", "fuser"],
        "streams": {
            name.replace("__", "."): {"key": f"lodeflow/g/{name}", "type": kind}
            for name, kind in streams.items()
        },
    }
    nobody: Any = None
    return View("g", nobody, {"main": told}, ["other"])


@pytest.mark.parametrize(
    ("text", "found"),
    [
        ("imu", (None, "imu")),
        ("imu.raw", (None, "imu.raw")),
        ("walk/imu.raw", ("walk", "imu.raw")),
        ("walk@12/imu", ("walk@12", "imu")),
        ("lodeflow/walk/imu/out", (None, "lodeflow/walk/imu/out")),
        ("walk/*", (None, "walk/*")),
        ("**", (None, "**")),
    ],
)
def test_names_and_keys_are_told_apart(text: str, found: tuple[str | None, str]) -> None:
    assert split_name(text) == found
    assert is_key(text) == (found[0] is None and ("/" in text or "*" in text))


@pytest.mark.parametrize(
    ("key", "graph"),
    [
        ("lodeflow/walk/imu/out", "walk"),
        ("lodeflow/walk/**", "walk"),
        ("lodeflow/*/imu/out", None),
        ("lodeflow/**", None),
        ("robot/walk/imu", None),
    ],
)
def test_a_key_may_name_its_graph(key: str, graph: str | None) -> None:
    assert graph_of(key) == graph


def test_streams_come_in_the_order_of_the_graph() -> None:
    assert list(view(fuser="A", imu__b="B", imu__a="B").streams) == ["imu.b", "imu.a", "fuser"]


def test_a_node_stands_for_all_its_ports() -> None:
    there = view(imu__rate="A", imu__force="A", mag="B")
    assert there.keys("imu") == ["lodeflow/g/imu__rate", "lodeflow/g/imu__force"]
    assert there.keys("imu.rate") == ["lodeflow/g/imu__rate"]
    with pytest.raises(RunError, match=r"no stream 'mga' in graph 'g', did you mean 'mag'\?"):
        there.keys("mga")
    with pytest.raises(RunError, match=r"\(streams: imu.rate, .*\) \(no answer from: other\)"):
        there.keys("zzzzzz")


def test_without_a_run_one_is_told_how_to_get_one(here: Path) -> None:
    with pytest.raises(RunError, match="'lodeflow run' starts one"):
        run(Where())


def test_a_run_that_was_killed_is_none(here: Path) -> None:
    ended = subprocess.Popen([sys.executable, "-c", ""])
    ended.wait()
    directory(here, "walk", ended.pid)
    with pytest.raises(RunError, match="no graph is running here"):
        run(Where())


def test_several_runs_must_be_told_apart(here: Path) -> None:
    directory(here, "walk", os.getpid())
    directory(here, "walk", os.getppid())
    directory(here, "heading", os.getpid())
    with pytest.raises(RunError, match=r"several graphs run: heading, walk@\d+, walk@\d+; name"):
        run(Where())
    with pytest.raises(RunError, match=r"several graphs run: walk@\d+, walk@\d+; name one"):
        run(Where(), "walk")
    with pytest.raises(RunError, match="no graph 'headin' is running, did you mean 'heading'"):
        run(Where(), "headin")


def test_a_run_that_does_not_answer_is_told(here: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("lodeflow.supervisor.looking.PATIENCE", 0.2)
    directory(here, "walk", os.getpid())
    with pytest.raises(RunError, match=rf"'walk' \(pid {os.getpid()}\) does not answer"):
        run(Where())
    with pytest.raises(RunError, match=r"no running graph answers at tcp/127\.0\.0\.1:1"):
        run(Where(("tcp/127.0.0.1:1",)))
