"""Rotations and 3 x 3 matrices as tuples of floats, for compiled kernels.

A tuple lives in registers, where a small array costs an allocation. Quaternions are scalar last,
v_to = q v q*; matrices go by rows.
"""

import math

import numpy as np
from numba import njit

kernel = njit(cache=True, error_model="numpy")
"""Compile, kept on disk; a division by zero is infinite and not an exception, which is faster."""

Vector = tuple[float, float, float]
Rotation = tuple[float, float, float, float]
Matrix = tuple[float, float, float, float, float, float, float, float, float]


@kernel
def three(a: np.ndarray, at: int) -> Vector:
    """Return the vector at an index of an array."""
    return a[at], a[at + 1], a[at + 2]


@kernel
def four(a: np.ndarray, at: int) -> Rotation:
    """Return the quaternion at an index of an array."""
    return a[at], a[at + 1], a[at + 2], a[at + 3]


@kernel
def nine(a: np.ndarray, at: int) -> Matrix:
    """Return the matrix at an index of an array."""
    return (
        a[at], a[at + 1], a[at + 2],
        a[at + 3], a[at + 4], a[at + 5],
        a[at + 6], a[at + 7], a[at + 8],
    )  # fmt: skip


@kernel
def multiply(a: Rotation, b: Rotation) -> Rotation:
    """Return the quaternion product a b, normalised."""
    x = a[3] * b[0] + a[0] * b[3] + a[1] * b[2] - a[2] * b[1]
    y = a[3] * b[1] - a[0] * b[2] + a[1] * b[3] + a[2] * b[0]
    z = a[3] * b[2] + a[0] * b[1] - a[1] * b[0] + a[2] * b[3]
    w = a[3] * b[3] - a[0] * b[0] - a[1] * b[1] - a[2] * b[2]
    scale = 1.0 / math.sqrt(x * x + y * y + z * z + w * w)
    return scale * x, scale * y, scale * z, scale * w


@kernel
def conjugate(q: Rotation) -> Rotation:
    """Return q*, the turn back."""
    return -q[0], -q[1], -q[2], q[3]


@kernel
def matrix(q: Rotation) -> Matrix:
    """Return the rotation matrix of q, by rows."""
    x, y, z, w = q
    return (
        1.0 - 2.0 * (y * y + z * z),
        2.0 * (x * y - w * z),
        2.0 * (x * z + w * y),
        2.0 * (x * y + w * z),
        1.0 - 2.0 * (x * x + z * z),
        2.0 * (y * z - w * x),
        2.0 * (x * z - w * y),
        2.0 * (y * z + w * x),
        1.0 - 2.0 * (x * x + y * y),
    )


@kernel
def apply(r: Matrix, v: Vector) -> Vector:
    """Return R v."""
    return (
        r[0] * v[0] + r[1] * v[1] + r[2] * v[2],
        r[3] * v[0] + r[4] * v[1] + r[5] * v[2],
        r[6] * v[0] + r[7] * v[1] + r[8] * v[2],
    )


@kernel
def upright(v: Vector) -> tuple[Rotation, float, float]:
    """Return the shortest turn of v to the vertical, and x and y of the unit vector along v."""
    scale = 1.0 / math.sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2])
    x, y, z = scale * v[0], scale * v[1], scale * v[2]
    w = math.sqrt(max(0.0, 0.5 * (z + 1.0)))
    if w > 1e-6:
        return (0.5 * y / w, -0.5 * x / w, 0.0, w), x, y
    return (1.0, 0.0, 0.0, 0.0), x, y  # upside down: about x, as good as any


@kernel
def inverse(s: Matrix) -> Matrix:
    """Return S^-1 for a symmetric positive definite S."""
    a, b, c = s[4] * s[8] - s[5] * s[5], s[2] * s[5] - s[1] * s[8], s[1] * s[5] - s[2] * s[4]
    d = 1.0 / (s[0] * a + s[1] * b + s[2] * c)
    e, f, g = s[0] * s[8] - s[2] * s[2], s[1] * s[2] - s[0] * s[5], s[0] * s[4] - s[1] * s[1]
    return a * d, b * d, c * d, b * d, e * d, f * d, c * d, f * d, g * d


@kernel
def product(a: Matrix, b: Matrix) -> Matrix:
    """Return A B."""
    return (
        a[0] * b[0] + a[1] * b[3] + a[2] * b[6],
        a[0] * b[1] + a[1] * b[4] + a[2] * b[7],
        a[0] * b[2] + a[1] * b[5] + a[2] * b[8],
        a[3] * b[0] + a[4] * b[3] + a[5] * b[6],
        a[3] * b[1] + a[4] * b[4] + a[5] * b[7],
        a[3] * b[2] + a[4] * b[5] + a[5] * b[8],
        a[6] * b[0] + a[7] * b[3] + a[8] * b[6],
        a[6] * b[1] + a[7] * b[4] + a[8] * b[7],
        a[6] * b[2] + a[7] * b[5] + a[8] * b[8],
    )


@kernel
def transposed(a: Matrix) -> Matrix:
    """Return A^T."""
    return a[0], a[3], a[6], a[1], a[4], a[7], a[2], a[5], a[8]
