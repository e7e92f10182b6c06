"""`lodeflow study`: tables, resume, failures, kills, Ctrl-C."""

from __future__ import annotations

import json
import os
import signal
import time
from pathlib import Path

import pytest
from command_line import CommandLine

PLUGINS = """\
import os, time
from collections.abc import Iterator
import numpy as np
import lodeflow as lf

class OddScore(lf.Score, ros="odd_msgs/msg/OddScore"):
    error: lf.Scalar[lf.Radian]

class Source(lf.Source):
    class Params(lf.Params):
        seed: int = 0
    def read(self, clock: lf.Clock) -> Iterator[lf.Heading]:
        yield lf.Heading(np.arange(5), np.full(5, 0.1 * self.params.seed))

class Score(lf.Node):
    class Params(lf.Params):
        gain: float = 1.0
        fault: str = ""
        seconds: float = 0.0
    def step(self, heading: lf.Heading) -> None:
        self.last = heading
    def finish(self) -> OddScore:
        print("not a result")
        time.sleep(self.params.seconds)
        if self.params.fault == "raise":
            raise ArithmeticError("odd")
        if self.params.fault == "wait":
            open(f"waiting-{os.getpid()}", "w").close()
            time.sleep(60)
        return OddScore(self.last.t, self.params.gain * self.last.heading)
"""
GRAPH = """\
lodeflow: 1
name: odd
args: {seed: 1}
nodes:
  source: {use: "odd:Source", params: {seed: "${seed}"}}
  score: {use: "odd:Score", inputs: {heading: source}}
"""
STUDY = """\
lodeflow_study: 1
name: odd
graph: odd.yaml
axes:
  method: {cases: {plain: {}, double: {set: {score.gain: 2}}}}
  seed: {arg: seed, from: 1, to: 3}
tables:
  errors:
    title: Errors
    rows: method
    columns: seed
    value: score.error
    unit: deg
    margin: max
    compare: {with: plain}
"""
PRINTED = """\
Errors
method      1      2      3    max  lower than plain
plain    5.73  11.46  17.19  17.19
double  11.46  22.92  34.38  34.38            0 of 3
score.error [deg].

6 cells: 6 run, in"""


@pytest.fixture
def study(lodeflow: CommandLine) -> CommandLine:
    lodeflow.write("odd.py", PLUGINS)
    lodeflow.write("odd.yaml", GRAPH)
    lodeflow.write("study.yaml", STUDY)
    return lodeflow


def ran(study: CommandLine, *options: object, code: int = 0) -> dict[str, object]:
    """Run the study and return what it says of itself."""
    found: dict[str, object] = json.loads(
        study("study", "study.yaml", "--json", *options, code=code).stdout
    )
    return found


def wait_for(folder: Path, pattern: str) -> Path:
    for _ in range(6000):
        if found := sorted(folder.glob(pattern)):
            return found[0]
        time.sleep(0.01)
    raise AssertionError(f"{pattern} did not appear")


def test_the_table_and_the_results_folder(study: CommandLine) -> None:
    done = study("study", "study.yaml")
    lines = [line.rstrip() for line in done.stdout.splitlines()]
    assert "\n".join(lines).startswith(PRINTED)
    assert done.stdout.endswith("results in recordings/studies/odd\n")
    assert "not a result" not in done.stdout
    folder = study.folder / "recordings" / "studies" / "odd"
    assert sorted(path.name for path in folder.iterdir()) == [
        "cells.csv", "cells.parquet", "finished.jsonl", "provenance.json", "study", "tables.md",
    ]  # fmt: skip
    assert (
        "| double | 11.46 | 22.92 | 34.38 | 34.38 | 0 of 3 |" in (folder / "tables.md").read_text()
    )
    assert json.loads((folder / "provenance.json").read_text())["axes"]["seed"] == ["1", "2", "3"]


def test_what_is_finished_is_not_run_again_and_what_has_changed_is(study: CommandLine) -> None:
    first = ran(study, "--jobs", 1)
    assert (first["cells"], first["run"], first["failed"]) == (6, 6, 0)
    again = ran(study)
    assert again["run"] == 0
    assert again["rows"] == first["rows"]
    study.write("study.yaml", STUDY.replace("to: 3", "to: 4").replace("gain: 2", "gain: 3"))
    assert ran(study)["run"] == 1 + 4  # a further seed, and all of the changed method
    study.write("odd.py", PLUGINS + "# changed\n")
    assert ran(study)["run"] == 8
    assert ran(study, "--fresh")["run"] == 8


def test_a_failed_cell_is_told_does_not_stop_the_rest_and_is_tried_again(
    study: CommandLine,
) -> None:
    study.write("study.yaml", STUDY.replace("score.gain: 2", "score.fault: raise"))
    done = study("study", "study.yaml", code=1)
    assert "6 cells: 6 run, 3 failed, in" in done.stdout
    assert "double     -      -      -      -            0 of 0" in done.stdout
    assert (
        "method=double seed=1: node 'score' (Score.finish) failed at t=4 on heading=source: "
        "ArithmeticError: odd" in done.stderr
    )
    found = ran(study, code=1)
    assert (found["run"], found["failed"]) == (3, 3)
    assert set(found["failures"]) == {f"method=double seed={n}" for n in (1, 2, 3)}  # type: ignore


def test_a_killed_process_is_a_failed_cell(study: CommandLine) -> None:
    study.write("study.yaml", STUDY.replace("score.gain: 2", "score.fault: wait"))
    study.write("study.yaml", (study.folder / "study.yaml").read_text().replace("to: 3", "to: 1"))
    process = study.start("study", "study.yaml")
    waiting = wait_for(study.folder, "waiting-*")
    os.kill(int(waiting.name.partition("-")[2]), signal.SIGKILL)
    output, errors = process.communicate(timeout=60)
    assert process.returncode == 1, errors
    assert "2 cells: 2 run, 1 failed" in output
    assert "method=double seed=1: its process was killed by SIGKILL" in errors


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_ctrl_c_keeps_what_is_finished(study: CommandLine, number: signal.Signals) -> None:
    study.write("study.yaml", STUDY.replace("score.gain: 2", "score.fault: wait"))
    process = study.start("study", "study.yaml", "--jobs", 1)
    waiting = wait_for(study.folder, "waiting-*")
    process.send_signal(number)
    _, errors = process.communicate(timeout=20)
    assert process.returncode == 130, errors
    assert errors.replace("not a result\n", "") == (
        "stopped; 3 of 6 cells are done, the same command goes on with the others\n"
    )
    with pytest.raises(ProcessLookupError):
        os.kill(int(waiting.name.partition("-")[2]), 0)
    if number is signal.SIGINT:
        study.write("study.yaml", STUDY)
        assert ran(study)["run"] == 3


def test_a_killed_study_leaves_no_process_and_goes_on(study: CommandLine) -> None:
    study.write("study.yaml", STUDY.replace("score.gain: 2", "score.fault: wait"))
    process = study.start("study", "study.yaml", "--jobs", 1)
    waiting = wait_for(study.folder, "waiting-*")
    process.kill()
    process.communicate(timeout=20)
    worker = int(waiting.name.partition("-")[2])
    for _ in range(1000):
        try:
            os.kill(worker, 0)
        except ProcessLookupError:
            break
        time.sleep(0.01)
    else:
        raise AssertionError("the worker goes on")
    study.write("study.yaml", STUDY)
    assert ran(study)["run"] == 3


def test_mistakes_are_told_before_anything_runs(study: CommandLine) -> None:
    study.write("study.yaml", STUDY.replace("score.gain", "score.gian").replace("rows", "row"))
    done = study("study", "study.yaml", code=2)
    assert (
        done.stderr
        == (
            "study.yaml:5:43: nodes.score.params.gian: no such parameter of 'odd:Score', "
            "did you mean 'gain'?\n"
            "  5 |   method: {cases: {plain: {}, double: {set: {score.gian: 2}}}}\n"
            "    |                                              ^^^^^^^^^^\n"
        )
        or "did you mean 'gain'?" in done.stderr
    )
    assert not (study.folder / "recordings").exists()


def test_figures_need_matplotlib_before_anything_runs(study: CommandLine) -> None:
    figure = "figures: {f: {kind: bars, x: seed, series: method, value: score.error}}\n"
    study.write("study.yaml", STUDY + figure)
    study.write("matplotlib.py", "raise ImportError('not here')\n")
    done = study("study", "study.yaml", code=1)
    assert done.stderr.startswith("lodeflow: figures need the package matplotlib; install")
    assert ran(study, "--no-figures", "--to", "elsewhere")["folder"] == "elsewhere"
    assert (study.folder / "elsewhere" / "tables.md").exists()
    (study.folder / "matplotlib.py").unlink()
    pytest.importorskip("matplotlib", reason="figures need matplotlib")
    files = ran(study)["files"]
    assert [Path(file).name for file in files][-2:] == ["f.png", "f.svg"]  # type: ignore


def test_recordings_are_replayed(lodeflow: CommandLine, graphs: Path) -> None:
    for seed in (1, 2):
        lodeflow(
            "run", graphs / "heading.yaml", "--arg", "duration=3", "--arg", f"seed={seed}",
            "--record", f"ride-{seed}.mcap",
        )  # fmt: skip
    lodeflow.write(
        "study.yaml",
        f"lodeflow_study: 1\nname: rides\ngraph: {graphs}/heading.yaml\n"
        "axes:\n"
        "  noise: {set: fuser.gyro_noise, values: [0.15 deg/s, 1 deg/s]}\n"
        "  ride: {replay: [fuser], files: 'ride-*.mcap', label: '\\d'}\n",
    )
    found = json.loads(lodeflow("study", "study.yaml", "--json").stdout)
    assert found["run"] == 4
    rows = {(row["noise"], row["ride"]): row for row in found["rows"]}
    assert set(rows) == {(n, r) for n in ("0.15 deg/s", "1 deg/s") for r in ("1", "2")}
    again = json.loads(lodeflow("replay", "ride-2.mcap", "--json", "--no-record").stdout)
    score = rows["0.15 deg/s", "2"]
    assert score["score.total_rmse [rad]"] == again["scores"]["score"]["total_rmse"]
    assert score["score.total_rmse [rad]"] != rows["1 deg/s", "2"]["score.total_rmse [rad]"]
    lodeflow.write(
        "study.yaml",
        (lodeflow.folder / "study.yaml").read_text() + "set: {vehicle.seed: 9}\n",
    )
    done = lodeflow("study", "study.yaml", code=2)
    assert "study.yaml:7:7: 'vehicle' is not computed" in done.stderr
