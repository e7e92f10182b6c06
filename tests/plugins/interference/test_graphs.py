"""The graphs of two compasses: the turntable of the paper, and the city."""

from pathlib import Path

import numpy as np
import pytest

import lodeflow as lf
from lodeflow.graph import load_graph
from lodeflow.recording.compare import compare
from lodeflow.recording.reader import Recording
from lodeflow.recording.replay import replaying
from lodeflow.study.load import load_study
from lodeflow.supervisor.run import run

GRAPHS = Path(__file__).parents[3] / "graphs"
TURNTABLE, DMC = GRAPHS / "turntable.yaml", GRAPHS / "dmc.yaml"
STUDIES = sorted((GRAPHS / "studies").glob("hao_table*.yaml"))


def scores(graph, **overrides):
    summary = run(load_graph(graph, **overrides), record="")
    assert summary.exit_code == 0, summary.error
    return summary.scores


def means(overrides, score):
    """Mean of each field of a score over some samples of the turntable, in per cent and degrees."""
    found = [scores(TURNTABLE, args=[f"seed={s}"], **overrides)[score] for s in range(100, 108)]
    return {
        name: np.mean([getattr(f, name) for f in found])
        for name in ("recognised", "mistaken", "kept", "error_max")
    }


def test_two_compasses_tell_more_than_one():
    """Tables 1 and 2: at the loose limits, within ten points of RP and five of MP."""
    both = means({}, "thresholds")
    single = {
        "stage1.heading_difference": "null",
        "stage1.heading_difference_rate": "null",
        "stage1.compasses": "first",
        "thresholds.compass": "first",
    }
    one = means({"sets": [f"{name}={value}" for name, value in single.items()]}, "thresholds")
    assert both["recognised"] == pytest.approx(0.823, abs=0.10)
    assert both["mistaken"] == pytest.approx(0.197, abs=0.07)
    assert one["recognised"] == pytest.approx(0.881, abs=0.10)
    assert one["mistaken"] == pytest.approx(0.305, abs=0.07)
    assert both["error_max"] < 0.6 * one["error_max"]


def test_clusters_take_out_what_the_thresholds_left():
    """Tables 3 and 4."""
    before, own, others = (means({}, name) for name in ("thresholds", "own_clusters", "clusters"))
    assert own["mistaken"] < 0.065
    for after in (own, others):
        assert after["mistaken"] < 0.5 * before["mistaken"]
        assert after["kept"] > 0.6
        assert after["error_max"] < 0.7 * before["error_max"]


@pytest.mark.parametrize("study", STUDIES, ids=lambda path: path.stem)
def test_the_studies_check(study):
    assert len(load_study(study).cells) >= 30


def test_every_heading_can_be_swapped_in():
    args = ["duration=60", "scenario=mixed", "seed=101"]
    errors = {}
    for plugin in ("heading_estimator", "integrated_heading", "gated_kalman"):
        found = scores(DMC, args=args, swaps=[f"heading={plugin}"])["score"]
        assert found.samples == 1200
        assert found.missing == 0
        errors[plugin] = found.rmse
    assert errors["heading_estimator"] < errors["integrated_heading"]


def test_the_oracle_needs_the_truth():
    sets = ["heading.gate=oracle", "heading.inputs.truth=vehicle.truth"]
    args = ["duration=120", "scenario=near", "seed=101"]
    found = scores(DMC, args=args, swaps=["heading=gated_kalman"], sets=sets)["score"]
    assert np.degrees(found.rmse) < 2.0


def test_calibration_undoes_the_iron():
    """The static iron of the graph's compasses is gone behind the calibrators."""
    bent = scores(DMC, args=["duration=60", "scenario=none"])["score"]
    flat = {"centre": [0, 0], "radii": [1, 1]}
    plain = scores(
        DMC,
        args=["duration=60", "scenario=none"],
        sets=[
            *[f"vehicle.{name}_iron={flat}" for name in ("first", "second")],
            *[f"{name}.centre=[0, 0]" for name in ("first", "second")],
            *[f"{name}.radii=[33.5 uT, 33.5 uT]" for name in ("first", "second")],
        ],
    )["score"]
    assert bent.rmse == pytest.approx(plain.rmse, rel=1e-3)
    left = ["first.centre=[0, 0]", "second.centre=[0, 0]"]
    assert (
        scores(DMC, args=["duration=60", "scenario=none"], sets=left)["score"].rmse > 2 * bent.rmse
    )


def test_a_replay_of_the_recognition_gives_the_same_bytes(tmp_path):
    drive, again = tmp_path / "drive.mcap", tmp_path / "again.mcap"
    graph = load_graph(DMC, args=["duration=30", "seed=4"])
    assert run(graph, record=str(drive)).exit_code == 0
    with Recording(drive) as recording:
        replay = replaying(graph, recording, start=("features",))
    assert run(replay.graph, record=str(again)).exit_code == 0
    assert compare(drive, again).same
    with Recording(drive) as recording:
        status = lf.HeadingStatus.concat(
            list(recording.stream("/heading/status", lf.HeadingStatus))
        )
    assert len(status) == 600
    assert status.valid[-1] == 1
