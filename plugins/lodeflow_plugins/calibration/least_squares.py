"""Calibration of a magnetometer, an accelerometer and a gyroscope on a rotation platform.

Source: Chu et al. 2017, Magnetic orientation system based on magnetometer, accelerometer and
gyroscope, CAAI Transactions on Intelligence Technology 2(4), section 3.

Each method is a linear least-squares fit of y = C x + c0 with twelve parameters, four for each
axis of y. The fit is made about the means of x and y, which is the same as a column of ones, but
well conditioned: with raw counts beside ones the design of Eqs. 13-15 has a condition number in
the thousands, and the normal equations of Eq. 13 square it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from lodeflow_plugins.calibration import error_models

# The least varied direction of the inputs has to vary by this part of the most varied one.
MAX_CONDITION = 100.0


@dataclass(frozen=True, eq=False)
class MagnetometerFit:
    """Result of `magnetometer`: sensitivity, misalignment and bias of Eq. 6, each on its own.

    sensitivity: (3,), LSB per unit of the field; misalignment: (3, 3), rows are the unit vectors
    of the sensor axes in FRD; bias: (3,), LSB; residual_rms: (3,), LSB, of each sensor axis;
    condition: ratio of the largest to the least variation of the inputs over all directions.
    Standard errors, from the residuals and to first order: sensitivity_error (3,), LSB per unit;
    direction_error (3,), rad, of each sensor axis; bias_error (3,), LSB. NaN without redundancy.
    """

    sensitivity: np.ndarray
    misalignment: np.ndarray
    bias: np.ndarray
    residual_rms: np.ndarray
    condition: float
    sensitivity_error: np.ndarray
    direction_error: np.ndarray
    bias_error: np.ndarray

    @property
    def model(self) -> error_models.Affine:
        """The map h^b -> raw."""
        return error_models.magnetometer(self.sensitivity, self.misalignment, self.bias)


@dataclass(frozen=True, eq=False)
class AccelerometerFit:
    """Result of `accelerometer`: gain (3, 3) in g per LSB and offset (3,) in g of Eq. 8.

    residual_rms: (3,), g, of each body axis; condition: as in MagnetometerFit. Standard errors:
    gain_error (3, 3), offset_error (3,), NaN without redundancy.
    """

    gain: np.ndarray
    offset: np.ndarray
    residual_rms: np.ndarray
    condition: float
    gain_error: np.ndarray
    offset_error: np.ndarray

    @property
    def model(self) -> error_models.Affine:
        """The map raw -> A^b."""
        return error_models.accelerometer(self.gain, self.offset)


@dataclass(frozen=True, eq=False)
class GyroscopeFit:
    """Result of `gyroscope`: k (4, 3) of Eq. 14, three rows of transposed gain and one of bias.

    residual_rms: (3,), unit of the rate, of each body axis; condition: as in MagnetometerFit.
    k_error: (4, 3), standard errors, NaN without redundancy.
    """

    k: np.ndarray
    residual_rms: np.ndarray
    condition: float
    k_error: np.ndarray

    @property
    def model(self) -> error_models.Affine:
        """The map raw -> w^b."""
        return error_models.gyroscope(self.k)


def magnetometer(raw: ArrayLike, field: ArrayLike) -> MagnetometerFit:
    """Separate sensitivity, misalignment and bias of a magnetometer (error separation).

    raw: (N, 3), mean counts in each attitude of the platform, LSB; field: (N, 3), the earth's
    field in FRD as the platform's readings give it. N >= 4, in attitudes that turn the field
    about all axes. Each sensor axis is one fit raw_i = c . h^b + b0 (Fig. 1); then its
    sensitivity is |c|, its direction cosines are c / |c| and its bias is b0.

    Raises ValueError for too little or degenerate data, NaN, or wrong shapes.
    """
    fit = _affine_fit("field", field, "raw", raw)
    sensitivity = np.linalg.norm(fit.matrix, axis=1)
    if not np.all(sensitivity > 0.0):
        raise ValueError("raw does not depend on field on at least one sensor axis")
    misalignment = fit.matrix / sensitivity[:, None]
    along = np.einsum("ij,ijk,ik->i", misalignment, fit.covariance, misalignment)
    across = np.trace(fit.covariance, axis1=1, axis2=2) - along
    return MagnetometerFit(
        sensitivity,
        misalignment,
        fit.offset,
        fit.residual_rms,
        fit.condition,
        np.sqrt(along),
        np.sqrt(across) / sensitivity,
        fit.offset_error,
    )


def accelerometer(raw: ArrayLike, specific_force: ArrayLike) -> AccelerometerFit:
    """Twelve coefficients of an accelerometer from positions at rest (Eq. 8, Table 3).

    raw: (N, 3), mean counts at each position, LSB (the paper takes 100 or more samples);
    specific_force: (N, 3), A^b in g; `chu2017.SIX_POSITIONS` for the six-position method.

    Raises ValueError for too little or degenerate data, NaN, or wrong shapes.
    """
    fit = _affine_fit("raw", raw, "specific_force", specific_force)
    return AccelerometerFit(
        fit.matrix,
        fit.offset,
        fit.residual_rms,
        fit.condition,
        fit.matrix_error,
        fit.offset_error,
    )


def gyroscope(raw: ArrayLike, rate: ArrayLike) -> GyroscopeFit:
    """Twelve coefficients of a gyroscope from known rates of a turntable (Eqs. 13-17).

    raw: (N, 3), mean counts at each rate, LSB; rate: (N, 3), w^b in FRD, any unit. The paper
    turns about three axes at six rates each, N = 18.

    Raises ValueError for too little or degenerate data, NaN, or wrong shapes.
    """
    fit = _affine_fit("raw", raw, "rate", rate)
    k = np.vstack([fit.matrix.T, fit.offset])
    k_error = np.vstack([fit.matrix_error.T, fit.offset_error])
    return GyroscopeFit(k, fit.residual_rms, fit.condition, k_error)


@dataclass(frozen=True, eq=False)
class _AffineFit:
    """covariance: (3, 3, 3), of the rows of the matrix; offset_error: (3,)."""

    matrix: np.ndarray
    offset: np.ndarray
    residual_rms: np.ndarray
    condition: float
    covariance: np.ndarray
    offset_error: np.ndarray

    @property
    def matrix_error(self) -> np.ndarray:
        return np.sqrt(np.diagonal(self.covariance, axis1=1, axis2=2))


def _affine_fit(x_name: str, x: ArrayLike, y_name: str, y: ArrayLike) -> _AffineFit:
    """Least-squares fit of y = matrix x + offset over rows; x and y (N, 3)."""
    x = _rows(x_name, x)
    y = _rows(y_name, y)
    if len(x) != len(y):
        raise ValueError(
            f"{x_name} and {y_name} need the same number of rows, got {len(x)} and {len(y)}"
        )
    if len(x) < 4:
        raise ValueError(f"at least 4 rows are needed for 4 parameters per axis, got {len(x)}")
    x_mean, y_mean = x.mean(axis=0), y.mean(axis=0)
    spread = np.linalg.svd(x - x_mean, compute_uv=False)
    condition = float(spread[0] / spread[2]) if spread[2] > 0.0 else np.inf
    if not condition <= MAX_CONDITION:
        raise ValueError(
            f"{x_name} varies {condition:.3g} times less along one direction than along another "
            f"(at most {MAX_CONDITION:g}): more attitudes or axes are needed"
        )
    solution = np.linalg.lstsq(x - x_mean, y - y_mean, rcond=None)[0]
    matrix = np.ascontiguousarray(solution.T)
    offset = y_mean - matrix @ x_mean
    squares = np.sum((y - error_models.Affine(matrix, offset)(x)) ** 2, axis=0)
    redundancy = len(x) - 4
    variance = squares / redundancy if redundancy else np.full(3, np.nan)
    unit = np.linalg.inv((x - x_mean).T @ (x - x_mean))
    return _AffineFit(
        matrix,
        offset,
        np.sqrt(squares / len(x)),
        condition,
        variance[:, None, None] * unit,
        np.sqrt(variance * (1.0 / len(x) + x_mean @ unit @ x_mean)),
    )


def _rows(name: str, value: ArrayLike) -> np.ndarray:
    array = np.array(value, dtype=float)
    if array.ndim != 2 or array.shape[1] != 3:
        raise ValueError(f"{name} has to have the shape (N, 3), got {array.shape}")
    if not np.all(np.isfinite(array)):
        raise ValueError(f"{name} has to be finite, row {_first_bad(array)} is not")
    return array


def _first_bad(array: np.ndarray) -> int:
    return int(np.flatnonzero(~np.isfinite(array).all(axis=1))[0])
