"""The graphs that come with lodeflow, by the API and by the command line."""

import json
import subprocess
import sys
from pathlib import Path

import broad_figures
import numpy as np
import pytest

import lodeflow as lf
from lodeflow.cli.output import score_lines
from lodeflow.graph import load_graph
from lodeflow.recording.reader import Recording
from lodeflow.supervisor.run import run

GRAPHS = Path(__file__).parents[2] / "graphs"
DATA = broad_figures.DATA
needs_gravity, needs_steps = (
    pytest.mark.skipif(DATA is None, reason=f"LODEFLOW_DATA does not name a folder with {name}/")
    for name in ("gravity", "steps")
)
HEADING, BROAD = GRAPHS / "heading.yaml", GRAPHS / "broad.yaml"
ATTITUDE = GRAPHS / "attitude.yaml"


def lodeflow(folder, *arguments):
    command = [sys.executable, "-m", "lodeflow.cli", *map(str, arguments)]
    return subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)


def scored(graph, **overrides):
    summary = run(load_graph(graph, **overrides), record="")
    assert summary.exit_code == 0, summary.error
    return summary.scores["score"]


@pytest.mark.parametrize("seed", range(12))
def test_heading_stays_within_0_2_degrees(seed):
    score = scored(HEADING, args=[f"seed={seed}"])
    assert score.samples == 12_000
    assert score.missing == 0
    assert np.degrees(score.heading_max) < 0.2
    assert np.degrees(score.heading_rmse) < 0.1


def test_a_gyro_bias_shows_in_the_heading():
    # There is no state for it: the estimate hangs behind by about bias times time constant, 24 s.
    score = scored(HEADING, sets=["vehicle.gyro_bias=[0, 0, 0.02 deg/s]"])
    assert 0.3 < np.degrees(score.heading_max) < 0.9


def test_the_other_reading_of_table_1_costs_heading():
    other = (
        "mag_cal.axis_angles=[[0.0640 deg, 89.8353 deg, 89.4179 deg], "
        "[88.8302 deg, 1.9147 deg, 91.5156 deg], [90.8175 deg, 92.9549 deg, 3.0661 deg]]"
    )
    assert np.degrees(scored(HEADING, sets=[other]).heading_max) > 0.4


def test_sample_by_sample_and_in_blocks_give_the_same_score():
    graph = load_graph(HEADING, args=["duration=5"])
    in_blocks = run(graph, record="")
    one_by_one = run(graph, record="", speed=1e6)
    assert in_blocks.scores["score"].samples == 500
    assert one_by_one.scores == in_blocks.scores
    streams = [summary.as_dict()["streams"] for summary in (in_blocks, one_by_one)]
    assert streams[0] == streams[1]


def test_heading_on_the_command_line(tmp_path):
    done = lodeflow(tmp_path, "run", HEADING, "--arg", "duration=20", "--json")
    assert done.returncode == 0, done.stderr
    summary = json.loads(done.stdout)
    assert summary["streams"]["heading"] == 2000
    assert np.degrees(summary["scores"]["score"]["heading_max"]) < 0.2
    path = tmp_path / summary["recording"]
    assert path.parent == tmp_path / "recordings"
    with Recording(path) as recording:
        heading = lf.Heading.concat(list(recording.stream("/heading", lf.Heading)))
        truth = lf.EulerAngles.concat(list(recording.stream("/vehicle/euler", lf.EulerAngles)))
    assert heading.t.tolist() == truth.t.tolist() == list(range(0, 20 * 10**9, 10**7))
    error = np.degrees((heading.heading - truth.heading + np.pi) % (2 * np.pi) - np.pi)
    assert np.abs(error).max() < 0.2
    # The angle about the vertical is not the difference of two headings, but near it.
    about_vertical = np.degrees(summary["scores"]["score"]["heading_max"])
    assert np.abs(error).max() == pytest.approx(about_vertical, abs=0.05)
    shown = lodeflow(tmp_path, "run", HEADING, "--arg", "duration=2", "--no-record")
    assert shown.returncode == 0
    assert "score: heading rmse" in shown.stdout
    assert "score: heading max" in shown.stdout


@pytest.mark.parametrize("graph", sorted(GRAPHS.glob("*.yaml")), ids=lambda path: path.stem)
def test_the_graph_checks(tmp_path, graph):
    done = lodeflow(tmp_path, "check", graph)
    assert done.returncode == 0, done.stderr


def test_broad_on_simulated_data(tmp_path):
    recording = tmp_path / "simulated.mcap"
    vehicle = ["imu", "mag", "truth"]
    assert run(load_graph(HEADING, args=["duration=10"]), record=str(recording)).exit_code == 0
    sets = [f"sensors.{port}=/vehicle/{port}" for port in vehicle]
    score = scored(BROAD, args=[f"recording={recording}"], sets=sets)
    assert score.samples == 1000
    assert score.missing == 0
    assert np.degrees(score.total_rmse) < 3.0
    # The filter of the paper against the two stages, in two nodes and in one.
    in_two = scored(ATTITUDE, args=[f"recording={recording}"], sets=sets)
    in_one = scored(
        BROAD, args=[f"recording={recording}"], sets=sets, swaps=["fuser=attitude_fuser"]
    )
    assert in_one == in_two
    assert np.degrees(in_one.total_rmse) < 1.5


@broad_figures.needs_data
@pytest.mark.parametrize("trial", broad_figures.FIGURES)
def test_broad(tmp_path, trial):
    source = broad_figures.path_of(trial)
    done = lodeflow(tmp_path, "import", "broad", source, "trial.mcap")
    assert done.returncode == 0, done.stderr
    gates = ([], ["--set", "fuser.gate=0.5"])
    for sets, expected in zip(gates, broad_figures.FIGURES[trial], strict=True):
        done = lodeflow(tmp_path, "run", BROAD, "--arg", "recording=trial.mcap", *sets, "--json")
        assert done.returncode == 0, done.stderr
        score = json.loads(done.stdout)["scores"]["score"]
        figures = [score[f"{name}_rmse"] for name in ("total", "heading", "inclination")]
        np.testing.assert_allclose(np.degrees(figures), expected, atol=0.01)


def test_noise_passes_into_the_tilt_correction_as_the_budget_says():
    summary = run(load_graph(GRAPHS / "tilt_errors.yaml", args=["error=100 mGal"]), record="")
    assert summary.exit_code == 0, summary.error
    budget, spread = summary.scores["budget"], summary.scores["spread"]
    assert budget.total * 1e5 == pytest.approx(2.72, abs=0.005)
    assert spread.samples == 50_000
    assert spread.std == pytest.approx(budget.total, rel=0.02)
    (total,) = [text for what, text in score_lines("budget", budget) if what == "budget: total"]
    assert total == "2.719 mGal"


@needs_gravity
@pytest.mark.parametrize(("line", "omission"), [("04", 0.112), ("05", 0.141)])
def test_gravimetry(tmp_path, line, omission):
    file = Path(DATA) / "gravity" / f"EastVicTest_8001.{line}.npz"
    args = ["--arg", f"file={file}", "--json"]
    done = lodeflow(tmp_path, "run", GRAPHS / "gravimetry.yaml", *args)
    assert done.returncode == 0, done.stderr
    scores = json.loads(done.stdout)["scores"]
    assert scores["eotvos_score"]["maximum"] < 0.01e-5
    assert scores["omission"]["mean"] == pytest.approx(omission * 1e-5, abs=0.002e-5)
    assert scores["approximation"]["maximum"] < 0.003e-5


@needs_steps
def test_steps_and_tracks(tmp_path):
    file = Path(DATA) / "steps" / "2017-11-22-11-35-59.npz"
    done = lodeflow(tmp_path, "import", "foot", file, "walk.mcap")
    assert done.returncode == 0, done.stderr
    args = ["--arg", f"file={file}", "--json"]
    found = {}
    for name in ("steps", "pedestrian"):
        done = lodeflow(tmp_path, "run", GRAPHS / f"{name}.yaml", *args)
        assert done.returncode == 0, done.stderr
        found |= json.loads(done.stdout)["scores"]
    counters = ("zero_velocity_score", "swing_score", "peer_score", "step_score")
    assert [found[name]["counted"] for name in counters] == [29] * 4
    assert found["stance_track_score"]["rms_share"] < 0.005
    assert found["step_track_score"]["rms_share"] < 0.03


def test_step_counters_see_the_same_in_blocks_and_in_samples(tmp_path):
    rng = np.random.default_rng(0)
    swing = np.clip((np.arange(2400) / 200 % 1.2 - 0.5) / 0.7, 0.0, 1.0)
    odd, even = np.sin(2 * np.pi * swing), np.cos(2 * np.pi * swing) - np.cos(4 * np.pi * swing)
    motion = [15 * odd, 3 * odd, 6 * even, 0.5 * odd, 4 * odd, 0.3 * even]  # there and back
    imu = np.stack(motion, axis=1) + 0.02 * rng.standard_normal((2400, 6))
    imu[:, 2] -= 9.8
    file = tmp_path / "walk.npz"
    np.savez(file, t=np.arange(2400) / 200, imu=imu, stride_index=np.arange(20, 2400, 240))
    graph = load_graph(GRAPHS / "steps.yaml", args=[f"file={file}"])
    in_blocks, one_by_one = run(graph, record=""), run(graph, record="", speed=1e6)
    assert in_blocks.scores["swing_score"].counted == 9
    assert one_by_one.scores == in_blocks.scores
