"""Ellipsoid fit and its alignment: exact on exact data, honest errors, refusals."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from lodeflow_plugins.calibration import chu2017, ellipsoid

DIP = np.radians(48.0)
EARTH = np.array([np.cos(DIP), 0.0, np.sin(DIP)])  # north, east, down


def turned(count, seed=0):
    """Random attitudes, fields in them and the vertical in them, FRD."""
    attitude = Rotation.random(count, random_state=seed)
    return attitude.inv().apply(EARTH), attitude.inv().apply([0.0, 0.0, -1.0])


@settings(deadline=None, max_examples=30)
@given(st.integers(0, 10_000))
def test_any_ellipsoid_is_found_exactly(seed):
    rng = np.random.default_rng(seed)
    shape = rng.uniform(-0.15, 0.15, (3, 3))
    shape = (shape + shape.T) / 2 + np.diag(rng.uniform(0.7, 1.4, 3))
    centre = rng.uniform(-0.8, 0.8, 3)
    scale = 10.0 ** rng.integers(-6, 4)
    points = (turned(200, seed)[0] @ np.linalg.inv(shape) + centre) * scale
    fit = ellipsoid.fit(points)
    np.testing.assert_allclose(fit.centre / scale, centre, atol=1e-9)
    np.testing.assert_allclose(fit.shape * scale, shape, atol=1e-9)
    assert fit.residual_rms < 1e-10


def test_the_centre_of_the_papers_sensor_is_found_to_a_tenth_of_a_count():
    field, up = turned(2000)
    raw = chu2017.MAGNETOMETER(field) + np.random.default_rng(0).normal(0.0, 2.0, field.shape)
    fit = ellipsoid.fit(raw)
    assert np.abs(fit.centre - chu2017.MAGNETOMETER_BIAS).max() < 0.2
    unit = (raw - fit.centre) @ fit.shape
    aligned = ellipsoid.align(unit / np.linalg.norm(unit, axis=1, keepdims=True), up)
    assert np.degrees(aligned.dip) == pytest.approx(48.0, abs=0.01)
    matrix = np.linalg.inv(aligned.rotation @ fit.shape)
    found = matrix / np.linalg.norm(matrix, axis=1, keepdims=True)
    off = np.arccos(np.sum(found * chu2017.MAGNETOMETER_MISALIGNMENT, axis=1).clip(-1, 1))
    assert np.degrees(off).max() < 0.02


def test_the_ellipsoid_alone_cannot_see_the_rotation_common_to_all_axes():
    field, _ = turned(500)
    fit = ellipsoid.fit(chu2017.MAGNETOMETER(field))
    common = fit.shape @ chu2017.MAGNETOMETER.matrix  # would be the identity
    assert np.degrees(Rotation.from_matrix(common).magnitude()) == pytest.approx(2.402, abs=0.001)


@pytest.mark.parametrize("attitude", [[0, 0, 0], [170, -80, 40], [20, 60, 179]])
def test_a_sensor_mounted_any_way_is_aligned(attitude):
    mounting = Rotation.from_euler("ZYX", attitude, degrees=True)
    field, up = turned(300)
    aligned = ellipsoid.align(mounting.inv().apply(field), up)
    np.testing.assert_allclose(aligned.rotation, mounting.as_matrix(), atol=1e-9)
    assert aligned.dip == pytest.approx(DIP)


def test_standard_errors_are_those_of_repeated_fits():
    field, up = turned(300)
    exact = chu2017.MAGNETOMETER(field)
    found = {"centre": [], "sensitivity": [], "turn": []}
    for seed in range(60):
        raw = exact + np.random.default_rng(seed).normal(0.0, 5.0, exact.shape)
        fit = ellipsoid.fit(raw)
        unit = (raw - fit.centre) @ fit.shape
        way = ellipsoid.align(unit / np.linalg.norm(unit, axis=1, keepdims=True), up)
        found["centre"].append(fit.centre)
        found["sensitivity"].append(fit.sensitivity)
        found["turn"].append(Rotation.from_matrix(way.rotation).as_rotvec())
    said = {
        "centre": fit.centre_error, "sensitivity": fit.sensitivity_error,
        "turn": way.rotation_error,
    }  # fmt: skip
    for name, values in found.items():
        np.testing.assert_allclose(said[name], np.std(values, axis=0), rtol=0.35, err_msg=name)


def level_turn(tilts):
    euler = [[h, p, r] for h in range(0, 360, 3) for p, r in tilts]
    attitude = Rotation.from_euler("ZYX", euler, degrees=True)
    field = attitude.inv().apply(EARTH)
    noise = np.random.default_rng(0).normal(0.0, 1e-3, field.shape)
    return field + noise, attitude.inv().apply([0.0, 0.0, -1.0])


@pytest.mark.parametrize("tilts", [[(0, 0)], [(0, 0), (10, 0)]])
def test_turns_that_leave_the_ellipsoid_open_are_refused(tilts):
    with pytest.raises(ValueError, match=r"open|no ellipsoid"):
        ellipsoid.fit(level_turn(tilts)[0])


def test_other_refusals():
    field, up = turned(100)
    with pytest.raises(ValueError, match="19 readings"):
        ellipsoid.fit(field[:19])
    with pytest.raises(ValueError, match="all readings are the same"):
        ellipsoid.fit(np.ones((50, 3)))
    hyperboloid = np.column_stack(
        [np.cosh(field[:, 2]) * np.cos(7 * up[:, 0]), np.cosh(field[:, 2]) * np.sin(7 * up[:, 0]),
         3 * np.sinh(field[:, 2])]
    )  # fmt: skip
    with pytest.raises(ValueError, match=r"no ellipsoid|open"):
        ellipsoid.fit(hyperboloid)
    level, vertical = level_turn([(0, 0)])
    with pytest.raises(ValueError, match="do not tell the rotation"):
        ellipsoid.align(level / np.linalg.norm(level, axis=1, keepdims=True), vertical)
    with pytest.raises(ValueError, match="5 readings at rest"):
        ellipsoid.align(field[:5], up[:5])
