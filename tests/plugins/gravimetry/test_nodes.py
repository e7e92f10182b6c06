"""The tilt correction as a node: one filter for all, the deflection, and the error budget."""

import numpy as np
import pytest

import lodeflow as lf
from lodeflow.clock import SimClock
from lodeflow.testing import check_node, run_node
from lodeflow_plugins.gravimetry.tilt.node import GravityLowPass, TiltCorrection, TiltErrorBudget
from lodeflow_plugins.scoring.gravity_score.node import ScoreGravity
from lodeflow_plugins.sources.tilting_platform import TiltingPlatform

MGAL = 1e-5
T = np.arange(600) * 500_000_000
G = 9.79


def flight(deflection=(0.0, 0.0)):
    """A level platform on a swaying vehicle, with Coriolis and a deflection (east, north)."""
    sway = np.column_stack([np.sin(2 * np.pi * T * 1e-9 / 40), np.cos(2 * np.pi * T * 1e-9 / 55)])
    acceleration = np.column_stack([0.15 * sway, np.zeros(len(T))])
    coriolis = np.tile([0.0034, -0.0041, 0.0], (len(T), 1))
    true = acceleration[:, :2] + coriolis[:, :2] + G * np.array(deflection)
    force = np.column_stack([true, np.full(len(T), G)])
    return {
        "force": lf.SpecificForce(T, force),
        "acceleration": lf.Acceleration(T, acceleration),
        "coriolis": lf.Acceleration(T, coriolis),
    }


@pytest.mark.parametrize("period", [None, 60.0])
def test_a_level_platform_needs_no_correction(period):
    out = run_node(TiltCorrection, {"period": period}, **flight())
    for name in ("modified", "exact"):
        np.testing.assert_allclose(out[name].correction / MGAL, 0.0, atol=1e-9)
    assert np.abs(out["classical"].correction / MGAL).max() > 0.1
    half = (len(T) - len(out["exact"])) // 2
    assert out["exact"].t.tolist() == T[half : len(T) - half].tolist()
    assert half == (0 if period is None else 136)


def test_a_deflection_may_be_a_parameter_or_a_stream():
    deflection = (3e-5, -2e-5)
    motion = flight(deflection)
    without = run_node(TiltCorrection, {"period": None}, **motion)["modified"]
    assert np.abs(without.correction / MGAL).max() > 0.5
    params = {"deflection_east": 3e-5, "deflection_north": -2e-5, "gravity": G, "period": None}
    constant = run_node(TiltCorrection, params, **motion)["modified"]
    np.testing.assert_allclose(constant.correction / MGAL, 0.0, atol=1e-6)
    d = np.tile([-G * 3e-5, G * 2e-5, 0.0], (len(T), 1))
    stream = run_node(
        TiltCorrection, {"period": None}, **motion, disturbance=lf.Acceleration(T, d)
    )["modified"]
    np.testing.assert_allclose(stream.correction / MGAL, 0.0, atol=1e-6)
    check_node(
        TiltCorrection, {"period": 5}, inputs={**motion, "disturbance": lf.Acceleration(T, d)}
    )


def test_filtering_one_side_alone_is_what_the_node_rules_out():
    motion = flight()
    weights = np.ones(41) / 41
    slow = np.column_stack(
        [np.convolve(c, weights, "same") for c in motion["acceleration"].acceleration.T]
    )
    wrong = run_node(
        TiltCorrection, {"period": None}, **{**motion, "acceleration": lf.Acceleration(T, slow)}
    )
    assert abs(wrong["modified"].correction[100:-100].mean() / MGAL) > 10


def test_low_pass_of_a_correction_keeps_its_mean_and_its_stamps():
    raw = lf.GravityCorrection(T, 3 * MGAL + MGAL * np.sin(2 * np.pi * T * 1e-9 / 10))
    out = run_node(GravityLowPass, {"period": 60}, raw=raw)["out"]
    np.testing.assert_allclose(out.correction / MGAL, 3.0, atol=0.01)
    assert set(out.t.tolist()) < set(T.tolist())
    same = run_node(GravityLowPass, {"period": None}, raw=raw)["out"]
    assert same.correction.tolist() == raw.correction.tolist()


def test_the_budget_predicts_what_noise_does():
    params = {"force": [0.134, 0.134, 9.8], "acceleration": [0.1325, 0.1325, 0.0]}
    noisy = list(
        TiltingPlatform(TiltingPlatform.Params(**params, samples=40_000, noise=30 * MGAL)).read(
            SimClock()
        )
    )
    force, acceleration, coriolis = (
        type(blocks[0]).concat(blocks) for blocks in zip(*noisy, strict=True)
    )
    tried = run_node(
        TiltCorrection,
        {"period": None, "gravity": 9.8},
        force=force,
        acceleration=acceleration,
        coriolis=coriolis,
    )["modified"]
    budget = run_node(
        TiltErrorBudget,
        {"error": 30 * MGAL, "gravity": 9.8},
        force=force,
        acceleration=acceleration,
    )["out"]
    assert np.std(tried.correction) == pytest.approx(budget.total[0], rel=0.02)
    assert budget.gravity[0] < 1e-3 * budget.total[0]


def test_rounded_angles():
    force = lf.SpecificForce(T[:1], np.array([[0.134, 0.134, 9.8]]))
    level = lf.Acceleration(T[:1], np.zeros((1, 3)))
    arcsecond = np.pi / 648_000
    params = {"error": 2 * MGAL, "angle_step": 0.01 * arcsecond}
    out = run_node(TiltErrorBudget, params, force=force, acceleration=level)["out"]
    assert out.angle[0] / arcsecond == pytest.approx(0.60, abs=1e-12)
    assert out.by_angle[0] == pytest.approx(0.134 * np.sqrt(2) * 0.60 * arcsecond)


def test_score():
    rng = np.random.default_rng(0)
    one, other = rng.standard_normal((2, len(T)))
    score = run_node(
        ScoreGravity,
        estimate=lf.GravityCorrection(T[10:], one[10:]),
        reference=lf.GravityCorrection(T[:-20], other[:-20]),
    )["out"]
    difference = (one - other)[10:-20]
    assert score.samples[0] == len(difference)
    assert score.mean[0] == pytest.approx(difference.mean())
    assert score.std[0] == pytest.approx(difference.std())
    assert score.rms[0] == pytest.approx(np.sqrt(np.mean(difference**2)))
    assert score.maximum[0] == np.abs(difference).max()
    assert (
        len(
            run_node(
                ScoreGravity,
                estimate=lf.GravityCorrection.empty(),
                reference=lf.GravityCorrection.empty(),
            )["out"]
        )
        == 0
    )
