"""Counters of peaks, swings and rhythm, on signals of which the answer is known."""

import logging

import numpy as np
import pytest
import scipy.signal

import lodeflow as lf
from lodeflow.testing import run_node
from lodeflow_plugins.filtering import smoothing
from lodeflow_plugins.pedestrian.decimation import ImuDecimator
from lodeflow_plugins.pedestrian.peaks.node import AccelerationPeakSteps, GyroNormSteps
from lodeflow_plugins.pedestrian.rhythm import rhythm
from lodeflow_plugins.pedestrian.rhythm.node import AutocorrelationSteps
from lodeflow_plugins.pedestrian.swing.node import SwingSteps
from lodeflow_plugins.pedestrian.zero_velocity.node import ZeroVelocitySteps

RATE = 50


def stamps(n, rate=RATE):
    return np.arange(n) * (10**9 // rate)


def walk(strides, period, *, height=1.0, rest=0.6, stance=0.4):
    """IMU and acceleration of a walker who stands, walks and stands; strides of `period` s.

    In a swing the foot turns twice, with a zero of the rate between, as real ones do; in a stance
    it moves `rest` (m/s^2, a tenth of it in rad/s), for `stance` of the stride.
    """
    pause = 3 * RATE
    n = 2 * pause + round(strides * period * RATE)
    seconds = (np.arange(n) - pause) / RATE
    phase = np.where((seconds >= 0) & (seconds < strides * period), seconds / period % 1.0, 0.0)
    inside = np.clip((phase - stance) / (1.0 - stance), 0.0, 1.0)
    shape = np.sin(np.pi * inside)
    walking = (seconds >= 0) & (seconds < strides * period)
    still = np.where(walking, rest, 0.02)
    acceleration = np.zeros((n, 3))
    acceleration[:, 0] = height * 15.0 * shape * np.cos(3 * np.pi * inside) + still
    acceleration[:, 2] = height * 8.0 * shape
    rate = np.zeros((n, 3))
    rate[:, 1] = height * 7.0 * np.sin(2 * np.pi * inside) * shape + 0.1 * still
    t = stamps(n)
    force = acceleration + np.array([0, 0, lf.STANDARD_GRAVITY])
    return {"imu": lf.Imu(t, rate, force), "acceleration": lf.Acceleration(t, acceleration)}


@pytest.mark.parametrize("strides", [1, 7])
@pytest.mark.parametrize(
    ("period", "height", "rest", "stance"),
    [(1.2, 1.0, 0.3, 0.4), (2.0, 0.5, 0.2, 0.5), (0.75, 3.0, 3.0, 0.25), (0.9, 2.0, 1.5, 0.3)],
    ids=["walk", "stroll", "run", "jog"],
)
def test_swings_are_counted_whatever_the_gait(strides, period, height, rest, stance):
    steps = run_node(SwingSteps, **walk(strides, period, height=height, rest=rest, stance=stance))
    assert steps["out"].count.tolist() == list(range(1, strides + 1))
    begins = 3.0 + period * (np.arange(strides) + stance)
    moments = steps["out"].moment * 1e-9
    assert ((moments > begins) & (moments < begins + period * (1 - stance))).all()


def test_a_knock_in_a_stance_is_no_swing():
    motion = walk(4, 1.5)
    quiet = run_node(SwingSteps, **motion)["out"]
    at = 3 * RATE + round((1.5 + 0.25) * RATE)  # in the middle of a stance
    motion["acceleration"].acceleration[at : at + 4] = [0.0, 0.0, 20.0]
    assert run_node(SwingSteps, **motion)["out"].count.tolist() == quiet.count.tolist()
    with_knock = run_node(SwingSteps, {"min_swing": 0.0}, **motion)["out"]
    assert len(with_knock) == len(quiet) + 1


def test_both_feet():
    steps = run_node(SwingSteps, {"steps_per_stance": 2}, **walk(3, 1.2))["out"]
    assert steps.count.tolist() == [2, 4, 6]


def test_the_zero_velocity_counter_walks_but_does_not_run():
    walking = walk(9, 1.2)["acceleration"]
    running = walk(9, 0.75, height=3.0, rest=3.0, stance=0.25)["acceleration"]
    steps = [run_node(ZeroVelocitySteps, acceleration=a)["out"] for a in (walking, running)]
    assert [len(s) for s in steps] == [9, 1]  # the runner stops in the end


def test_a_lower_threshold_drops_what_lies_below():
    acceleration = walk(5, 1.2)["acceleration"]
    dropped = run_node(ZeroVelocitySteps, {"t_min": 1.0}, acceleration=acceleration)["out"]
    assert len(dropped) == 0


@pytest.mark.parametrize("seed", range(5))
def test_peaks_are_those_of_a_search_over_the_whole_record(seed):
    rng = np.random.default_rng(seed)
    n = 3000
    rate = np.zeros((n, 3))
    rate[:, 0] = scipy.signal.filtfilt(*scipy.signal.butter(2, 4.0, fs=RATE), 20 * rng.random(n))
    params = {"prominence": 0.4, "distance": 0.0}
    steps = run_node(GyroNormSteps, params, imu=lf.Imu(stamps(n), rate, rate))["out"]
    weights = smoothing.low_pass(2.0, RATE)
    half = len(weights) // 2
    padded = np.concatenate([np.full(half, abs(rate[0, 0])), np.abs(rate[:, 0])])
    smooth = np.convolve(padded, weights, "valid")
    peaks, _ = scipy.signal.find_peaks(smooth, prominence=0.4)
    found = (steps.moment / 1e9 * RATE).round().astype(int)
    assert len(found) > 10
    # The last one of the record may not have fallen yet, or only where the record ends.
    assert found[:-1].tolist() == peaks[: len(found) - 1].tolist()
    assert len(peaks) - len(found) in (0, 1)


def test_peaks_of_force_are_the_same_search():
    motion = walk(6, 1.3)["imu"]
    assert len(run_node(AccelerationPeakSteps, imu=motion)["out"]) == 6


@pytest.mark.parametrize("period", [0.7, 1.03, 1.6])
def test_rhythm(period):
    t = np.arange(200) / RATE
    window = np.sin(2 * np.pi * t / period) + 0.4 * np.sin(4 * np.pi * t / period)
    assert rhythm.period(window, 25, 100, 0.4, 0.1) / RATE == pytest.approx(period, abs=0.01)
    assert rhythm.period(window, 25, 100, 0.4, 10.0) == 0.0  # too quiet
    noise = np.random.default_rng(0).standard_normal(200)
    assert rhythm.period(noise, 25, 100, 0.4, 0.1) == 0.0


def test_the_rhythm_counts_about_right():
    steps = run_node(AutocorrelationSteps, imu=walk(20, 1.2)["imu"])["out"]
    assert abs(int(steps.count[-1]) - 20) <= 2


def test_a_wrong_rate_is_told(caplog):
    acceleration = walk(3, 1.2)["acceleration"]
    with caplog.at_level(logging.WARNING):
        run_node(ZeroVelocitySteps, {"sample_rate": 200.0}, acceleration=acceleration)
    assert "the input came at 50.0 Hz, and sample_rate says 200 Hz" in caplog.text


@pytest.mark.parametrize("shortest", [3.0, 0.001])
def test_lags_that_do_not_fit_are_refused(shortest):
    with pytest.raises(ValueError, match="shortest"):
        AutocorrelationSteps.Params(shortest=shortest)


def test_decimation():
    rng = np.random.default_rng(0)
    imu = lf.Imu(stamps(11, 200), rng.standard_normal((11, 3)), rng.standard_normal((11, 3)))
    out = run_node(ImuDecimator, {"factor": 4}, imu=imu)["out"]
    assert out.t.tolist() == imu.t[[3, 7]].tolist()
    for found, given in zip(out.values(), imu.values(), strict=True):
        np.testing.assert_allclose(found, given[:8].reshape(2, 4, 3).mean(axis=1), rtol=1e-14)
