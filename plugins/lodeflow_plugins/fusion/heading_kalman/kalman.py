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
    Rotation,
    Vector,
    cholesky,
    conjugate,
    dot,
    half_turn,
    inlined,
    kernel,
    rotate,
    solve,
    three,
    turn_by,
)

# What the filter remembers, a part of the state of `filter.run`.
DELTA, DRIFT, NORTH, UP, DISTURBANCE, LAG, SIZE = 0, 1, 2, 3, 4, 7, 8  # the states
P = SIZE  # covariance, the lower triangle by rows
G = P + SIZE * (SIZE + 1) // 2  # scratch: what each state has to do with the field, (8, 3)
LEVEL = G + SIZE * 3
STANDING, CARRIED = LEVEL + 1, LEVEL + 4  # mean disturbance, in the attitude's frame, in the body's
POWER = LEVEL + 7  # mean square of the disturbance
PERSISTENT = LEVEL + 8  # for how long it has been large, s
HARD_IRON = LEVEL + 9  # in the body's frame, tesla
SIN, COS = LEVEL + 12, LEVEL + 13  # of delta / 2
STEP = LEVEL + 14  # the time that the next two hold for, s
DECAY_DRIFT, DECAY = LEVEL + 15, LEVEL + 16  # what is left of the drift and of the disturbance
BELIEFS = LEVEL + 17  # size

UNKNOWN = math.pi**2 / 3.0
"""Variance of a heading of which nothing is known, rad^2."""
START_HEADING = (20.0 * math.pi / 180.0) ** 2  # variance of a heading measured for START seconds
START_FIELD = (10e-6) ** 2  # variance of a field measured for START seconds, tesla^2
HUGE = 30.0  # level above which the noise grows with its square: such a field says nothing
AVERAGED = 0.035  # fields are believed to be averaged over no longer, after a gap or with few, s
RISE = 0.1  # time constant with which the level rises, s
LARGE, REMAINING = 1.5**2, 0.7**2  # mean square over `disturbance`^2 that is tested, first and then
CARRIED_AT_LEAST, STANDING_AT_MOST = 0.8, 0.5  # squares of mean lengths over the mean square


@inlined
def covariance(i: int, j: int) -> int:
    """Return where the covariance of two states is."""
    row, column = max(i, j), min(i, j)
    return P + row * (row + 1) // 2 + column


@inlined
def face(delta: float, x: np.ndarray) -> None:
    """Set delta."""
    x[DELTA], x[SIN], x[COS] = delta, math.sin(0.5 * delta), math.cos(0.5 * delta)


@inlined
def facing(since: float, constants: np.ndarray, x: np.ndarray) -> tuple[float, float]:
    """Return sin and cos of delta / 2, `since` s after the last step."""
    half = 0.5 * min(since, constants[2]) * x[DRIFT]
    sinc, cos = half_turn(half * half)
    sin = half * sinc
    return cos * x[SIN] + sin * x[COS], cos * x[COS] - sin * x[SIN]


@kernel
def begin(field: Vector, constants: np.ndarray, x: np.ndarray) -> None:
    """Start from the mean field in the attitude's frame."""
    for i in range(BELIEFS):
        x[i] = 0.0
    north = math.hypot(field[0], field[1])
    face(math.atan2(field[0], field[1]), x)
    x[NORTH], x[UP] = north, field[2]
    x[covariance(NORTH, NORTH)] = x[covariance(UP, UP)] = START_FIELD
    x[P] = UNKNOWN
    if constants[4] < UNKNOWN * north * north:
        x[P] = min(START_HEADING + constants[4] / (north * north), UNKNOWN)
    x[covariance(DRIFT, DRIFT)] = constants[1]
    for i in range(DISTURBANCE, DISTURBANCE + 3):
        x[covariance(i, i)] = constants[4]
    x[covariance(LAG, LAG)] = constants[9]
    x[LEVEL] = 1.0


@inlined
def predict(seconds: float, constants: np.ndarray, x: np.ndarray) -> None:
    """Let delta drift and the disturbance decay for a time."""
    if seconds != x[STEP]:
        x[STEP] = seconds
        x[DECAY_DRIFT] = math.exp(-seconds / constants[2])
        x[DECAY] = math.exp(-seconds / constants[5])
    decay_drift, decay = x[DECAY_DRIFT], x[DECAY]
    drifting = min(seconds, constants[2])
    x[SIN], x[COS] = facing(seconds, constants, x)
    x[DELTA] += drifting * x[DRIFT]
    x[DRIFT] *= decay_drift
    own, shared = covariance(DRIFT, DRIFT), covariance(DELTA, DRIFT)
    x[P] += drifting * (2.0 * x[shared] + drifting * x[own])
    x[shared] = decay_drift * (x[shared] + drifting * x[own])
    x[own] *= decay_drift * decay_drift
    for i in range(DRIFT + 1, SIZE):
        x[covariance(DELTA, i)] += drifting * x[covariance(DRIFT, i)]
        x[covariance(DRIFT, i)] *= decay_drift
    for i in range(DISTURBANCE, DISTURBANCE + 3):
        x[i] *= decay
        for j in range(DISTURBANCE):
            x[covariance(i, j)] *= decay
        for j in range(DISTURBANCE, i + 1):
            x[covariance(i, j)] *= decay * decay
        x[covariance(LAG, i)] *= decay
    x[P] += constants[0] * seconds
    x[own] += constants[1] * (1.0 - decay_drift * decay_drift)
    x[covariance(NORTH, NORTH)] += constants[3] * seconds
    x[covariance(UP, UP)] += constants[3] * seconds
    noise = constants[4] * (1.0 - decay * decay) * max(x[LEVEL], 1.0)
    noise *= max(x[LEVEL] / HUGE, 1.0)
    for i in range(DISTURBANCE, DISTURBANCE + 3):
        x[covariance(i, i)] += noise


@inlined
def seen(i: int, by_state: tuple[Vector, Vector, Vector], x: np.ndarray) -> Vector:
    """Return H p for a column p of the covariance; by_state: H by delta, the field and tau."""
    a, b, c = by_state
    delta, lag = x[covariance(i, DELTA)], x[covariance(i, LAG)]
    north, up = x[covariance(i, NORTH)], x[covariance(i, UP)]
    return (
        delta * a[0] + north * b[0] + x[covariance(i, DISTURBANCE)] + lag * c[0],
        delta * a[1] + north * b[1] + x[covariance(i, DISTURBANCE + 1)] + lag * c[1],
        up + x[covariance(i, DISTURBANCE + 2)] + lag * c[2],
    )


@inlined
def correct(y: Vector, w: Vector, seconds: float, constants: np.ndarray, x: np.ndarray) -> None:
    """Correct with the mean field y and the mean rate w, in the attitude's frame, over a time.

    With the root L of the innovation's covariance and a = L^-1 H p of each column p, the update
    of the covariance is minus a . a for each two states: symmetric to the last bit.
    """
    y = rotate(turn_by((-x[LAG] * w[0], -x[LAG] * w[1], -x[LAG] * w[2])), y)
    sin, cos = 2.0 * x[SIN] * x[COS], x[COS] * x[COS] - x[SIN] * x[SIN]
    d = three(x, DISTURBANCE)
    b = x[NORTH] * sin + d[0], x[NORTH] * cos + d[1], x[UP] + d[2]
    e = y[0] - b[0], y[1] - b[1], y[2] - b[2]
    by_state = (
        (x[NORTH] * cos, -x[NORTH] * sin, 0.0),
        (sin, cos, 0.0),
        (w[1] * b[2] - w[2] * b[1], w[2] * b[0] - w[0] * b[2], w[0] * b[1] - w[1] * b[0]),
    )
    for i in range(SIZE):
        x[G + 3 * i], x[G + 3 * i + 1], x[G + 3 * i + 2] = seen(i, by_state, x)
    at_delta, at_north, at_lag = three(x, G), three(x, G + 3 * NORTH), three(x, G + 3 * LAG)
    at_up, at_d = three(x, G + 3 * UP), G + 3 * DISTURBANCE
    turn, length, late = by_state
    noise = constants[7] / min(seconds, max(2e-9 * constants[10], AVERAGED))
    s00 = at_delta[0] * turn[0] + at_north[0] * length[0] + x[at_d] + at_lag[0] * late[0] + noise
    s10 = at_delta[0] * turn[1] + at_north[0] * length[1] + x[at_d + 3] + at_lag[0] * late[1]
    s11 = (
        at_delta[1] * turn[1] + at_north[1] * length[1] + x[at_d + 4] + at_lag[1] * late[1] + noise
    )
    s20 = at_up[0] + x[at_d + 6] + at_lag[0] * late[2]
    s21 = at_up[1] + x[at_d + 7] + at_lag[1] * late[2]
    s22 = at_up[2] + x[at_d + 8] + at_lag[2] * late[2] + noise
    root = cholesky((s00, s10, s11, s20, s21, s22))
    u = solve(root, e)
    if dot(u, u) > 3.0 * constants[8]:
        opened = dot(e, e) / 3.0
        for i in range(3):
            x[covariance(DISTURBANCE + i, DISTURBANCE + i)] += opened
            x[at_d + 4 * i] += opened
        root = cholesky((s00 + opened, s10, s11 + opened, s20, s21, s22 + opened))
        u = solve(root, e)

    level = dot(d, d) / (3.0 * constants[4])
    rise = seconds / (RISE if level > x[LEVEL] else constants[6])
    x[LEVEL] += (level - x[LEVEL]) * min(1.0, rise)
    at = P
    for i in range(SIZE):
        a = solve(root, three(x, G + 3 * i))
        x[G + 3 * i], x[G + 3 * i + 1], x[G + 3 * i + 2] = a
        x[i] += dot(a, u)
        for j in range(i + 1):
            x[at] -= dot(a, three(x, G + 3 * j))
            at += 1
        x[at - 1] = max(x[at - 1], 1e-20)
    x[P] = min(x[P], UNKNOWN)
    if x[NORTH] < 0.0 and x[NORTH] * x[NORTH] > 9.0 * x[covariance(NORTH, NORTH)]:
        x[NORTH] = -x[NORTH]  # it points south
        x[DELTA] += math.pi
        for i in range(SIZE):
            if i != NORTH:
                x[covariance(i, NORTH)] = -x[covariance(i, NORTH)]
    if abs(x[DELTA]) > math.pi:
        x[DELTA] -= 2.0 * math.pi * math.floor(x[DELTA] / (2.0 * math.pi) + 0.5)
    face(x[DELTA], x)


@inlined
def square(x: np.ndarray, at: int) -> float:
    """Return |v|^2 of the vector at an index of x."""
    return dot(three(x, at), three(x, at))


@inlined
def look_for_magnet(q: Rotation, seconds: float, constants: np.ndarray, x: np.ndarray) -> None:
    """Move what the body carries from the disturbance to the hard iron; q: attitude <- body."""
    weight = min(1.0, seconds / constants[17])
    d = three(x, DISTURBANCE)
    carried = rotate(conjugate(q), d)
    for i in range(3):
        x[STANDING + i] += weight * (d[i] - x[STANDING + i])
        x[CARRIED + i] += weight * (carried[i] - x[CARRIED + i])
    x[POWER] += weight * (dot(d, d) - x[POWER])
    large = REMAINING if square(x, HARD_IRON) > 0.0 else LARGE
    if x[POWER] < large * constants[4]:
        x[PERSISTENT] = 0.0
        return
    x[PERSISTENT] += seconds
    if (
        x[PERSISTENT] < constants[17]
        or square(x, CARRIED) < CARRIED_AT_LEAST * x[POWER]
        or square(x, STANDING) > STANDING_AT_MOST * x[POWER]
    ):
        return
    for i in range(3):
        x[HARD_IRON + i] += x[CARRIED + i]
        x[STANDING + i] = x[CARRIED + i] = 0.0
    x[POWER] = x[PERSISTENT] = 0.0
    if square(x, HARD_IRON) < 0.25 * LARGE * constants[4]:
        x[HARD_IRON] = x[HARD_IRON + 1] = x[HARD_IRON + 2] = 0.0  # the magnet is gone
    x[LEVEL] = 1.0
    for i in range(DISTURBANCE, DISTURBANCE + 3):
        x[i] = 0.0
        for j in range(SIZE):
            x[covariance(i, j)] = 0.0
        x[covariance(i, i)] = constants[4]


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
    variance = x[P] + 2.0 * drifting * x[covariance(DELTA, DRIFT)]
    variance += drifting * drifting * x[covariance(DRIFT, DRIFT)]
    variance = (variance + since * constants[0]) * max(x[LEVEL], 1.0)
    wrong = square(x, STANDING)
    if not math.isnan(constants[14]):
        north, up = x[NORTH] - constants[14], x[UP] - constants[15]
        wrong += max(north * north + up * up - constants[16], 0.0)
    variance += math.atan2(math.sqrt(wrong), abs(x[NORTH])) ** 2
    out[0] = min(variance, UNKNOWN)
    sin, cos = 2.0 * x[SIN] * x[COS], x[COS] * x[COS] - x[SIN] * x[SIN]
    d = three(x, DISTURBANCE)
    out[1], out[2], out[3] = cos * d[0] - sin * d[1], sin * d[0] + cos * d[1], d[2]
    out[4], out[5] = x[LEVEL], x[LAG]
    out[6], out[7], out[8] = three(x, HARD_IRON)
    out[9], out[10] = x[NORTH], x[UP]
