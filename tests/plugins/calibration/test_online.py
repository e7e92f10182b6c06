"""Hard iron while running: found where the motion tells it, and left alone where it does not."""

from functools import cache
from itertools import accumulate

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

import lodeflow as lf
from lodeflow.testing import check_node, run_node
from lodeflow_plugins.calibration.online.node import OnlineMagCalibrator

RATE = 50
IRON = np.array([3e-6, -2e-6, 4e-6])
EARTH = np.array([0.0, 20e-6, -40e-6])
QUIET = {"sigma": 0.3e-6}


@cache
def motion(seconds, rate):
    """Stamps, rates (rad/s) and the rotation matrices, earth <- body, that they lead to."""
    n = int(seconds * RATE)
    t = np.arange(n, dtype=np.int64) * (10**9 // RATE)
    rates = np.array([rate(x) for x in t * 1e-9])
    steps = Rotation.from_rotvec((rates[1:] + rates[:-1]) / 2 / RATE).as_matrix()
    return t, rates, np.array(list(accumulate([np.eye(3), *steps], np.matmul)))


def tumbling(x):
    return np.array([0.8 * np.sin(0.9 * x), 0.7 * np.cos(0.6 * x), 0.9])


def about_z(x):
    return np.array([0.0, 0.0, 0.9])


def inputs(rate, seconds=120, iron=IRON, noise=1e-7, seed=0):
    t, rates, attitude = motion(seconds, rate)
    field = np.einsum("nji,j->ni", attitude, EARTH) + iron
    field += np.random.default_rng(seed).normal(0.0, noise, field.shape)
    return {"mag": lf.MagneticField(t, field), "imu": lf.Imu(t, rates, np.zeros((len(t), 3)))}


def found(params=QUIET, **given):
    out = run_node(OnlineMagCalibrator, params, **given)
    return out["mag"], out["hard_iron"]


def test_hard_iron_is_found_and_removed():
    given = inputs(tumbling)
    mag, iron = found(**given)
    assert mag.t.tolist() == given["mag"].t.tolist()
    np.testing.assert_allclose(iron.bias[-1], IRON, atol=1e-7)
    np.testing.assert_allclose(iron.applied[-1], IRON, atol=1e-7)
    removed = given["mag"].magnetic_field - mag.magnetic_field
    assert (removed[:200] == 0.0).all()  # nothing is known yet
    np.testing.assert_allclose(removed[-1], IRON, atol=1e-7)
    strength = np.linalg.norm(mag.magnetic_field[-500:], axis=1)
    assert strength.std() < 2e-7


def test_a_turn_about_one_axis_tells_nothing_about_that_axis():
    _mag, iron = found(**inputs(about_z))
    deviations = np.sqrt(np.diagonal(iron.covariance[-1]))
    assert deviations[:2].max() < 2e-7
    assert deviations[2] > 9e-6
    np.testing.assert_allclose(iron.applied[-1][:2], IRON[:2], atol=1e-7)
    assert abs(iron.applied[-1][2]) < 1e-9


def test_at_rest_nothing_is_known_or_removed():
    given = inputs(lambda x: np.zeros(3))
    mag, iron = found(**given)
    assert np.array_equal(mag.magnetic_field, given["mag"].magnetic_field)
    assert np.sqrt(np.linalg.eigvalsh(iron.covariance[-1])).min() > 9e-6


@settings(deadline=None, max_examples=10)
@given(st.integers(0, 1000), st.sampled_from([0.0, 0.5e-6, 2e-6]))
def test_without_iron_nothing_is_removed_however_the_field_differs(seed, amplitude):
    given = inputs(tumbling, iron=np.zeros(3), seed=seed)
    rng = np.random.default_rng(seed)
    x = given["mag"].t * 1e-9
    waves = sum(
        np.outer(np.sin(rng.uniform(0.2, 3.0) * x + rng.uniform(0, 6)), rng.standard_normal(3))
        for _ in range(4)
    )
    field = given["mag"].magnetic_field + amplitude * waves
    mag, iron = found(params={}, mag=given["mag"].replace(magnetic_field=field), imu=given["imu"])
    assert (iron.applied == 0.0).all()
    assert np.array_equal(mag.magnetic_field, field)


def test_iron_that_goes_away_is_noticed():
    given = inputs(tumbling, seconds=240)
    field = given["mag"].magnetic_field.copy()
    field[len(field) // 2 :] -= IRON
    _, iron = found(mag=given["mag"].replace(magnetic_field=field), imu=given["imu"])
    half = len(iron) // 2
    assert np.abs(iron.applied[half - 1] - IRON).max() < 2e-7
    assert (iron.applied[half + 3 :] == 0.0).any(axis=0).all()
    assert np.abs(iron.applied[-1]).max() < 1e-6


def test_a_rate_that_stops_coming_stops_the_estimate():
    given = inputs(tumbling)
    cut = len(given["imu"]) // 2
    mag, iron = found(mag=given["mag"], imu=given["imu"][:cut])
    assert len(mag) == len(given["mag"])
    assert iron.t[-1] <= given["imu"].t[cut - 1] + 200_000_000


def test_a_slower_magnetometer_stamped_between_finds_the_same():
    given = inputs(tumbling)
    slow = given["mag"][2::5]
    _, iron = found(mag=slow.replace(t=slow.t.copy()), imu=given["imu"])
    np.testing.assert_allclose(iron.bias[-1], IRON, atol=3e-7)


@pytest.mark.parametrize("segment", [0.2, 0.5])
def test_contract_over_many_segments(segment):
    check_node(OnlineMagCalibrator, {"segment": segment, "evidence": 0.0, "trusted": 1e-5})
