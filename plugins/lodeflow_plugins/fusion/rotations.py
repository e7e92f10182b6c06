"""Rotations and 3 x 3 matrices as tuples of floats, for compiled kernels.

A tuple lives in registers, where a small array costs an allocation. Quaternions are scalar last,
v_to = q v q*; matrices go by rows.
"""

import math

import numpy as np
from numba import njit

kernel = njit(cache=True, error_model="numpy")
"""Compile, kept on disk; a division by zero is infinite and not an exception, which is faster."""
inlined = njit(cache=True, error_model="numpy", forceinline=True)
"""Compile into the kernel that calls it, where what is constant there costs nothing."""

Vector = tuple[float, float, float]
Rotation = tuple[float, float, float, float]
Matrix = tuple[float, float, float, float, float, float, float, float, float]
Symmetric = tuple[float, float, float, float, float, float]
"""The lower triangle by rows."""

S1, S2, S3, S4, S5 = [(-1.0) ** k / math.factorial(2 * k + 1) for k in range(1, 6)]
C1, C2, C3, C4, C5, C6 = [(-1.0) ** k / math.factorial(2 * k) for k in range(1, 7)]
"""Taylor coefficients of sin(a) / a and cos(a) in the square of a."""


@inlined
def three(a: np.ndarray, at: int) -> Vector:
    """Return the vector at an index of an array."""
    return a[at], a[at + 1], a[at + 2]


@inlined
def four(a: np.ndarray, at: int) -> Rotation:
    """Return the quaternion at an index of an array."""
    return a[at], a[at + 1], a[at + 2], a[at + 3]


@inlined
def nine(a: np.ndarray, at: int) -> Matrix:
    """Return the matrix at an index of an array."""
    return (
        a[at], a[at + 1], a[at + 2],
        a[at + 3], a[at + 4], a[at + 5],
        a[at + 6], a[at + 7], a[at + 8],
    )  # fmt: skip


@inlined
def six(a: np.ndarray, at: int) -> Symmetric:
    """Return the symmetric matrix at an index of an array."""
    return a[at], a[at + 1], a[at + 2], a[at + 3], a[at + 4], a[at + 5]


@inlined
def multiply(a: Rotation, b: Rotation) -> Rotation:
    """Return the quaternion product a b."""
    return (
        a[3] * b[0] + a[0] * b[3] + a[1] * b[2] - a[2] * b[1],
        a[3] * b[1] - a[0] * b[2] + a[1] * b[3] + a[2] * b[0],
        a[3] * b[2] + a[0] * b[1] - a[1] * b[0] + a[2] * b[3],
        a[3] * b[3] - a[0] * b[0] - a[1] * b[1] - a[2] * b[2],
    )


@inlined
def renormalised(q: Rotation) -> Rotation:
    """Return q / |q| for a q whose length is 1 but for rounding: a step of Newton's method."""
    scale = 1.5 - 0.5 * (q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3])
    return scale * q[0], scale * q[1], scale * q[2], scale * q[3]


@inlined
def half_turn(square: float) -> tuple[float, float]:
    """Return sin(a) / a and cos(a) of an angle a, given its square.

    Up to a = 1/4, which is a turn by 29 degrees, by the Taylor series: exact to rounding, without
    root and division, and several times faster.
    """
    x = square
    if x > 0.0625:
        a = math.sqrt(x)
        return math.sin(a) / a, math.cos(a)
    sinc = S5 * x + S4
    cos = C6 * x + C5
    sinc, cos = sinc * x + S3, cos * x + C4
    sinc, cos = sinc * x + S2, cos * x + C3
    sinc, cos = sinc * x + S1, cos * x + C2
    return sinc * x + 1.0, (cos * x + C1) * x + 1.0


@inlined
def turn_by(v: Vector) -> Rotation:
    """Return the turn by a rotation vector, rad."""
    sinc, cos = half_turn(0.25 * (v[0] * v[0] + v[1] * v[1] + v[2] * v[2]))
    half = 0.5 * sinc
    return half * v[0], half * v[1], half * v[2], cos


@inlined
def rotate(q: Rotation, v: Vector) -> Vector:
    """Return q v q*."""
    x = 2.0 * (q[1] * v[2] - q[2] * v[1])
    y = 2.0 * (q[2] * v[0] - q[0] * v[2])
    z = 2.0 * (q[0] * v[1] - q[1] * v[0])
    return (
        v[0] + q[3] * x + q[1] * z - q[2] * y,
        v[1] + q[3] * y + q[2] * x - q[0] * z,
        v[2] + q[3] * z + q[0] * y - q[1] * x,
    )


@inlined
def turn_about_vertical(sin: float, cos: float, q: Rotation) -> Rotation:
    """Return q turned about z; sin, cos: of half the angle."""
    x, y, z, w = q
    return cos * x - sin * y, cos * y + sin * x, cos * z + sin * w, cos * w - sin * z


@inlined
def conjugate(q: Rotation) -> Rotation:
    """Return q*, the turn back."""
    return -q[0], -q[1], -q[2], q[3]


@inlined
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


@inlined
def apply(r: Matrix, v: Vector) -> Vector:
    """Return R v."""
    return (
        r[0] * v[0] + r[1] * v[1] + r[2] * v[2],
        r[3] * v[0] + r[4] * v[1] + r[5] * v[2],
        r[6] * v[0] + r[7] * v[1] + r[8] * v[2],
    )


@inlined
def dot(a: Vector, b: Vector) -> float:
    """Return a . b."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@inlined
def upright(v: Vector) -> tuple[Rotation, float, float]:
    """Return the shortest turn of v to the vertical, and x and y of the unit vector along v."""
    scale = 1.0 / math.sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2])
    x, y, z = scale * v[0], scale * v[1], scale * v[2]
    w = math.sqrt(max(0.0, 0.5 * (z + 1.0)))
    if w > 1e-6:
        half = 0.5 / w
        return (half * y, -half * x, 0.0, w), x, y
    return (1.0, 0.0, 0.0, 0.0), x, y  # upside down: about x, as good as any


@inlined
def cholesky(s: Symmetric) -> Symmetric:
    """Return L with L L^T = S, its diagonal inverted, for a positive definite S."""
    a = 1.0 / math.sqrt(s[0])
    b, d = a * s[1], a * s[3]
    c = 1.0 / math.sqrt(s[2] - b * b)
    e = c * (s[4] - d * b)
    return a, b, c, d, e, 1.0 / math.sqrt(s[5] - d * d - e * e)


@inlined
def solve(c: Symmetric, v: Vector) -> Vector:
    """Return L^-1 v, where c is what `cholesky` returned."""
    x = c[0] * v[0]
    y = c[2] * (v[1] - c[1] * x)
    return x, y, c[5] * (v[2] - c[3] * x - c[4] * y)
