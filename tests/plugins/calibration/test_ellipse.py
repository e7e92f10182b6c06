"""Ellipses of compasses: fit, transformation, node."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import lodeflow as lf
from lodeflow.testing import run_node
from lodeflow_plugins.calibration import ellipse
from lodeflow_plugins.calibration.ellipse_calibrator import EllipseCalibrator


def points(shape, n=60, noise=0.0, part=1.0):
    angle = 2 * np.pi * part * np.arange(n) / n
    circle = np.column_stack([np.cos(angle), np.sin(angle)])
    around = circle @ shape.from_circle().T + shape.centre
    return around + noise * np.random.default_rng(0).standard_normal((n, 2))


@given(
    st.floats(-50, 50), st.floats(-50, 50), st.floats(1.0, 30.0), st.floats(0.3, 0.95),
    st.floats(-1.5, 1.5),
)  # fmt: skip
def test_an_exact_ellipse_is_found(x, y, radius, ratio, angle):
    true = ellipse.Ellipse((x, y), (radius, radius * ratio), angle)
    found = ellipse.fit(points(true)).ellipse
    np.testing.assert_allclose(found.centre, true.centre, atol=1e-6 * radius)
    np.testing.assert_allclose(found.radii, true.radii, rtol=1e-6)
    np.testing.assert_allclose(found.from_circle(), true.from_circle(), atol=1e-5 * radius)


def test_a_noisy_ellipse_is_found_and_its_residual_told():
    true = ellipse.Ellipse((120.0, -80.0), (1200.0, 1100.0), 0.4)
    found = ellipse.fit(points(true, n=720, noise=10.0))
    np.testing.assert_allclose(found.ellipse.centre, true.centre, atol=2.0)
    np.testing.assert_allclose(found.ellipse.radii, true.radii, atol=3.0)
    assert found.residual == pytest.approx(10.0 / 1150.0, rel=0.1)
    assert found.covered == pytest.approx(2 * np.pi)


def test_half_a_turn_is_told():
    found = ellipse.fit(points(ellipse.Ellipse((1.0, 2.0), (3.0, 2.5), 0.1), part=0.5))
    np.testing.assert_allclose(found.ellipse.radii, (3.0, 2.5), rtol=1e-6)
    assert found.covered == pytest.approx(np.pi, abs=0.2)


@pytest.mark.parametrize(
    ("given_points", "why"),
    [
        (np.zeros((5, 2)), "needs 6 points"),
        (np.ones((9, 2)), "all points are the same"),
        (np.column_stack([np.arange(9.0), np.arange(9.0)]), "lie on a line"),
        (np.full((9, 2), np.nan), "finite"),
        (np.zeros((9, 3)), r"\(N, 2\)"),
    ],
)
def test_points_on_no_ellipse(given_points, why):
    with pytest.raises(ValueError, match=why):
        ellipse.fit(given_points)


def test_a_hyperbola_makes_a_bad_ellipse():
    x = np.arange(-9.0, 10)
    found = ellipse.fit(np.column_stack([x, 1 / (x + 0.5)]))
    assert found.residual > 0.05


def test_the_node_makes_a_circle():
    shape = ellipse.Ellipse((5e-6, -3e-6), (36e-6, 31e-6), 0.7)
    level = points(shape)
    mag = lf.MagneticField(np.arange(60), np.column_stack([level, np.full(60, -40e-6)]))
    params = {"centre": shape.centre, "radii": shape.radii, "angle": shape.angle, "field": "33 uT"}
    out = run_node(EllipseCalibrator, params, mag=mag)["out"].magnetic_field
    np.testing.assert_allclose(np.hypot(out[:, 0], out[:, 1]), 33e-6)
    np.testing.assert_allclose(out[:, 2], -40e-6)
    angle = np.unwrap(np.arctan2(out[:, 1], out[:, 0]))
    np.testing.assert_allclose(np.diff(angle), 2 * np.pi / 60)
