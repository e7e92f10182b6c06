"""Affine error models of a magnetometer, an accelerometer and a gyroscope.

Source: Chu et al. 2017, Magnetic orientation system based on magnetometer, accelerometer and
gyroscope, CAAI Transactions on Intelligence Technology 2(4), Eqs. 6, 7, 8 and 12.

All three sensors are affine maps between a body vector and raw counts (LSB). They differ only in
how the paper writes the map down, and in its direction:

    magnetometer, Eq. 6       h^b -> raw     raw = K M h^b + b      (inverse: Eq. 7)
    accelerometer, Eq. 8      raw -> A^b     A^b = A raw + A0
    gyroscope, Eq. 12         raw -> w^b     w^b = K[:3]^T raw + K[3]

The paper's frames: h^b and w^b in FRD (x forward, y right, z down), A^b in FLU (y left, z up).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike


@dataclass(frozen=True, eq=False)
class Affine:
    """The map x -> matrix x + offset of vectors (..., 3); matrix (3, 3), offset (3,).

    A row gives the same bits whatever the number of rows around it.
    """

    matrix: np.ndarray
    offset: np.ndarray

    def __call__(self, vector: np.ndarray) -> np.ndarray:
        """Map vectors (..., 3)."""
        # Not vector @ matrix.T: a product of one row has other bits than one of many.
        return (self.matrix @ vector[..., None])[..., 0] + self.offset

    def inverse(self) -> Affine:
        """The map back. Raises ValueError when the matrix is singular."""
        try:
            matrix = np.linalg.inv(self.matrix)
        except np.linalg.LinAlgError:
            raise ValueError(
                f"the matrix of a sensor model has to be invertible, got {self.matrix.tolist()}"
            ) from None
        return Affine(matrix, -(matrix @ self.offset))


def magnetometer(sensitivity: ArrayLike, misalignment: ArrayLike, bias: ArrayLike) -> Affine:
    """Map of the field h^b (FRD) to raw counts: K M h^b + b, Eq. 6. Its inverse is Eq. 7.

    sensitivity: (3,), the diagonal of K, LSB per unit of field.
    misalignment: M (3, 3); each row is the unit vector of a sensor axis in the body frame, that
    is the cosines of Table 1. The rows need not be orthogonal.
    bias: (3,), LSB; offset of the sensor and hard iron.

    Raises ValueError for other shapes, values that are not finite, a sensitivity that is not
    positive, or rows of M whose norm is off 1 by more than 0.0005.
    """
    k = _checked("sensitivity", sensitivity, (3,))
    m = _checked("misalignment", misalignment, (3, 3))
    b = _checked("bias", bias, (3,))
    if not np.all(k > 0.0):
        raise ValueError(f"sensitivity has to be positive on each axis, got {k.tolist()}")
    norms = np.linalg.norm(m, axis=1)
    if not np.all(np.abs(norms - 1.0) < 0.0005):
        raise ValueError(
            f"the rows of misalignment have to be unit vectors, norms {norms.tolist()}"
        )
    return Affine(k[:, None] * m, b)


def accelerometer(gain: ArrayLike, offset: ArrayLike) -> Affine:
    """Map of raw counts to the specific force A^b (FLU): A raw + A0, Eq. 8.

    gain: A (3, 3), g per LSB; offset: A0 (3,), g.
    Raises ValueError for other shapes or values that are not finite.
    """
    return Affine(_checked("gain", gain, (3, 3)), _checked("offset", offset, (3,)))


def gyroscope(k: ArrayLike) -> Affine:
    """Map of raw counts to the angular rate w^b (FRD): K[:3]^T raw + K[3], Eqs. 12 and 14.

    k: K (4, 3); the first three rows are the transposed gain, the last row is the bias.
    (Eq. 12 prints the scale of the x axis three times; each axis has its own.)
    Raises ValueError for another shape or values that are not finite.
    """
    k = _checked("k", k, (4, 3))
    return Affine(np.ascontiguousarray(k[:3].T), k[3].copy())


def _checked(name: str, value: ArrayLike, shape: tuple[int, ...]) -> np.ndarray:
    array = np.array(value, dtype=float)
    if array.shape != shape:
        raise ValueError(f"{name} has to have the shape {shape}, got {array.shape}")
    if not np.all(np.isfinite(array)):
        raise ValueError(f"{name} has to be finite, got {array.tolist()}")
    return array
