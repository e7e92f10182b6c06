"""Linear Kalman filter on the attitude quaternion.

Source: Chu et al. 2017, Magnetic orientation system based on magnetometer, accelerometer and
gyroscope, CAAI Transactions on Intelligence Technology 2(4), Eqs. 18-29. Where the print is not
consistent in itself, this file follows the derivation, and says so.

The state is the quaternion q = (x, y, z, w), scalar last, with v_earth = q v q*. It is predicted
with the angular rate in the body frame and corrected with a measured quaternion, such as that of
a tilt-compensated compass. Any earth frame and any body frame will do, as long as the rate and
the measurement mean the same ones. There is no state for a bias of the gyroscope.

Near the fixed point the filter follows the measurement with the time constant
2 sqrt(measurement_variance) / gyro_noise, in seconds, at any sampling rate.
"""

import math

import numpy as np
from numba import njit

# The state of `run`: quaternion, covariance by rows, started (0 or 1), last stamp. The stamp is
# kept as two numbers, because float64 cannot hold nanoseconds since 1970.
QUATERNION = slice(0, 4)
COVARIANCE = slice(4, 20)
STARTED = 20
SECONDS = 21
NANOSECONDS = 22
STATE_SIZE = 23

SECOND = 1_000_000_000

# The steps of `run` are inlined by numba, which takes a third off its time.


def new_state() -> np.ndarray:
    """State of a filter that has seen nothing, float64 (23,)."""
    return np.zeros(STATE_SIZE)


def constants(
    gyro_noise: float, measurement_variance: float, initial_variance: float
) -> np.ndarray:
    """Constants of `run`, float64 (3,).

    gyro_noise: standard deviation of each axis of the angular rate, rad/s, per sample.
    measurement_variance: variance of each component of the measured quaternion (R = r I).
    initial_variance: variance of each component of the first estimate.

    Raises ValueError when gyro_noise or initial_variance is negative, when measurement_variance
    is not positive, or when one of them is not finite.
    """
    if not (math.isfinite(gyro_noise) and gyro_noise >= 0.0):
        raise ValueError(f"gyro_noise must be finite and not negative, got {gyro_noise!r}")
    if not (math.isfinite(measurement_variance) and measurement_variance > 0.0):
        raise ValueError(
            f"measurement_variance must be finite and positive, got {measurement_variance!r}"
        )
    if not (math.isfinite(initial_variance) and initial_variance >= 0.0):
        raise ValueError(
            f"initial_variance must be finite and not negative, got {initial_variance!r}"
        )
    return np.array([gyro_noise**2, measurement_variance, initial_variance])


@njit(cache=True, inline="always")
def transition(rate: np.ndarray, dt: float, a: np.ndarray) -> None:
    """Write A = I + Omega(w) dt into a (4, 4). Eqs. 19, 21 and 24.

    Omega holds the factor 1/2. Eq. 21 is the negative of the usual cross product matrix; with the
    usual one the filter turns the wrong way and diverges.
    """
    x, y, z = 0.5 * dt * rate[0], 0.5 * dt * rate[1], 0.5 * dt * rate[2]
    a[0, 0], a[0, 1], a[0, 2], a[0, 3] = 1.0, z, -y, x
    a[1, 0], a[1, 1], a[1, 2], a[1, 3] = -z, 1.0, x, y
    a[2, 0], a[2, 1], a[2, 2], a[2, 3] = y, -x, 1.0, z
    a[3, 0], a[3, 1], a[3, 2], a[3, 3] = -x, -y, -z, 1.0


@njit(cache=True, inline="always")
def process_noise(q: np.ndarray, dt: float, gyro_variance: float, noise: np.ndarray) -> None:
    """Write Q = (dt/2)^2 sigma^2 Xi Xi^T into noise (4, 4). Eqs. 25 and 26.

    Xi(q) = [q4 I + [qv x]; -qv^T], the matrix with Omega(w) q = Xi w / 2, gives
    Xi Xi^T = I - q q^T. The matrix printed in Eq. 25 has wrong signs: its q^T Xi is not zero.
    """
    scale = (0.5 * dt) ** 2 * gyro_variance
    for i in range(4):
        for j in range(4):
            noise[i, j] = scale * ((1.0 if i == j else 0.0) - q[i] * q[j])


@njit(cache=True, inline="always")
def predict(
    x: np.ndarray, p: np.ndarray, a: np.ndarray, noise: np.ndarray, work: np.ndarray
) -> None:
    """Replace x by A x and P by A P A^T + Q, in place. The first two lines of Eq. 29.

    The print has x_k^- = A x_{k-1}^-; the posterior x_{k-1} is meant. work: (4, 4), overwritten.
    """
    for i in range(4):
        work[0, i] = a[i, 0] * x[0] + a[i, 1] * x[1] + a[i, 2] * x[2] + a[i, 3] * x[3]
    for i in range(4):
        x[i] = work[0, i]
    for i in range(4):
        for j in range(4):
            work[i, j] = (
                a[i, 0] * p[0, j] + a[i, 1] * p[1, j] + a[i, 2] * p[2, j] + a[i, 3] * p[3, j]
            )
    for i in range(4):
        for j in range(i + 1):
            p[i, j] = noise[i, j] + (
                work[i, 0] * a[j, 0]
                + work[i, 1] * a[j, 1]
                + work[i, 2] * a[j, 2]
                + work[i, 3] * a[j, 3]
            )
            p[j, i] = p[i, j]


@njit(cache=True, inline="always")
def gain(p: np.ndarray, r: float, factor: np.ndarray, k: np.ndarray) -> None:
    """Write K = P (P + R)^-1 into k (4, 4), for H = I and R = r I. The third line of Eq. 29.

    P and (P + R)^-1 commute, so K also solves (P + R) K = P, by Cholesky factors P + R = L L^T.
    factor: (4, 4), overwritten; L with the inverses of its diagonal.
    """
    for j in range(4):
        pivot = p[j, j] + r
        for m in range(j):
            pivot -= factor[j, m] * factor[j, m]
        factor[j, j] = 1.0 / math.sqrt(pivot)
        for i in range(j + 1, 4):
            value = p[i, j]
            for m in range(j):
                value -= factor[i, m] * factor[j, m]
            factor[i, j] = value * factor[j, j]
    for c in range(4):
        for i in range(4):  # L y = column c of P
            value = p[i, c]
            for m in range(i):
                value -= factor[i, m] * k[m, c]
            k[i, c] = value * factor[i, i]
        for i in range(3, -1, -1):  # L^T k = y
            value = k[i, c]
            for m in range(i + 1, 4):
                value -= factor[m, i] * k[m, c]
            k[i, c] = value * factor[i, i]


@njit(cache=True, inline="always")
def update(
    x: np.ndarray, p: np.ndarray, z: np.ndarray, r: float, factor: np.ndarray, k: np.ndarray
) -> None:
    """Replace x by x + K (z - x) and P by (I - K) P, in place. The last two lines of Eq. 29.

    z and -z are the same attitude, and Euler angles turn into either (Eq. 27); only the one on
    the side of x is near it. With R = r I, K = P (P + r I)^-1 gives (I - K) P = r K (H = I).
    """
    gain(p, r, factor, k)
    side = z[0] * x[0] + z[1] * x[1] + z[2] * x[2] + z[3] * x[3]
    sign = 1.0 if side >= 0.0 else -1.0
    e0, e1, e2, e3 = sign * z[0] - x[0], sign * z[1] - x[1], sign * z[2] - x[2], sign * z[3] - x[3]
    for i in range(4):
        x[i] += k[i, 0] * e0 + k[i, 1] * e1 + k[i, 2] * e2 + k[i, 3] * e3
        for j in range(i + 1):
            p[i, j] = r * k[i, j]
            p[j, i] = p[i, j]


@njit(cache=True)
def run(
    t: np.ndarray,
    rate: np.ndarray,
    measured: np.ndarray,
    row: np.ndarray,
    constants: np.ndarray,
    state: np.ndarray,
    out: np.ndarray,
) -> int:
    """Filter the rows of a block; any split into blocks gives the same bytes.

    t: int64 (N,), stamps in ns, strictly increasing over all calls.
    rate: (N, 3), angular rate in the body frame, rad/s, taken for the time since the last stamp.
    measured: (M, 4), measured unit quaternions, scalar last; row: int64 (N,), the row of
    `measured` that belongs to each stamp, or -1 for none (predict only).
    constants, state: of `constants()` and `new_state()`; state is written.
    out: (N, 4), written with unit quaternions from the returned row on, with w >= 0.

    Returns the first row that has an estimate: the first with a measurement, which starts the
    filter, or 0 when it has started before, or N when it has not started yet.
    """
    gyro_variance, r, initial_variance = constants[0], constants[1], constants[2]
    x = state[QUATERNION]
    p = state[COVARIANCE].reshape(4, 4)
    n = len(t)
    first = 0
    k = 0
    if state[STARTED] == 0.0:
        while k < n and row[k] < 0:
            k += 1
        if k == n:
            return n
        for i in range(4):
            x[i] = measured[row[k], i]
            p[i, i] = initial_variance
        state[STARTED] = 1.0
        first = k
        last = t[k]
    else:
        last = np.int64(state[SECONDS]) * SECOND + np.int64(state[NANOSECONDS])

    a = np.empty((4, 4))
    noise = np.empty((4, 4))
    work = np.empty((4, 4))
    k_gain = np.empty((4, 4))
    for k in range(first, n):
        if t[k] > last:  # not the row that started the filter
            dt = 1e-9 * (t[k] - last)
            last = t[k]
            transition(rate[k], dt, a)
            process_noise(x, dt, gyro_variance, noise)
            predict(x, p, a, noise, work)
            if row[k] >= 0:
                update(x, p, measured[row[k]], r, work, k_gain)
        # Neither step keeps the norm, and Eq. 30 needs it.
        scale = 1.0 / math.sqrt(x[0] * x[0] + x[1] * x[1] + x[2] * x[2] + x[3] * x[3])
        sign = 1.0 if x[3] >= 0.0 else -1.0
        for i in range(4):
            x[i] *= scale
            out[k, i] = sign * x[i]
    state[SECONDS] = last // SECOND
    state[NANOSECONDS] = last % SECOND
    return first
