"""Fuzzy c-means: soft clusters of points, and the memberships of new points in them.

Minimises J = sum over points k and clusters i of u_ik^m |x_k - v_i|^2 with sum_i u_ik = 1, by turns

    v_i  = sum_k u_ik^m x_k / sum_k u_ik^m                       the centres
    u_ik = 1 / sum_j (|x_k - v_i| / |x_k - v_j|)^(2 / (m - 1))   the memberships

until no membership moves by more than a tolerance.

Source: Bezdek 1981, Pattern Recognition with Fuzzy Objective Function Algorithms; as Hao, Yang and
Huang state it, Eqs. 1 and 2 and section 4.2, with m = 2, five clusters and a tolerance of 0.01.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit


@dataclass(frozen=True, eq=False)
class Clusters:
    """The outcome of a fit.

    centres: (c, F), the one farthest from the origin first; memberships: (N, c), in that order;
    iterations: how many it took; converged: whether the last one moved less than the tolerance;
    objective: J.
    """

    centres: np.ndarray
    memberships: np.ndarray
    iterations: int
    converged: bool
    objective: float


def fit(
    points: np.ndarray,
    clusters: int = 5,
    *,
    fuzzifier: float = 2.0,
    tolerance: float = 0.01,
    most_iterations: int = 1000,
    seed: int = 0,
) -> Clusters:
    """Find fuzzy clusters, from random memberships.

    Args:
        points: (N, F), finite; N at least `clusters`. Equal points are allowed, and so are fewer
            different ones than clusters: some centres then coincide.
        clusters: how many, c.
        fuzzifier: m, above 1; the larger, the softer.
        tolerance: largest change of a membership at which it stops.
        most_iterations: it stops there too, and says that it has not converged.
        seed: of the first memberships.

    Raises:
        ValueError: the points or a setting cannot be used.
    """
    points = _points(points)
    if clusters < 1:
        raise ValueError(f"there must be at least one cluster, not {clusters}")
    if len(points) < clusters:
        raise ValueError(f"{len(points)} points are too few for {clusters} clusters")
    if not tolerance > 0:
        raise ValueError(f"tolerance must be above 0, not {tolerance}")
    if most_iterations < 1:
        raise ValueError(f"there must be at least one iteration, not {most_iterations}")
    _check_fuzzifier(fuzzifier)
    u = np.random.default_rng(seed).random((len(points), clusters))
    u = np.ascontiguousarray((u / u.sum(axis=1, keepdims=True)).T)
    centres = np.zeros((clusters, points.shape[1]))
    columns = np.ascontiguousarray(points.T)
    iterations, moved, objective = _iterate(
        columns, u, centres, fuzzifier, tolerance, most_iterations
    )
    order = np.argsort(-(centres * centres).sum(axis=1), kind="stable")
    return Clusters(
        np.ascontiguousarray(centres[order]),
        np.ascontiguousarray(u[order].T),
        int(iterations),
        bool(moved < tolerance),
        float(objective),
    )


def memberships(points: np.ndarray, centres: np.ndarray, fuzzifier: float = 2.0) -> np.ndarray:
    """Memberships of points (N, F) in clusters whose centres (c, F) are known; (N, c).

    A point on a centre belongs to it alone, or in equal parts to all centres that lie there.

    Raises:
        ValueError: a point or a centre is not finite, or the shapes do not fit.
    """
    points, centres = _points(points), _points(centres)
    if points.shape[1] != centres.shape[1]:
        raise ValueError(
            f"points have {points.shape[1]} features and centres have {centres.shape[1]}"
        )
    _check_fuzzifier(fuzzifier)
    u = np.empty((len(points), len(centres)))
    belong(points, centres, fuzzifier, u)
    return u


def _check_fuzzifier(fuzzifier: float) -> None:
    if not 1.0 < fuzzifier < np.inf:
        raise ValueError(f"fuzzifier must be above 1, not {fuzzifier}")


def _points(points: np.ndarray) -> np.ndarray:
    points = np.ascontiguousarray(points, dtype=float)
    if points.ndim != 2:
        raise ValueError(f"points must be a table of N rows and F features, not {points.shape}")
    finite = np.isfinite(points).all(axis=1)
    if not finite.all():
        rows = np.flatnonzero(~finite)
        raise ValueError(f"{len(rows)} points are not finite, the first is row {rows[0]}")
    return points


@njit(cache=True, inline="always", error_model="numpy")
def _member(point: np.ndarray, centres: np.ndarray, power: float, weight: np.ndarray) -> float:
    """Write the memberships of one point into weight (c,); return the sum of u^m d^2.

    power: 1 / (m - 1). With w_i = (nearest d / d_i)^(2 power), u_i = w_i / sum w; in ratios to the
    nearest, nothing overflows.
    """
    c = len(centres)
    nearest = np.inf
    for i in range(c):
        square = 0.0
        for j in range(len(point)):
            apart = point[j] - centres[i, j]
            square += apart * apart
        weight[i] = square
        nearest = min(nearest, square)
    total = 0.0
    if nearest == 0.0:
        for i in range(c):
            weight[i] = 1.0 if weight[i] == 0.0 else 0.0
            total += weight[i]
    elif power == 1.0:
        for i in range(c):
            weight[i] = nearest / weight[i]
            total += weight[i]
    else:
        for i in range(c):
            weight[i] = (nearest / weight[i]) ** power
            total += weight[i]
    scale = 1.0 / total
    for i in range(c):
        weight[i] *= scale
    return nearest * scale if power == 1.0 else nearest * total ** (-1.0 / power)


@njit(cache=True, error_model="numpy")
def belong(points: np.ndarray, centres: np.ndarray, fuzzifier: float, u: np.ndarray) -> None:
    """Write the memberships of points (N, F) in centres (c, F) into u (N, c)."""
    power = 1.0 / (fuzzifier - 1.0)
    weight = np.empty(len(centres))
    for k in range(len(points)):
        _member(points[k], centres, power, weight)
        for i in range(len(centres)):
            u[k, i] = weight[i]


CHUNK = 512
"""Points that are worked on at once: their columns stay in the nearest cache."""


@njit(cache=True, error_model="numpy", fastmath={"reassoc", "contract", "nnan", "nsz"})
def _iterate(
    x: np.ndarray,
    u: np.ndarray,
    centres: np.ndarray,
    fuzzifier: float,
    tolerance: float,
    most: int,
) -> tuple[int, float, float]:
    """Move memberships u (c, N) and centres (c, F) by turns; iterations, last move, objective.

    x: (F, N). Loops run along the points, so that the compiler can take several at once.
    """
    c, n = u.shape
    features = len(x)
    power = 1.0 / (fuzzifier - 1.0)
    sums, masses = np.zeros((c, features)), np.zeros(c)
    w, total = np.empty((c, CHUNK)), np.empty(CHUNK)
    point, weight = np.empty(features), np.empty(c)
    for i in range(c):
        for k in range(n):
            share = u[i, k] * u[i, k] if fuzzifier == 2.0 else u[i, k] ** fuzzifier
            masses[i] += share
            for j in range(features):
                sums[i, j] += share * x[j, k]
    moved, objective, iteration = np.inf, np.inf, 0
    while iteration < most and moved >= tolerance:
        for i in range(c):
            if masses[i] > 0.0:  # else nobody is near, and it stays where it is
                for j in range(features):
                    centres[i, j] = sums[i, j] / masses[i]
        sums[:] = 0.0
        masses[:] = 0.0
        moved, objective = 0.0, 0.0
        for begin in range(0, n, CHUNK):
            m = min(CHUNK, n - begin)
            for k in range(m):
                total[k] = 0.0
            for i in range(c):
                row = w[i]
                for k in range(m):
                    row[k] = 0.0
                for j in range(features):
                    centre = centres[i, j]
                    column = x[j, begin : begin + m]
                    for k in range(m):
                        apart = column[k] - centre
                        row[k] += apart * apart
                if power == 1.0:
                    for k in range(m):
                        row[k] = 1.0 / row[k]
                else:
                    for k in range(m):
                        row[k] = row[k] ** -power
                for k in range(m):
                    total[k] += row[k]
            odd = 0
            for k in range(m):
                odd += total[k] > LARGEST or total[k] < SMALLEST
            if odd:  # points on a centre, or out of all proportion
                for k in range(m):
                    if total[k] > LARGEST or total[k] < SMALLEST:
                        for j in range(features):
                            point[j] = x[j, begin + k]
                        cost = _member(point, centres, power, weight)
                        # Twice the shares, which a total of two brings back.
                        for i in range(c):
                            w[i, k] = 2.0 * weight[i]
                        total[k] = 2.0
                        objective += cost - (0.5 if power == 1.0 else 2.0 ** (-1.0 / power))
            for k in range(m):
                objective += 1.0 / total[k] if power == 1.0 else total[k] ** (-1.0 / power)
                total[k] = 1.0 / total[k]
            for i in range(c):
                row, before = w[i], u[i, begin : begin + m]
                mass, largest = 0.0, 0.0
                for k in range(m):
                    new = row[k] * total[k]
                    change = abs(new - before[k])
                    if change > largest:
                        largest = change
                    before[k] = new
                    share = new * new if power == 1.0 else new**fuzzifier
                    row[k] = share
                    mass += share
                masses[i] += mass
                moved = max(moved, largest)
                for j in range(features):
                    column = x[j, begin : begin + m]
                    part = 0.0
                    for k in range(m):
                        part += row[k] * column[k]
                    sums[i, j] += part
        iteration += 1
    return iteration, moved, objective


SMALLEST, LARGEST = 1e-250, 1e250
"""Sums of weights between which nothing has overflowed or been lost."""
