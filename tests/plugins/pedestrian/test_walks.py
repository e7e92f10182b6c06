"""The counters and tracks on recorded walks and runs, in the folder that LODEFLOW_DATA names."""

import json
import os
from functools import cache
from pathlib import Path

import numpy as np
import pytest

import lodeflow as lf
from lodeflow.clock import SimClock
from lodeflow.registry import registry
from lodeflow.testing import run_node

DATA = os.environ.get("LODEFLOW_DATA")
pytestmark = pytest.mark.skipif(
    DATA is None, reason="LODEFLOW_DATA does not name a folder with steps/"
)
FOLDER = Path(DATA or ".") / "steps"
TRUTH = json.loads((FOLDER / "truth.json").read_text()) if DATA else {}
WALKS = [name for name, trial in TRUTH.items() if trial["kind"] == "walk"]


def node(name, params=None, **inputs):
    return run_node(registry().load(name), params or {}, **inputs)


@cache
def motion(name, *, body_axes="frd", factor=4):
    """IMU at about 50 Hz, acceleration, and the truth."""
    source = registry().load("foot_trial")
    params = source.Params(file=str(FOLDER / f"{name}.npz"), body_axes=body_axes)
    parts = list(source(params).read(SimClock()))
    imu = lf.Imu.concat([part.imu for part in parts])
    imu = node("imu_decimator", {"factor": factor}, imu=imu)["out"]
    attitude = node("inertial_attitude", imu=imu)["attitude"]
    position = [part.position for part in parts if part.position is not None]
    return {
        "imu": imu,
        "attitude": attitude,
        "acceleration": node("to_geographic", imu=imu, attitude=attitude)["out"],
        "truth": lf.StepTruth.concat([part.truth for part in parts]),
        "position": lf.PositionTruth.concat(position) if position else None,
    }


def swings(trial, **params):
    return node("swing_steps", params, imu=trial["imu"], acceleration=trial["acceleration"])["out"]


def score(steps, trial):
    return node("step_score", steps=steps, truth=trial["truth"])["out"]


def total(counter, ports, names, **params):
    """Sum of the errors over trials."""
    error = 0
    for name in names:
        trial = motion(name)
        steps = node(counter, params, **{port: trial[port] for port in ports})["out"]
        error += int(score(steps, trial).error[0])
    return error


@pytest.mark.parametrize("name", TRUTH)
def test_each_stride_of_walkers_and_runners_is_counted_once(name):
    trial = motion(name)
    found = score(swings(trial), trial)
    assert found.true[0] == TRUTH[name]["true_strides"]
    assert (found.error[0], found.missed[0], found.extra[0]) == (0, 0, 0)


def test_a_sensor_of_another_maker():
    trial = motion("ngimu_short_walk", body_axes="flu", factor=8)
    for steps in (
        swings(trial),
        node("zero_velocity_steps", acceleration=trial["acceleration"])["out"],
    ):
        assert int(score(steps, trial).counted[0]) == 16


@pytest.mark.parametrize("name", WALKS)
def test_the_counter_of_the_paper(name):
    # The golden counts take a tenth of a second for six samples: the recordings have a rate of a
    # little more than 50 Hz. At exactly 50 Hz it is five.
    trial = motion(name)
    gaps = {
        "golden_printed_tmax2.5": {"min_run": 0.12},
        "golden_with_gap_closing": {"min_run": 0.12, "close_gaps": 0.12},
    }
    for golden, params in gaps.items():
        steps = node("zero_velocity_steps", params, acceleration=trial["acceleration"])["out"]
        assert len(steps) == TRUTH[name][golden]
        steps = node("zero_velocity_steps", acceleration=trial["acceleration"])["out"]
        assert abs(len(steps) - TRUTH[name]["golden_printed_tmax2.5"]) <= 1


def test_what_the_counters_make_of_all_walks():
    strides = sum(TRUTH[name]["true_strides"] for name in WALKS)
    assert strides == 308
    assert total("zero_velocity_steps", ["acceleration"], WALKS, min_run=0.12) == 3  # 99.0 %
    assert total("zero_velocity_steps", ["acceleration"], WALKS) == 4  # 98.7 %
    assert total("gyro_norm_steps", ["imu"], WALKS) <= 1
    assert total("shoe_steps", ["imu"], WALKS) <= 4
    assert total("ared_steps", ["imu"], WALKS) <= 7
    assert total("mag_steps", ["imu"], WALKS) <= 4
    assert total("acceleration_peak_steps", ["imu"], WALKS) <= 2
    assert total("autocorrelation_steps", ["imu"], WALKS) <= 12


def test_what_running_does_to_the_counter_of_the_paper():
    runs = [name for name in TRUTH if name not in WALKS]
    assert total("zero_velocity_steps", ["acceleration"], runs) > 80
    assert total("gyro_norm_steps", ["imu"], runs) <= 1


@pytest.mark.parametrize(("ratio", "rate_weight"), [(2.0, 2.0), (2.0, 3.0), (2.5, 3.0)])
def test_the_combined_counter_does_not_hang_on_its_parameters(ratio, rate_weight):
    error = sum(
        int(
            score(swings(motion(name), ratio=ratio, rate_weight=rate_weight), motion(name)).error[0]
        )
        for name in TRUTH
    )
    assert error <= 1


@pytest.mark.parametrize("name", [name for name in TRUTH if name.startswith("2017")])
def test_tracks(name):
    trial = motion(name)
    track = node("stance_track", imu=trial["imu"], acceleration=trial["acceleration"])["out"]
    found = node("track_score", track=track, truth=trial["position"])["out"]
    assert found.final_share[0] < 0.02
    assert found.rms_share[0] < 0.02
    assert found.length[0] == pytest.approx(found.distance[0], rel=0.08)
    by_steps = node("step_track", steps=swings(trial), attitude=trial["attitude"])["out"]
    assert len(by_steps) == TRUTH[name]["true_strides"]
    assert np.isfinite(node("track_score", track=by_steps, truth=trial["position"])["out"].rms[0])
