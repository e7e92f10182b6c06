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
    initial: np.ndarray | None = None,
) -> Clusters:
    """Find fuzzy clusters, from given or random memberships.

    Args:
        points: (N, F), finite; N at least `clusters`. Equal points are allowed, and so are fewer
            different ones than clusters: some centres then coincide.
        clusters: how many, c.
        fuzzifier: m, above 1; the larger, the softer.
        tolerance: largest change of a membership at which it stops.
        most_iterations: it stops there too, and says that it has not converged.
        seed: of the first memberships, where none are given.
        initial: first memberships (N, c), not negative; those of a point are scaled to sum to 1.

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
    if initial is None:
        u = np.random.default_rng(seed).random((len(points), clusters))
    else:
        u = np.array(initial, dtype=float, order="C")
        if u.shape != (len(points), clusters):
            raise ValueError(f"initial must be {len(points)} x {clusters}, not {u.shape}")
        if not ((u >= 0.0) & (u < np.inf)).all() or not (u.sum(axis=1) > 0.0).all():
            raise ValueError("initial must not be negative, and above 0 somewhere in each row")
    centres, iterations, settled = _iterate(points, u, fuzzifier, tolerance, most_iterations)
    order = np.argsort(-(centres * centres).sum(axis=1), kind="stable")
    centres = np.ascontiguousarray(centres[order])
    objective = belong(points, centres, fuzzifier, u)
    return Clusters(centres, u, iterations, settled, objective)


def _iterate(
    points: np.ndarray, u: np.ndarray, fuzzifier: float, tolerance: float, most: int
) -> tuple[np.ndarray, int, bool]:
    """Move the centres until the memberships rest: centres (c, F), iterations, and whether they do.

    An iteration is one pass over the points, and no memberships are kept: those of two passes
    follow from the centres of both. Whether any has moved is asked only up to the first that has,
    and the point that moved before is asked first.
    """
    columns = np.ascontiguousarray(points.T)
    centres, before = np.zeros((u.shape[1], len(columns))), np.empty((0, len(columns)))
    sums, masses = np.zeros_like(centres), np.zeros(len(centres))
    _first_sums(points, u, fuzzifier, sums, masses)
    mover = 0
    for iteration in range(1, most + 1):
        occupied = masses > 0.0  # else nobody is near, and it stays where it is
        centres = centres.copy()
        centres[occupied] = sums[occupied] / masses[occupied, None]
        mover = _find_mover(points, u, before, centres, fuzzifier, tolerance, mover)
        if mover < 0 or iteration == most:
            break
        _sums(columns, centres, fuzzifier, sums, masses)
        before = centres
    return centres, iteration, mover < 0


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
    finite = np.isfinite(points)
    if not finite.all():
        rows = np.flatnonzero(~finite.all(axis=1))
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
def belong(points: np.ndarray, centres: np.ndarray, fuzzifier: float, u: np.ndarray) -> float:
    """Write the memberships of points (N, F) in centres (c, F) into u (N, c); return J."""
    power = 1.0 / (fuzzifier - 1.0)
    weight = np.empty(len(centres))
    objective = 0.0
    for k in range(len(points)):
        objective += _member(points[k], centres, power, weight)
        for i in range(len(centres)):
            u[k, i] = weight[i]
    return objective


@njit(cache=True, error_model="numpy")
def _first_sums(
    points: np.ndarray, u: np.ndarray, fuzzifier: float, sums: np.ndarray, masses: np.ndarray
) -> None:
    """Make memberships (N, c) sum to 1 at each point; write the sums of u^m x and of u^m."""
    for k in range(len(u)):
        scale = 1.0 / u[k].sum()
        for i in range(u.shape[1]):
            u[k, i] *= scale
            share = u[k, i] * u[k, i] if fuzzifier == 2.0 else u[k, i] ** fuzzifier
            masses[i] += share
            for j in range(points.shape[1]):
                sums[i, j] += share * points[k, j]


@njit(cache=True, error_model="numpy")
def _find_mover(
    points: np.ndarray,
    u: np.ndarray,
    before: np.ndarray,
    centres: np.ndarray,
    fuzzifier: float,
    tolerance: float,
    start: int,
) -> int:
    """A point of which a membership differs by the tolerance or more, looked for from `start` on.

    It has moved from what it was in the centres `before`, or from u (N, c) where there are none.

    Returns:
        Its row; -1 if there is none.
    """
    power = 1.0 / (fuzzifier - 1.0)
    old, new = np.empty(len(centres)), np.empty(len(centres))
    for offset in range(len(points)):
        k = (start + offset) % len(points)
        _member(points[k], centres, power, new)
        if len(before):
            _member(points[k], before, power, old)
        else:
            old[:] = u[k]
        for i in range(len(centres)):
            if abs(new[i] - old[i]) >= tolerance:
                return k
    return -1


CHUNK = 512
"""Points that are worked on at once: their columns stay in the nearest cache."""
SMALLEST, LARGEST = 1e-250, 1e250
"""Sums of weights between which nothing has overflowed or been lost."""


@njit(cache=True, error_model="numpy", fastmath={"reassoc", "contract", "nnan", "nsz"})
def _sums(
    x: np.ndarray, centres: np.ndarray, fuzzifier: float, sums: np.ndarray, masses: np.ndarray
) -> None:
    """Write the sums of u^m x (c, F) and of u^m (c,), with the memberships u in the centres.

    x: (F, N). Loops run along the points, so that the compiler can take several at once.
    """
    c, (features, n) = len(centres), x.shape
    power = 1.0 / (fuzzifier - 1.0)
    weights, scale = np.empty((c, CHUNK)), np.empty(CHUNK)
    point, member = np.empty(features), np.empty(c)
    sums[:] = 0.0
    masses[:] = 0.0
    for begin in range(0, n, CHUNK):
        m = min(CHUNK, n - begin)
        here, there = x[0, begin : begin + m], x[features - 1, begin : begin + m]
        scale[:m] = 0.0
        for i in range(c):
            row = weights[i]
            left, right = centres[i, 0], centres[i, features - 1]
            if features == 2 and power == 1.0:  # the usual case, in one loop
                for k in range(m):
                    weight = 1.0 / ((here[k] - left) ** 2 + (there[k] - right) ** 2)
                    row[k] = weight
                    scale[k] += weight
                continue
            row[:m] = 0.0
            for j in range(features):
                centre, column = centres[i, j], x[j, begin : begin + m]
                for k in range(m):
                    row[k] += (column[k] - centre) ** 2
            for k in range(m):
                row[k] = 1.0 / row[k] if power == 1.0 else row[k] ** -power
                scale[k] += row[k]
        odd = 0
        for k in range(m):
            odd += scale[k] > LARGEST or scale[k] < SMALLEST
        if odd:  # points on a centre, or out of all proportion
            for k in range(m):
                if scale[k] > LARGEST or scale[k] < SMALLEST:
                    for j in range(features):
                        point[j] = x[j, begin + k]
                    _member(point, centres, power, member)
                    for i in range(c):
                        weights[i, k] = member[i]
                    scale[k] = 1.0
        for k in range(m):
            scale[k] = 1.0 / scale[k]
        for i in range(c):
            row, mass, part = weights[i], 0.0, 0.0
            for k in range(m):
                u = row[k] * scale[k]
                share = u * u if fuzzifier == 2.0 else u**fuzzifier
                row[k] = share
                mass += share
                part += share * here[k]
            masses[i] += mass
            sums[i, 0] += part
            for j in range(1, features):
                column, part = x[j, begin : begin + m], 0.0
                for k in range(m):
                    part += row[k] * column[k]
                sums[i, j] += part
