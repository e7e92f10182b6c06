"""Fuzzy c-means: against scikit-fuzzy, and where data are degenerate."""

import numpy as np
import pytest
import skfuzzy
from hypothesis import given, settings
from hypothesis import strategies as st

from lodeflow_plugins.interference import fuzzy_c_means as fcm


def clouds(seed=0, n=300):
    rng = np.random.default_rng(seed)
    middles = np.array([[0.1, 0.1], [0.8, 0.2], [0.5, 0.9], [0.2, 0.7], [0.95, 0.95]])
    return np.abs(middles[rng.integers(0, 5, n)] + 0.05 * rng.standard_normal((n, 2)))


@pytest.mark.parametrize("fuzzifier", [2.0, 1.5, 3.0])
def test_it_agrees_with_scikit_fuzzy(fuzzifier):
    points = clouds()
    ours = fcm.fit(points, 5, fuzzifier=fuzzifier, tolerance=1e-10, seed=3)
    first = np.random.default_rng(3).random((len(points), 5))
    centres, memberships, *_, objective, _, _ = skfuzzy.cmeans(
        points.T, 5, fuzzifier, error=1e-10, maxiter=1000, init=first.T / first.sum(axis=1)
    )
    order = np.argsort(-np.linalg.norm(centres, axis=1))
    np.testing.assert_allclose(ours.centres, centres[order], atol=1e-6)
    np.testing.assert_allclose(ours.memberships, memberships[order].T, atol=1e-6)
    assert ours.converged
    assert ours.objective == pytest.approx(objective[-1], rel=1e-6)


def test_memberships_of_new_points_agree_with_scikit_fuzzy():
    centres = fcm.fit(clouds(), 5).centres
    points = clouds(seed=9, n=50)
    theirs, *_ = skfuzzy.cmeans_predict(points.T, centres, 2.0, error=1e-9, maxiter=1)
    np.testing.assert_allclose(fcm.memberships(points, centres), theirs.T, atol=1e-6)


def test_it_stops_by_the_papers_rule():
    points = clouds()
    found = fcm.fit(points, 5, tolerance=0.01)
    before = fcm.fit(points, 5, tolerance=1e-12, most_iterations=found.iterations - 1)
    earlier = fcm.fit(points, 5, tolerance=1e-12, most_iterations=found.iterations - 2)
    assert found.converged
    assert not before.converged
    assert np.abs(found.memberships - before.memberships).max() < 0.01
    assert np.abs(before.memberships - earlier.memberships).max() >= 0.01


def test_the_seed_decides():
    points = clouds()
    one, same, other = (fcm.fit(points, 5, most_iterations=1, seed=s) for s in (1, 1, 2))
    assert one.centres.tobytes() == same.centres.tobytes()
    assert one.centres.tobytes() != other.centres.tobytes()


def test_points_and_initial_memberships_are_not_modified():
    points, initial = clouds(), np.random.default_rng(1).random((300, 5))
    before = points.copy(), initial.copy()
    given_, drawn = fcm.fit(points, 5, initial=initial), fcm.fit(points, 5, seed=1)
    assert np.array_equal(points, before[0])
    assert np.array_equal(initial, before[1])
    assert given_.memberships.tobytes() == drawn.memberships.tobytes()


@pytest.mark.parametrize("features", [1, 2, 3])
@pytest.mark.parametrize("n", [1500, 7])
def test_a_pass_agrees_with_numpy_across_chunks(n, features):
    rng = np.random.default_rng(4)
    points, u = rng.random((n, features)), rng.random((n, 3))
    points[n // 2] = points[0]
    found = fcm.fit(points, 3, initial=u, tolerance=1e-12, most_iterations=6)
    u = u / u.sum(axis=1, keepdims=True)
    for _ in range(6):
        centres = (u**2).T @ points / (u**2).sum(axis=0)[:, None]
        inverse = 1.0 / ((points[:, None] - centres) ** 2).sum(axis=2)
        u = inverse / inverse.sum(axis=1, keepdims=True)
    order = np.argsort(-np.linalg.norm(centres, axis=1))
    np.testing.assert_allclose(found.centres, centres[order], atol=1e-12)
    np.testing.assert_allclose(found.memberships, u[:, order], atol=1e-12)


def test_a_point_on_a_centre_belongs_to_it_alone():
    centres = np.array([[1.0, 1.0], [0.0, 0.0], [0.0, 0.0]])
    u = fcm.memberships([[1.0, 1.0], [0.0, 0.0]], centres)
    np.testing.assert_array_equal(u, [[1, 0, 0], [0, 0.5, 0.5]])


def test_a_point_next_to_a_centre_or_far_away():
    centres = np.array([[1.0, 0.0], [0.0, 0.0]])
    near = fcm.memberships([[1.0, 1e-200], [1e-160, 0.0], [1e-155, 0.0]], centres)
    assert np.isfinite(near).all()
    np.testing.assert_allclose(near, [[1, 0], [0, 1], [0, 1]], atol=1e-300)
    np.testing.assert_allclose(fcm.memberships([[1e150, 0.0]], centres), [[0.5, 0.5]])


@pytest.mark.parametrize("points", [np.ones((40, 2)), np.repeat([[0.0, 1.0], [1.0, 0.0]], 20, 0)])
def test_fewer_different_points_than_clusters(points):
    found = fcm.fit(points, 5)
    assert found.converged
    assert np.isfinite(found.centres).all()
    np.testing.assert_allclose(found.memberships.sum(axis=1), 1.0)
    assert found.objective < 0.01


@pytest.mark.parametrize(
    ("arguments", "why"),
    [
        ({"points": np.zeros((4, 2))}, "4 points are too few for 5 clusters"),
        ({"points": np.zeros((0, 2))}, "0 points are too few"),
        ({"points": [[0, 0], [np.nan, 1], [np.inf, 0]] * 9}, "18 points .* first is row 1"),
        ({"points": np.zeros(9)}, "a table of N rows"),
        ({"fuzzifier": 1.0}, "fuzzifier must be above 1"),
        ({"tolerance": 0.0}, "tolerance must be above 0"),
        ({"clusters": 0}, "at least one cluster"),
        ({"most_iterations": 0}, "at least one iteration"),
        ({"initial": np.ones((9, 4))}, "initial must be 9 x 5"),
        ({"initial": np.zeros((9, 5))}, "initial must not be negative, and above 0 somewhere"),
        ({"initial": np.full((9, 5), np.nan)}, "initial must not be negative"),
    ],
)
def test_what_cannot_be_clustered_is_refused(arguments, why):
    with pytest.raises(ValueError, match=why):
        fcm.fit(**{"points": np.zeros((9, 2)), **arguments})


def test_centres_of_other_features_are_refused():
    with pytest.raises(ValueError, match="points have 2 features and centres have 3"):
        fcm.memberships(np.zeros((1, 2)), np.zeros((2, 3)))


@settings(deadline=None)  # the first example compiles
@given(st.integers(0, 10**6), st.integers(1, 6), st.integers(6, 40), st.floats(1.1, 5.0))
def test_memberships_are_shares(seed, clusters, n, fuzzifier):
    points = np.random.default_rng(seed).random((n, 2)).round(1)  # with points that coincide
    found = fcm.fit(points, clusters, fuzzifier=fuzzifier, most_iterations=20, seed=seed)
    assert (found.memberships >= 0).all()
    np.testing.assert_allclose(found.memberships.sum(axis=1), 1.0)
    norms = np.linalg.norm(found.centres, axis=1)
    assert (np.diff(norms) <= 1e-12).all()
    again = fcm.memberships(points, found.centres, fuzzifier)
    np.testing.assert_allclose(again.sum(axis=1), 1.0)
