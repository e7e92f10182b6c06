"""Error separation of a magnetometer on a platform that also has to be found its north and dip.

Source: Chu et al. 2017, Eqs. 6 and 7, with the earth's field known in direction. Where it is not,
the two angles of its direction in the platform's frame, azimuth and dip, are estimated along: in
attitudes about more than one axis they change the readings as no K, M and b do. The strength of
the field is not observable: sensitivities count per field.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lodeflow_plugins.calibration import least_squares

STEPS = 50
MAX_CONDITION = 1000.0
"""Of the design that finds the two angles."""


@dataclass(frozen=True, eq=False)
class Separation:
    """A magnetometer's K, M and b, and the direction of the field that they were found with.

    fit: as by `least_squares.magnetometer`; azimuth: rad, of magnetic north, clockwise from the
    platform's; dip: rad, downwards; azimuth_error, dip_error: rad, NaN if they were given;
    residuals: (N, 3), LSB.
    """

    fit: least_squares.MagnetometerFit
    azimuth: float
    dip: float
    azimuth_error: float
    dip_error: float
    residuals: np.ndarray


def direction(azimuth: float, dip: float) -> np.ndarray:
    """Unit vector of the field in east, north, up; angles in rad."""
    across = np.cos(dip)
    return np.array([np.sin(azimuth) * across, np.cos(azimuth) * across, -np.sin(dip)])


def separate(raw: np.ndarray, attitude: np.ndarray, dip: float | None) -> Separation:
    """Fit K, M and b, in the body axes of the attitudes.

    raw: (N, 3), mean counts in each position, LSB; attitude: (N, 3, 3), earth (east, north, up) <-
    body; dip: rad, with the platform's north magnetic; None to find both angles.

    Raises ValueError for too few or degenerate attitudes: fewer than 4, or 10 for the angles.
    """
    if dip is not None:
        field = _fields(attitude, direction(0.0, dip))
        fit = least_squares.magnetometer(raw, field)
        return Separation(fit, 0.0, dip, np.nan, np.nan, raw - fit.model(field))
    azimuth, dip = _bilinear(raw, attitude)
    for _ in range(STEPS):
        residual, jacobian, fit = _linearised(raw, attitude, azimuth, dip)
        step = np.linalg.lstsq(jacobian, residual, rcond=None)[0][-2:]
        azimuth, dip = azimuth + float(step[0]), dip + float(step[1])
        if np.abs(step).max() < 1e-12:
            break
    residual, jacobian, fit = _linearised(raw, attitude, azimuth, dip)
    variance = residual @ residual / (residual.size - 14)
    errors = np.sqrt(np.diagonal(variance * np.linalg.inv(jacobian.T @ jacobian))[-2:])
    azimuth = float(np.arctan2(np.sin(azimuth), np.cos(azimuth)))
    residuals = residual.reshape(-1, 3)
    return Separation(fit, azimuth, dip, float(errors[0]), float(errors[1]), residuals)


def _fields(attitude: np.ndarray, earth: np.ndarray) -> np.ndarray:
    """The body components, (N, 3), of a vector of the earth."""
    return np.einsum("nji,j->ni", attitude, earth)


def _bilinear(raw: np.ndarray, attitude: np.ndarray) -> tuple[float, float]:
    """Return azimuth and dip, in rad, from the products of K M and the field, which are linear.

    The products tell both factors up to a common sign; the axes of a sensor make a right-handed
    triad.
    """
    if len(raw) < 10:
        raise ValueError(
            f"{len(raw)} positions; at least 10 are needed to find dip and magnetic north, or a "
            "given dip"
        )
    design = np.column_stack([attitude.reshape(-1, 9), np.ones(len(raw))])
    if not (condition := np.linalg.cond(design)) <= MAX_CONDITION:
        raise ValueError(
            f"the attitudes do not tell dip and magnetic north (condition {condition:.3g}, at "
            f"most {MAX_CONDITION:g}): attitudes about more axes, or a given dip, are needed"
        )
    products = np.linalg.lstsq(design, raw, rcond=None)[0][:9].reshape(3, 3, 3)  # earth, body, axis
    left, _, right = np.linalg.svd(products.reshape(3, 9), full_matrices=False)
    earth = left[:, 0] * (np.sign(np.linalg.det(right[0].reshape(3, 3))) or 1.0)
    return float(np.arctan2(earth[0], earth[1])), float(-np.arcsin(np.clip(earth[2], -1.0, 1.0)))


def _linearised(
    raw: np.ndarray, attitude: np.ndarray, azimuth: float, dip: float
) -> tuple[np.ndarray, np.ndarray, least_squares.MagnetometerFit]:
    """Return residuals (3N,), their design (3N, 14), and the fit for some azimuth and dip."""
    field = _fields(attitude, direction(azimuth, dip))
    fit = least_squares.magnetometer(raw, field)
    sines, cosines = np.sin([azimuth, dip]), np.cos([azimuth, dip])
    turned = _fields(attitude, cosines[1] * np.array([cosines[0], -sines[0], 0.0]))
    dipped = _fields(
        attitude, np.array([-sines[0] * sines[1], -cosines[0] * sines[1], -cosines[1]])
    )
    matrix = fit.model.matrix
    jacobian = np.zeros((len(raw), 3, 14))
    for axis in range(3):
        jacobian[:, axis, 3 * axis : 3 * axis + 3] = field
        jacobian[:, axis, 9 + axis] = 1.0
    jacobian[:, :, 12] = turned @ matrix.T
    jacobian[:, :, 13] = dipped @ matrix.T
    return (raw - fit.model(field)).reshape(-1), jacobian.reshape(-1, 14), fit
