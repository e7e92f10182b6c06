"""Ellipsoid fit of a magnetometer that was turned about in a constant field, without a platform.

What the sensor reads lies on an ellipsoid, |A (x - b)| = 1 with A symmetric and positive: nine
parameters, the centre b and the shape A. The algebraic fit (x^2, y^2, z^2, 2xy, 2xz, 2yz, 2x, 2y,
2z against 1) begins, a Gauss-Newton descent on the distances |A (x - b)| - 1 ends: the algebraic
fit alone minimises no distance, and noise pulls it inwards.

The ellipsoid cannot see a rotation R common to all axes: |R A (x - b)| = |A (x - b)|. It takes
another reference to find it: `align` uses that the angle between the field and the vertical, which
an accelerometer shows at rest, is the same in all attitudes.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

MAX_CONDITION = 50.0
"""Of the scaled design: 1.7 for readings all over the sphere; beyond 100 where only heading and
pitch vary, to 20 degrees; without bound for turns about one axis."""
STEPS = 50
"""Most steps of the descent; a handful is enough if there is an ellipsoid."""

_PAIRS = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))


@dataclass(frozen=True, eq=False)
class Ellipsoid:
    """The ellipsoid |shape (x - centre)| = 1, in the unit of x.

    centre: (3,); shape: (3, 3), symmetric, per unit of x; residual_rms: of the distances, as part
    of the radius; condition: of the design; covariance: (9, 9), of the six entries xx, yy, zz, xy,
    xz, yz of the shape and the three of the centre.
    """

    centre: np.ndarray
    shape: np.ndarray
    residual_rms: float
    condition: float
    covariance: np.ndarray

    @property
    def centre_error(self) -> np.ndarray:
        return np.sqrt(np.diagonal(self.covariance)[6:])

    @property
    def sensitivity(self) -> np.ndarray:
        """Norms of the rows of the inverse shape, (3,): what each axis reads of a unit field."""
        return np.linalg.norm(np.linalg.inv(self.shape), axis=1)

    @property
    def sensitivity_error(self) -> np.ndarray:
        inverse = np.linalg.inv(self.shape)
        slopes = []
        for i, j in _PAIRS:
            step = np.zeros((3, 3))
            step[i, j] = step[j, i] = 1.0
            change = -inverse @ step @ inverse
            slopes.append(np.sum(inverse * change, axis=1) / np.linalg.norm(inverse, axis=1))
        jacobian = np.array(slopes).T
        return np.sqrt(np.diagonal(jacobian @ self.covariance[:6, :6] @ jacobian.T))


def fit(readings: np.ndarray) -> Ellipsoid:
    """Fit an ellipsoid to readings (N, 3).

    Raises ValueError for fewer than 20 readings, or such as lie on no ellipsoid or leave parts of
    it open.
    """
    if len(readings) < 20:
        raise ValueError(f"{len(readings)} readings; nine parameters need 20 at least")
    middle = (readings.max(axis=0) + readings.min(axis=0)) / 2.0
    radius = float(np.sqrt(np.mean(np.sum((readings - middle) ** 2, axis=1))))
    if not radius > 0.0:
        raise ValueError("all readings are the same")
    x = (readings - middle) / radius
    shape, centre = _algebraic(x)
    shape, centre = _descend(x, shape, centre)
    distance, jacobian = _distances(x, shape, centre)
    condition = float(np.linalg.cond(jacobian))
    if not condition <= MAX_CONDITION:
        raise ValueError(_open(condition))
    variance = distance @ distance / max(len(x) - 9, 1)
    units = np.array([1.0 / radius] * 6 + [radius] * 3)
    covariance = variance * np.linalg.inv(jacobian.T @ jacobian) * np.outer(units, units)
    return Ellipsoid(
        middle + radius * centre,
        shape / radius,
        float(np.sqrt(np.mean(distance**2))),
        condition,
        covariance,
    )


def _open(condition: float) -> str:
    return (
        f"the readings leave parts of the ellipsoid open (condition {condition:.3g}, at most "
        f"{MAX_CONDITION:g})"
    )


def _algebraic(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return shape and centre of the quadric through scaled readings."""
    squares = [x[:, i] * x[:, j] * (1.0 if i == j else 2.0) for i, j in _PAIRS]
    design = np.column_stack([*squares, 2.0 * x])
    if not (condition := np.linalg.cond(design)) <= 20.0 * MAX_CONDITION:
        raise ValueError(_open(condition))
    p = np.linalg.lstsq(design, np.ones(len(x)), rcond=None)[0]
    quadric = np.empty((3, 3))
    for value, (i, j) in zip(p[:6], _PAIRS, strict=True):
        quadric[i, j] = quadric[j, i] = value
    values, axes = np.linalg.eigh(quadric)
    if not values[0] > 0.0:
        raise ValueError("the readings lie on no ellipsoid, but on an open surface")
    centre = -np.linalg.solve(quadric, p[6:])
    scale = 1.0 + centre @ quadric @ centre
    return (axes * np.sqrt(values / scale)) @ axes.T, centre


def _descend(x: np.ndarray, shape: np.ndarray, centre: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    for _ in range(STEPS):
        distance, jacobian = _distances(x, shape, centre)
        step = np.linalg.lstsq(jacobian, -distance, rcond=None)[0]
        shape, centre = shape.copy(), centre + step[6:]
        for value, (i, j) in zip(step[:6], _PAIRS, strict=True):
            shape[i, j] += value
            shape[j, i] = shape[i, j]
        if not np.linalg.eigvalsh(shape)[0] > 0.0:
            break
        if np.abs(step).max() < 1e-12:
            return shape, centre
    raise ValueError("no ellipsoid fits the readings")


def _distances(
    x: np.ndarray, shape: np.ndarray, centre: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return |A (x - b)| - 1, (N,), and its derivatives, (N, 9)."""
    from_centre = x - centre
    mapped = from_centre @ shape
    norm = np.linalg.norm(mapped, axis=1)
    u = mapped / norm[:, None]
    shapes = [
        u[:, i] * from_centre[:, j] + (u[:, j] * from_centre[:, i] if i != j else 0.0)
        for i, j in _PAIRS
    ]
    return norm - 1.0, np.column_stack([*shapes, -(u @ shape)])


@dataclass(frozen=True, eq=False)
class Alignment:
    """The rotation (3, 3) from the ellipsoid's axes into the body, and the field's dip, rad.

    rotation_error: (3,), rad, standard errors about the body's axes; dip_error: rad; residual_rms:
    of the field's component along the vertical, as part of the field; condition: of the design.
    """

    rotation: np.ndarray
    dip: float
    rotation_error: np.ndarray
    dip_error: float
    residual_rms: float
    condition: float


def align(field: np.ndarray, up: np.ndarray) -> Alignment:
    """Turn fields into the body, in which the vertical is known.

    field: (N, 3), of unit strength, along the ellipsoid's axes; up: (N, 3), unit vectors upward in
    the body, at rest.

    The component of the field along the vertical, up . R field = -sin(dip), is the same for all
    rows. It is linear in the entries of R and in the dip: the least singular vector gives both up
    to a sign, which a rotation, not a reflection, decides. Gauss-Newton on R and the dip follows.

    Raises ValueError where the attitudes do not determine R.
    """
    if len(field) < 20:
        raise ValueError(f"{len(field)} readings at rest; the alignment needs 20 at least")
    products = np.einsum("ni,nj->nij", up, field).reshape(-1, 9)
    design = np.column_stack([products, np.ones(len(field))])
    _, values, rows = np.linalg.svd(design, full_matrices=False)
    if not values[-2] > values[0] / (10.0 * MAX_CONDITION):
        raise ValueError(
            "the attitudes do not tell the rotation between magnetometer and accelerometer"
        )
    linear = rows[-1][:9].reshape(3, 3)
    if np.linalg.det(linear) < 0.0:
        linear = -linear
    left, _, right = np.linalg.svd(linear)
    rotation = left @ np.diag([1.0, 1.0, np.linalg.det(left @ right)]) @ right
    sine = float(-np.mean(np.sum(up * (field @ rotation.T), axis=1)))
    for _ in range(STEPS):
        turned = field @ rotation.T
        residual = np.sum(up * turned, axis=1) + sine
        # R -> exp(w x) R changes up . R f by up . (w x R f) = w . (R f x up)
        jacobian = np.column_stack([np.cross(turned, up), np.ones(len(up))])
        step = np.linalg.lstsq(jacobian, -residual, rcond=None)[0]
        rotation = _turn(step[:3]) @ rotation
        sine += float(step[3])
        if np.abs(step).max() < 1e-12:
            break
    condition = float(np.linalg.cond(jacobian))
    if not (condition <= MAX_CONDITION and abs(sine) < 1.0):
        raise ValueError(
            "the attitudes do not tell the rotation between magnetometer and accelerometer "
            f"(condition {condition:.3g}, at most {MAX_CONDITION:g})"
        )
    variance = residual @ residual / (len(up) - 4)
    errors = np.sqrt(np.diagonal(variance * np.linalg.inv(jacobian.T @ jacobian)))
    return Alignment(
        rotation,
        float(np.arcsin(sine)),
        errors[:3],
        float(errors[3] / np.sqrt(1.0 - sine**2)),
        float(np.sqrt(np.mean(residual**2))),
        condition,
    )


def _turn(w: np.ndarray) -> np.ndarray:
    """The rotation matrix exp(w x) of a rotation vector, rad."""
    angle = float(np.linalg.norm(w))
    x, y, z = w
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    if angle < 1e-9:
        return np.eye(3) + cross
    sine, versine = np.sin(angle) / angle, (1.0 - np.cos(angle)) / angle**2
    return np.eye(3) + sine * cross + versine * (cross @ cross)
