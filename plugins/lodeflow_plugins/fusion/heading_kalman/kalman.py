"""A Kalman filter for the heading of an attitude without one, from the magnetic field.

The inclination of the attitude is taken as it is. Turned into its frame, z up, the field of the
earth should be constant but for a slow turn about z, which is the drift of the attitude's heading.
The state:

    delta   turn from the attitude's frame to magnetic east, north, up, rad
    r       its rate, rad/s, which decays with a time constant
    H, V    the undisturbed field to the north and upwards, tesla; a random walk
    d       the disturbance, in the attitude's frame, tesla; it decays within a fraction of a
            second, so what is left of a disturbance pulls at the heading like noise
    tau     how much the magnetometer lags the attitude, s

    measured:  turn(y, -tau w) = Rz(-delta) (0, H, V) + d + noise

with the mean field y and the mean angular rate w of a short interval. d stands in the attitude's
frame because there its estimate says nothing of delta: in an earth frame the filter would take its
own estimate of d for a landmark, and become sure of a heading that it does not know.

No measurement is rejected. Where the field is disturbed the filter coasts, because of two things:
an innovation beyond `surprise` opens d at once, and the level, the size of d relative to its usual
one, which rises at once and falls slowly, multiplies the noise of d.

A magnet on the body is a disturbance that stands still in the body's frame while the body turns.
The mean of d over some seconds is taken in both frames; where it keeps its length in the body's
and loses it in the attitude's, it is a hard iron, and is subtracted from then on. When the magnet
goes, the same test finds its negative.

Sources: heading after inclination, Laidig and Seel 2023, Information Fusion 91, 187-204; a decaying
disturbance as a state, Roetenberg et al. 2005, IEEE Trans. Neural Syst. Rehabil. Eng. 13(3)
395-405. The level, the drift, the lag and the test for a magnet are ours.
"""

import math

import numpy as np

from lodeflow_plugins.fusion.rotations import (
    Matrix,
    Vector,
    apply,
    inverse,
    kernel,
    three,
    transposed,
)

# What the filter remembers, a part of the state of `filter.run`.
DELTA, DRIFT, NORTH, UP, DISTURBANCE, LAG, SIZE = 0, 1, 2, 3, 4, 7, 8  # the states
P = SIZE  # covariance, by rows
G = P + SIZE * SIZE  # scratch: H P, (3, 8), by rows
LEVEL = G + 3 * SIZE
STANDING, CARRIED = LEVEL + 1, LEVEL + 4  # mean disturbance, in the attitude's frame, in the body's
POWER = LEVEL + 7  # mean square of the disturbance
PERSISTENT = LEVEL + 8  # for how long it has been large, s
HARD_IRON = LEVEL + 9  # in the body's frame, tesla
BELIEFS = LEVEL + 12  # size

UNKNOWN = math.pi**2 / 3.0
"""Variance of a heading of which nothing is known, rad^2."""
START_HEADING = (20.0 * math.pi / 180.0) ** 2  # variance of a heading measured for START seconds
START_FIELD = (10e-6) ** 2  # variance of a field measured for START seconds, tesla^2
HUGE = 30.0  # level above which the noise grows with its square: such a field says nothing
AVERAGED = 0.035  # fields are believed to be averaged over no longer, after a gap or with few, s
RISE = 0.1  # time constant with which the level rises, s
LARGE, REMAINING = 1.5**2, 0.7**2  # mean square over `disturbance`^2 that is tested, first and then
CARRIED_AT_LEAST, STANDING_AT_MOST = 0.8, 0.5  # squares of mean lengths over the mean square


@kernel
def begin(field: Vector, constants: np.ndarray, x: np.ndarray) -> None:
    """Start from the mean field in the attitude's frame."""
    for i in range(BELIEFS):
        x[i] = 0.0
    north = math.hypot(field[0], field[1])
    x[DELTA] = math.atan2(field[0], field[1])
    x[NORTH], x[UP] = north, field[2]
    x[P + 9 * NORTH] = x[P + 9 * UP] = START_FIELD
    x[P] = UNKNOWN
    if constants[4] < UNKNOWN * north * north:
        x[P] = min(START_HEADING + constants[4] / (north * north), UNKNOWN)
    x[P + 9 * DRIFT] = constants[1]
    for i in range(DISTURBANCE, DISTURBANCE + 3):
        x[P + 9 * i] = constants[4]
    x[P + 9 * LAG] = constants[9]
    x[LEVEL] = 1.0


@kernel
def predict(seconds: float, constants: np.ndarray, x: np.ndarray) -> None:
    """Let delta drift and the disturbance decay for a time."""
    decay_drift = math.exp(-seconds / constants[2])
    decay = math.exp(-seconds / constants[5])
    drifting = min(seconds, constants[2])
    x[DELTA] += drifting * x[DRIFT]
    x[DRIFT] *= decay_drift
    for j in range(SIZE):
        x[P + j] += drifting * x[P + SIZE + j]
        x[P + SIZE + j] *= decay_drift
    for i in range(SIZE):
        row = P + SIZE * i
        x[row] += drifting * x[row + DRIFT]
        x[row + DRIFT] *= decay_drift
    for i in range(DISTURBANCE, DISTURBANCE + 3):
        x[i] *= decay
        for j in range(SIZE):
            x[P + SIZE * i + j] *= decay
            x[P + SIZE * j + i] *= decay
    x[P + 9 * DELTA] += constants[0] * seconds
    x[P + 9 * DRIFT] += constants[1] * (1.0 - decay_drift * decay_drift)
    x[P + 9 * NORTH] += constants[3] * seconds
    x[P + 9 * UP] += constants[3] * seconds
    noise = constants[4] * (1.0 - decay * decay) * max(x[LEVEL], 1.0)
    noise *= max(x[LEVEL] / HUGE, 1.0)
    for i in range(DISTURBANCE, DISTURBANCE + 3):
        x[P + 9 * i] += noise


@kernel
def turned(v: Vector, w: Vector) -> Vector:
    """Return v turned by the rotation vector w (Rodrigues)."""
    angle = math.sqrt(w[0] * w[0] + w[1] * w[1] + w[2] * w[2])
    if angle < 1e-12:
        return v
    x, y, z = w[0] / angle, w[1] / angle, w[2] / angle
    c, s = math.cos(angle), math.sin(angle)
    along = (1.0 - c) * (x * v[0] + y * v[1] + z * v[2])
    return (
        c * v[0] + s * (y * v[2] - z * v[1]) + along * x,
        c * v[1] + s * (z * v[0] - x * v[2]) + along * y,
        c * v[2] + s * (x * v[1] - y * v[0]) + along * z,
    )


@kernel
def seen(x: np.ndarray, at: int, by_state: tuple[Vector, Vector, Vector]) -> Vector:
    """Return H v for the v (8,) at an index of x; by_state: columns of H for delta, H and tau."""
    delta, north, lag = by_state
    return (
        x[at] * delta[0] + x[at + NORTH] * north[0] + x[at + DISTURBANCE] + x[at + LAG] * lag[0],
        x[at] * delta[1]
        + x[at + NORTH] * north[1]
        + x[at + DISTURBANCE + 1]
        + x[at + LAG] * lag[1],
        x[at + UP] + x[at + DISTURBANCE + 2] + x[at + LAG] * lag[2],
    )


@kernel
def correct(y: Vector, w: Vector, seconds: float, constants: np.ndarray, x: np.ndarray) -> None:
    """Correct with the mean field y and the mean rate w, in the attitude's frame, over a time."""
    y = turned(y, (-x[LAG] * w[0], -x[LAG] * w[1], -x[LAG] * w[2]))
    sin, cos = math.sin(x[DELTA]), math.cos(x[DELTA])
    d = three(x, DISTURBANCE)
    b = x[NORTH] * sin + d[0], x[NORTH] * cos + d[1], x[UP] + d[2]
    e = y[0] - b[0], y[1] - b[1], y[2] - b[2]
    by_state = (
        (x[NORTH] * cos, -x[NORTH] * sin, 0.0),
        (sin, cos, 0.0),
        (w[1] * b[2] - w[2] * b[1], w[2] * b[0] - w[0] * b[2], w[0] * b[1] - w[1] * b[0]),
    )
    first, second, third = G, G + SIZE, G + 2 * SIZE
    for i in range(SIZE):
        x[first + i], x[second + i], x[third + i] = seen(x, P + SIZE * i, by_state)
    noise = constants[7] / min(seconds, max(2e-9 * constants[10], AVERAGED))
    u, v, z = seen(x, first, by_state), seen(x, second, by_state), seen(x, third, by_state)
    s = (u[0] + noise, u[1], u[2], u[1], v[1] + noise, v[2], u[2], v[2], z[2] + noise)
    gain = inverse(s)
    weighed = apply(gain, e)
    if e[0] * weighed[0] + e[1] * weighed[1] + e[2] * weighed[2] > 3.0 * constants[8]:
        opened = (e[0] * e[0] + e[1] * e[1] + e[2] * e[2]) / 3.0
        for i in range(3):
            x[P + 9 * (DISTURBANCE + i)] += opened
            x[G + SIZE * i + DISTURBANCE + i] += opened
        gain = inverse(
            (s[0] + opened, s[1], s[2], s[1], s[4] + opened, s[5], s[2], s[5], s[8] + opened)
        )

    level = (d[0] * d[0] + d[1] * d[1] + d[2] * d[2]) / (3.0 * constants[4])
    rise = seconds / (RISE if level > x[LEVEL] else constants[6])
    x[LEVEL] += (level - x[LEVEL]) * min(1.0, rise)
    for i in range(SIZE):
        k = apply(gain, (x[first + i], x[second + i], x[third + i]))
        x[i] += k[0] * e[0] + k[1] * e[1] + k[2] * e[2]
        row = P + SIZE * i
        for j in range(SIZE):
            x[row + j] -= k[0] * x[first + j] + k[1] * x[second + j] + k[2] * x[third + j]
    for i in range(SIZE):
        x[P + 9 * i] = max(x[P + 9 * i], 1e-20)
        for j in range(i):
            x[P + SIZE * j + i] = x[P + SIZE * i + j]
    x[P] = min(x[P], UNKNOWN)
    if x[NORTH] < 0.0 and x[NORTH] * x[NORTH] > 9.0 * x[P + 9 * NORTH]:
        x[NORTH] = -x[NORTH]  # it points south
        x[DELTA] += math.pi
        for i in range(SIZE):
            x[P + SIZE * i + NORTH] = -x[P + SIZE * i + NORTH]
            x[P + SIZE * NORTH + i] = -x[P + SIZE * NORTH + i]
    if abs(x[DELTA]) > math.pi:
        x[DELTA] -= 2.0 * math.pi * math.floor(x[DELTA] / (2.0 * math.pi) + 0.5)


@kernel
def square(v: Vector) -> float:
    """Return |v|^2."""
    return v[0] * v[0] + v[1] * v[1] + v[2] * v[2]


@kernel
def look_for_magnet(r: Matrix, seconds: float, constants: np.ndarray, x: np.ndarray) -> None:
    """Move what the body carries from the disturbance to the hard iron; r: attitude <- body."""
    weight = min(1.0, seconds / constants[17])
    d = three(x, DISTURBANCE)
    carried = apply(transposed(r), d)
    for i in range(3):
        x[STANDING + i] += weight * (d[i] - x[STANDING + i])
        x[CARRIED + i] += weight * (carried[i] - x[CARRIED + i])
    x[POWER] += weight * (square(d) - x[POWER])
    large = REMAINING if square(three(x, HARD_IRON)) > 0.0 else LARGE
    if x[POWER] < large * constants[4]:
        x[PERSISTENT] = 0.0
        return
    x[PERSISTENT] += seconds
    if (
        x[PERSISTENT] < constants[17]
        or square(three(x, CARRIED)) < CARRIED_AT_LEAST * x[POWER]
        or square(three(x, STANDING)) > STANDING_AT_MOST * x[POWER]
    ):
        return
    for i in range(3):
        x[HARD_IRON + i] += x[CARRIED + i]
        x[STANDING + i] = x[CARRIED + i] = 0.0
    x[POWER] = x[PERSISTENT] = 0.0
    if square(three(x, HARD_IRON)) < 0.25 * LARGE * constants[4]:
        x[HARD_IRON] = x[HARD_IRON + 1] = x[HARD_IRON + 2] = 0.0  # the magnet is gone
    x[LEVEL] = 1.0
    for i in range(DISTURBANCE, DISTURBANCE + 3):
        x[i] = 0.0
        for j in range(SIZE):
            x[P + SIZE * i + j] = x[P + SIZE * j + i] = 0.0
        x[P + 9 * i] = constants[4]


@kernel
def report(since: float, constants: np.ndarray, x: np.ndarray, out: np.ndarray) -> None:
    """Write what the filter believes, `since` s after the last step, into out (11,).

    Variance of the heading, rad^2; disturbance to the east, north and up, tesla; its level; lag, s;
    hard iron in the body frame, tesla; undisturbed field to the north and up, tesla.

    The variance is that of the Kalman filter with two additions, for a disturbance that lasts
    longer than the filter takes it to: it is multiplied by a level above one, and the angle by
    which a standing disturbance (and a field that is not the expected one) would turn north if it
    were horizontal is added: what turns north hides in the heading, so it may be as large.
    """
    drifting = min(since, constants[2])
    variance = x[P] + 2.0 * drifting * x[P + DRIFT] + drifting * drifting * x[P + 9 * DRIFT]
    variance = (variance + since * constants[0]) * max(x[LEVEL], 1.0)
    wrong = square(three(x, STANDING))
    if not math.isnan(constants[14]):
        north, up = x[NORTH] - constants[14], x[UP] - constants[15]
        wrong += max(north * north + up * up - constants[16], 0.0)
    variance += math.atan2(math.sqrt(wrong), abs(x[NORTH])) ** 2
    out[0] = min(variance, UNKNOWN)
    sin, cos = math.sin(x[DELTA]), math.cos(x[DELTA])
    d = three(x, DISTURBANCE)
    out[1], out[2], out[3] = cos * d[0] - sin * d[1], sin * d[0] + cos * d[1], d[2]
    out[4], out[5] = x[LEVEL], x[LAG]
    out[6], out[7], out[8] = three(x, HARD_IRON)
    out[9], out[10] = x[NORTH], x[UP]
