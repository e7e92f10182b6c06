"""The ellipse that a level compass draws as it turns, and the way back to a circle.

Hard iron moves the circle of the horizontal field, soft iron and unequal axes make it an ellipse
[C_x, C_y, R_x, R_y, phi]. Its direct least-squares fit and its transformation into a circle remove
both; a turn of the whole circle, which no fit can see, is left as it is.

Source: Halir and Flusser 1998, Numerically stable direct least squares fitting of ellipses, WSCG;
after Fitzgibbon, Pilu and Fisher 1999. Hao, Yang and Huang, section 2, for the parameters.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

FEWEST = 6
"""Points that a fit needs: five determine the ellipse, the sixth shows an error."""


@dataclass(frozen=True)
class Ellipse:
    """An ellipse in the plane.

    centre: (x, y); radii: of its axes, in the unit of the points; angle: rad, from x to the axis
    of the first radius.
    """

    centre: tuple[float, float]
    radii: tuple[float, float]
    angle: float = 0.0

    def from_circle(self, radius: float = 1.0) -> np.ndarray:
        """The symmetric matrix (2, 2) that makes the ellipse, without centre, of a circle."""
        c, s = np.cos(self.angle), np.sin(self.angle)
        turn = np.array([[c, -s], [s, c]])
        return turn @ np.diag(self.radii) @ turn.T / radius

    def onto_circle(self, radius: float = 1.0) -> np.ndarray:
        """The symmetric matrix (2, 2) that makes a circle of points less the centre."""
        return np.linalg.inv(self.from_circle(radius))


@dataclass(frozen=True)
class Fit:
    """An ellipse through points.

    residual: rms distance of the points from it, relative to its mean radius; covered: rad, how
    much of the turn the points cover, with gaps of more than 30 degrees left out; condition: of
    the distances' derivatives. Standard errors, for independent noise: centre_error (2,) and
    radii_error (2,) in the unit of the points; angle_error rad, infinite for a circle.
    """

    ellipse: Ellipse
    residual: float
    covered: float
    condition: float
    centre_error: np.ndarray
    radii_error: np.ndarray
    angle_error: float


def fit(points: np.ndarray) -> Fit:
    """Fit an ellipse to points (N, 2) by direct least squares.

    Raises:
        ValueError: the points are too few, not finite, or on no ellipse, such as a line.
    """
    points = np.asarray(points, dtype=float)
    if points.ndim != 2 or points.shape[1] != 2:
        raise ValueError(f"points must be (N, 2), not {points.shape}")
    if len(points) < FEWEST:
        raise ValueError(f"an ellipse needs {FEWEST} points or more, not {len(points)}")
    if not np.isfinite(points).all():
        raise ValueError("points must be finite")
    middle = points.mean(axis=0)
    size = float(np.abs(points - middle).max())
    if size == 0.0:
        raise ValueError("all points are the same")
    x, y = ((points - middle) / size).T  # well conditioned
    quadratic = np.column_stack([x * x, x * y, y * y])
    linear = np.column_stack([x, y, np.ones_like(x)])
    inner = linear.T @ linear
    if np.linalg.cond(inner) > 1e12:
        raise ValueError("the points lie on a line")
    carry = -np.linalg.solve(inner, linear.T @ quadratic)
    scatter = quadratic.T @ quadratic + quadratic.T @ linear @ carry
    reduced = np.array([scatter[2] / 2, -scatter[1], scatter[0] / 2])
    _, vectors = np.linalg.eig(reduced)
    vectors = np.real(vectors)
    is_ellipse = 4.0 * vectors[0] * vectors[2] - vectors[1] ** 2 > 0.0
    if not is_ellipse.any():
        raise ValueError("the points lie on no ellipse")
    conic = vectors[:, np.flatnonzero(is_ellipse)[0]]
    ellipse = _parameters(*conic, *(carry @ conic))
    found = Ellipse(
        (
            float(ellipse.centre[0] * size + middle[0]),
            float(ellipse.centre[1] * size + middle[1]),
        ),
        (ellipse.radii[0] * size, ellipse.radii[1] * size),
        ellipse.angle,
    )
    around = (points - found.centre) @ found.onto_circle()
    distance = np.hypot(around[:, 0], around[:, 1]) - 1.0
    residual = float(np.sqrt(np.mean(distance**2)))
    return Fit(found, residual, _covered(around), *_errors(points, found, distance))


def _errors(
    points: np.ndarray, found: Ellipse, distance: np.ndarray
) -> tuple[float, np.ndarray, np.ndarray, float]:
    """Condition, and standard errors of centre, radii and angle.

    Along its own axes, an ellipse is |S p| = 1 with S = diag(1 / radii), to be changed by s_11,
    s_22 and s_12: the last one turns it, by s_12 / (1 / r_2 - 1 / r_1).
    """
    c, s = np.cos(found.angle), np.sin(found.angle)
    turn = np.array([[c, -s], [s, c]])
    radii = np.array(found.radii)
    p = (points - found.centre) @ turn / radii  # on the circle of radius 1
    u = p / np.hypot(p[:, 0], p[:, 1])[:, None]
    mean = float(np.sqrt(radii[0] * radii[1]))
    shape = [u[:, 0] * p[:, 0], u[:, 1] * p[:, 1], u[:, 0] * p[:, 1] + u[:, 1] * p[:, 0]]
    jacobian = np.column_stack([*shape, -(u * (mean / radii)) @ turn.T])  # s_ij r_j, centre / mean
    variance = float(distance @ distance) / max(len(points) - 5, 1)
    error = np.sqrt(np.diagonal(variance * np.linalg.inv(jacobian.T @ jacobian)))
    stretch = radii[0] / radii[1] - 1.0
    angle = float(error[2] / stretch) if stretch > 0.0 else np.inf
    return float(np.linalg.cond(jacobian)), mean * error[3:], radii * error[:2], angle


def _parameters(a: float, b: float, c: float, d: float, e: float, f: float) -> Ellipse:
    """The ellipse a x^2 + b x y + c y^2 + d x + e y + f = 0."""
    quadratic = np.array([[a, b / 2], [b / 2, c]])
    centre = np.linalg.solve(quadratic, [-d / 2, -e / 2])
    level = centre @ quadratic @ centre - f
    values, vectors = np.linalg.eigh(quadratic / level)
    if not (values > 0).all():
        raise ValueError("the points lie on no ellipse")
    radii = 1.0 / np.sqrt(values)  # the longer first
    angle = float(np.arctan2(vectors[1, 0], vectors[0, 0]))
    angle = (angle + np.pi / 2) % np.pi - np.pi / 2
    return Ellipse((float(centre[0]), float(centre[1])), (float(radii[0]), float(radii[1])), angle)


def _covered(around: np.ndarray) -> float:
    angles = np.sort(np.arctan2(around[:, 1], around[:, 0]))
    gaps = np.diff(np.append(angles, angles[0] + 2.0 * np.pi))
    return float(2.0 * np.pi - gaps[gaps > np.pi / 6].sum())
