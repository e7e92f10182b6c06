"""Attitude from angular rate and specific force, with the bias of the gyroscope.

Source: Laidig and Seel 2023, VQF: Highly accurate IMU orientation estimation with bias estimation
and magnetic disturbance rejection, Information Fusion 91, 187-204: strapdown integration,
inclination correction in an almost-inertial frame, rest detection, and a Kalman filter for the
bias at rest and in motion. This is their filter without magnetometer, with the same numbers to
rounding. The form is ours: each sample counts for the time since the one before, so that gaps and
uneven stamps are right, and the low-passes are trapezoidal steps of the analogue filter whose
state (output and slope) means the same at any interval.

Three frames: body; I, where integrating the rate alone gives the attitude, so that it turns
slowly against the earth; earth, with z up and a heading that nothing measures: it starts
anywhere and drifts. Quaternions are scalar last, v_to = q v q*. The specific force is low-passed
in I, where a body that moves about and comes back has no mean acceleration.
"""

import math

import numpy as np

from lodeflow_plugins.fusion.rotations import (
    Matrix,
    Rotation,
    Vector,
    apply,
    cholesky,
    dot,
    four,
    inlined,
    kernel,
    matrix,
    multiply,
    nine,
    renormalised,
    rotate,
    six,
    solve,
    three,
    turn_by,
    upright,
)
from lodeflow_plugins.fusion.stamps import SECOND, keep_stamp, stamp_of

# The state of `run`: the last stamp; durations in whole nanoseconds; the filter; the constants.
SAMPLES = 2  # 0, 1, or 2 for more
SINCE_FORCE = 3  # since the last sample with a specific force
STILL = 4  # since the last sign of motion
RESTING = 5  # 0 or 1
TURN = 6  # quaternion, I <- body
LEVEL = 10  # quaternion, earth <- I
BIAS = 14
COVARIANCE = 17  # of the bias, the lower triangle by rows
INTERVAL = 23  # for which the next six hold
REST_COEFFICIENT, REST_SCALE, FORCE_COEFFICIENT, FORCE_SCALE = 24, 25, 26, 27
GROWTH, PER_SECOND = 28, 29
FIRST = 30  # rate and force of the first sample
# Banks of low-passes: number of samples and duration of the beginning, then outputs, slopes and
# last inputs of the components. For the detection of rest: rate, specific force. In I: specific
# force. R(earth <- body) by rows, and x and y of R bias, to see the bias as the force shows it.
REST_RATE, REST_FORCE, INERTIAL_FORCE, ROTATION = 36, 47, 58, 69
OUTPUT = 2  # offset in a bank
LANES = ROTATION + OUTPUT
SCRATCH = 104  # new inputs of a bank
DUE = 115  # time until the bias is reported
REPORT, CHANGE = 116, 117  # 1 where the last sample has a report, or another RESTING
CONSTANTS = 118
STATE_SIZE = CONSTANTS + 12

ROWS = ((0, 1, 3), (1, 2, 4), (3, 4, 5))
"""Where the elements of a symmetric matrix are in its lower triangle."""
COVARIANCES = np.array(ROWS) + COVARIANCE
"""Where those of the bias's covariance are in the state, (3, 3)."""

SETTLED = 0.1 * math.pi / 180.0
"""Bias standard deviation that the system noise adds in the forgetting time, rad/s; the unit in
which the paper counts forgetting."""


def new_state(constants: np.ndarray) -> np.ndarray:
    """State of a filter that has seen nothing, float64 (130,)."""
    state = np.zeros(STATE_SIZE)
    state[TURN + 3] = state[LEVEL + 3] = 1.0
    state[CONSTANTS:] = constants
    return state


def constants(
    *,
    force_time_constant: float,
    rest_time_constant: float,
    rest_duration: float,
    rest_rate: float,
    rest_force: float,
    bias_initial: float,
    bias_forgetting: float,
    bias_limit: float,
    bias_motion: float,
    bias_rest: float,
    bias_vertical: float,
    report_interval: float,
) -> np.ndarray:
    """Constants of the filter, float64 (12,).

    force_time_constant: of the low-pass of the specific force in I, s.
    rest_time_constant: of the low-passes from which a body at rest deviates little, s.
    rest_duration: how long the deviations must be small, s.
    rest_rate, rest_force: largest deviations at rest, rad/s and m/s^2; no rest if zero.
    bias_initial: standard deviation of the bias at the start, rad/s.
    bias_forgetting: time in which its variance grows from zero to that of 0.1 deg/s, s.
    bias_limit: largest bias on each axis, rad/s.
    bias_motion, bias_rest: standard deviation to which the bias converges in motion and at rest,
        rad/s; none is estimated in motion if bias_motion is zero.
    bias_vertical: weight of the assumption, made in motion, that the bias about the vertical is
        zero, as a factor of the weight of the measurement about a horizontal axis.
    report_interval: between reports of the bias, s; 0 for all samples.
    """
    return np.array(
        [
            force_time_constant * SECOND,
            rest_time_constant * SECOND,
            rest_duration * SECOND,
            rest_rate**2,
            rest_force**2,
            bias_limit,
            bias_initial**2,
            SETTLED**2 / bias_forgetting,
            bias_motion**2,
            bias_rest**2,
            bias_vertical,
            report_interval * SECOND,
        ]
    )


def bias_of(state: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the bias (3,), rad/s, and its covariance (3, 3), rad^2/s^2."""
    return state[BIAS : BIAS + 3].copy(), state[COVARIANCES]


@inlined
def prepare(interval: float, constants: np.ndarray, state: np.ndarray) -> None:
    """Work out what depends on the interval alone, ns; where a low-pass cannot filter, it follows.

    The coefficient of a low-pass is tan(w interval / 2) for w = sqrt(2) / time constant.
    """
    root = math.sqrt(2.0)
    rest = math.tan(min(interval / (root * constants[1]), 1.25))
    force = math.tan(min(interval / (root * constants[0]), 1.25))
    state[INTERVAL] = interval
    state[REST_COEFFICIENT], state[REST_SCALE] = rest, 1.0 / (1.0 + root * rest + rest * rest)
    state[FORCE_COEFFICIENT], state[FORCE_SCALE] = force, 1.0 / (1.0 + root * force + force * force)
    state[GROWTH] = constants[7] * 1e-9 * interval
    state[PER_SECOND] = 1e9 / interval


@inlined
def low_pass(
    state: np.ndarray, bank: int, n: int, coefficients: int, interval: float, time_constant: float
) -> None:
    """Second-order Butterworth low-pass of the first n numbers of SCRATCH, in a bank.

    y'' + sqrt(2) w y' + w^2 y = w^2 x by the trapezoidal rule. The output is the mean of all
    samples for the first time constant, and the filter starts from it.
    bank, coefficients: indices in the state; interval, time_constant: ns.
    """
    y, slope, before = bank + OUTPUT, bank + OUTPUT + n, bank + OUTPUT + 2 * n
    if state[bank + 1] < time_constant:
        state[bank] += 1.0
        state[bank + 1] += interval
        for i in range(n):
            state[y + i] += (state[SCRATCH + i] - state[y + i]) / state[bank]
            state[before + i] = state[y + i]
    else:
        c, scale = state[coefficients], state[coefficients + 1]
        for i in range(n):
            both = scale * (
                2.0 * state[slope + i]
                + c * (state[SCRATCH + i] + state[before + i] - 2.0 * state[y + i])
            )
            state[y + i] += c * both
            state[slope + i] = both - state[slope + i]
            state[before + i] = state[SCRATCH + i]


@inlined
def limited(value: float, limit: float) -> float:
    """Return the value, held within +-limit."""
    return min(max(value, -limit), limit)


@inlined
def correct_bias(state: np.ndarray, h: Matrix, e: Vector, variance: Vector, limit: float) -> None:
    """Kalman update of the bias and its covariance, which stays symmetric to the last bit.

    e is measured minus H bias, variance that of each component; e and the bias are limited.
    """
    p = six(state, COVARIANCE)
    a, b, c = apply(h, (p[0], p[1], p[3])), apply(h, (p[1], p[2], p[4])), apply(h, p[3:])  # H P
    x = h[0] * a[0] + h[1] * b[0] + h[2] * c[0] + variance[0]
    y = h[3] * a[1] + h[4] * b[1] + h[5] * c[1] + variance[1]
    z = h[6] * a[2] + h[7] * b[2] + h[8] * c[2] + variance[2]
    yx = h[3] * a[0] + h[4] * b[0] + h[5] * c[0]
    zx = h[6] * a[0] + h[7] * b[0] + h[8] * c[0]
    zy = h[6] * a[1] + h[7] * b[1] + h[8] * c[1]
    root = cholesky((x, yx, y, zx, zy, z))
    u = solve(root, (limited(e[0], limit), limited(e[1], limit), limited(e[2], limit)))
    a, b, c = solve(root, a), solve(root, b), solve(root, c)
    state[BIAS] = limited(state[BIAS] + dot(a, u), limit)
    state[BIAS + 1] = limited(state[BIAS + 1] + dot(b, u), limit)
    state[BIAS + 2] = limited(state[BIAS + 2] + dot(c, u), limit)
    state[COVARIANCE] -= dot(a, a)
    state[COVARIANCE + 1] -= dot(b, a)
    state[COVARIANCE + 2] -= dot(b, b)
    state[COVARIANCE + 3] -= dot(c, a)
    state[COVARIANCE + 4] -= dot(c, b)
    state[COVARIANCE + 5] -= dot(c, c)


@kernel
def advance(
    interval: float,
    rate: Vector,
    force: Vector,
    constants: np.ndarray,
    state: np.ndarray,
) -> Rotation:
    """Take one sample for an interval in ns; return the attitude."""
    limit = constants[5]
    if interval != state[INTERVAL]:
        prepare(interval, constants, state)

    state[SCRATCH], state[SCRATCH + 1], state[SCRATCH + 2] = rate
    low_pass(state, REST_RATE, 3, REST_COEFFICIENT, interval, constants[1])
    mean = three(state, REST_RATE + OUTPUT)
    deviation = (rate[0] - mean[0]) ** 2 + (rate[1] - mean[1]) ** 2 + (rate[2] - mean[2]) ** 2
    if deviation >= constants[3] or max(abs(mean[0]), abs(mean[1]), abs(mean[2])) > limit:
        state[STILL] = state[RESTING] = 0.0

    bias, seconds = three(state, BIAS), 1e-9 * interval
    turned = (
        seconds * (rate[0] - bias[0]),
        seconds * (rate[1] - bias[1]),
        seconds * (rate[2] - bias[2]),
    )
    turn = renormalised(multiply(four(state, TURN), turn_by(turned)))
    state[TURN], state[TURN + 1], state[TURN + 2], state[TURN + 3] = turn
    level = four(state, LEVEL)

    since = min(state[SINCE_FORCE] + interval, constants[1])
    if force[0] == 0.0 and force[1] == 0.0 and force[2] == 0.0:
        state[SINCE_FORCE] = since
        return multiply(level, turn)  # nothing measured
    state[SINCE_FORCE] = 0.0
    if since != interval:
        prepare(since, constants, state)

    state[SCRATCH], state[SCRATCH + 1], state[SCRATCH + 2] = force
    low_pass(state, REST_FORCE, 3, REST_COEFFICIENT, since, constants[1])
    slow = three(state, REST_FORCE + OUTPUT)
    deviation = (force[0] - slow[0]) ** 2 + (force[1] - slow[1]) ** 2 + (force[2] - slow[2]) ** 2
    if deviation >= constants[4]:
        state[STILL] = state[RESTING] = 0.0
    else:
        state[STILL] += since
        if state[STILL] >= constants[2]:
            state[RESTING] = 1.0

    state[SCRATCH], state[SCRATCH + 1], state[SCRATCH + 2] = rotate(turn, force)
    low_pass(state, INERTIAL_FORCE, 3, FORCE_COEFFICIENT, since, constants[0])
    # north and east: of the unit force before it is turned upright.
    tilt, east, north = upright(rotate(level, three(state, INERTIAL_FORCE + OUTPUT)))
    level = renormalised(multiply(tilt, level))
    state[LEVEL], state[LEVEL + 1], state[LEVEL + 2], state[LEVEL + 3] = level

    # The correction is what the bias has turned since the last sample, as the low-pass shows it.
    attitude = multiply(level, turn)
    r = matrix(attitude)
    for i in range(9):
        state[SCRATCH + i] = r[i]
    state[SCRATCH + 9], state[SCRATCH + 10], _ = apply(r, bias)
    low_pass(state, ROTATION, 11, FORCE_COEFFICIENT, since, constants[0])
    growth = state[GROWTH]
    for i in (COVARIANCE, COVARIANCE + 2, COVARIANCE + 5):
        if state[i] < constants[6]:
            state[i] += growth
    if state[RESTING] == 1.0:
        variance = vertical = constants[9] ** 2 / growth + constants[9]
        h = (1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0)
        measured = mean
    elif constants[8] > 0.0:
        variance = constants[8] ** 2 / growth + constants[8]
        vertical = variance / constants[10]
        h = nine(state, LANES)
        measured = (
            state[LANES + 9] - north * state[PER_SECOND],
            state[LANES + 10] + east * state[PER_SECOND],
            0.0,  # nothing measures it
        )
    else:
        return attitude
    expected = apply(h, bias)
    e = measured[0] - expected[0], measured[1] - expected[1], measured[2] - expected[2]
    correct_bias(state, h, e, (variance, variance, vertical), limit)
    return attitude


@kernel
def begin_anew(state: np.ndarray, interval: float, constants: np.ndarray) -> None:
    """Forget after a gap of `interval` ns whatever took motion to be known; keep the bias."""
    state[STILL] = state[RESTING] = 0.0
    for i in range(REST_RATE, SCRATCH):
        state[i] = 0.0
    for i in (COVARIANCE, COVARIANCE + 2, COVARIANCE + 5):
        state[i] = min(state[i] + 1e-9 * interval * constants[7], constants[6])


@inlined
def take(interval: int, rate: Vector, force: Vector, state: np.ndarray) -> Rotation:
    """Take the next sample, `interval` ns after the last; return the attitude."""
    constants = state[CONSTANTS:]
    before = state[RESTING]
    if state[SAMPLES] == 0.0:
        state[SAMPLES] = state[REPORT] = state[CHANGE] = 1.0
        state[DUE] = constants[11]
        for i in range(3):
            state[FIRST + i], state[FIRST + 3 + i] = rate[i], force[i]
        for i in (COVARIANCE, COVARIANCE + 2, COVARIANCE + 5):
            state[i] = constants[6]
        if force[0] == 0.0 and force[1] == 0.0 and force[2] == 0.0:
            return 0.0, 0.0, 0.0, 1.0
        return upright(force)[0]
    if state[SAMPLES] == 1.0:
        state[SAMPLES] = 2.0
        first, vertical = three(state, FIRST), three(state, FIRST + 3)
        advance(min(float(interval), constants[1]), first, vertical, constants, state)
    elif interval > constants[1]:
        begin_anew(state, float(interval), constants)
    q = advance(min(float(interval), constants[1]), rate, force, constants, state)
    state[CHANGE] = 1.0 if state[RESTING] != before else 0.0
    state[DUE] -= interval
    state[REPORT] = 0.0
    if state[DUE] <= 0.0:
        state[REPORT] = 1.0
        state[DUE] = max(state[DUE] + constants[11], 0.0)
    return q if q[3] >= 0.0 else (-q[0], -q[1], -q[2], -q[3])


@kernel
def run(
    t: np.ndarray,
    rate: np.ndarray,
    force: np.ndarray,
    state: np.ndarray,
    attitude: np.ndarray,
    bias: np.ndarray,
    covariance: np.ndarray,
    resting: np.ndarray,
    reports: np.ndarray,
    changes: np.ndarray,
) -> tuple[int, int]:
    """Filter the rows of a block; any split into blocks gives the same bytes.

    t: int64 (N,), stamps in ns, strictly increasing over all calls.
    rate: (N, 3), rad/s, and force: (N, 3), specific force, m/s^2, in the body frame. A force of
    exactly zero is none.
    state: of `new_state`; written.

    Written: attitude (N, 4), unit quaternions earth <- body, scalar last, w >= 0. For each
    row that is listed in reports, int64 (N,): bias (N, 3), rad/s, and its covariance (N, 3, 3),
    rad^2/s^2. At the rows that are listed in changes, int64 (N,): resting, int64 (N,), 0 or 1,
    where it is another than before. Returns how many reports and how many changes there are.

    The first sample only gives the vertical. Its rate counts for as long as that of the second,
    when there is one. A rate counts for rest_time_constant at most: a longer interval is a gap,
    after which the vertical is measured anew.
    """
    last = stamp_of(state)
    reported, changed = 0, 0
    for k in range(len(t)):
        w = rate[k, 0], rate[k, 1], rate[k, 2]
        f = force[k, 0], force[k, 1], force[k, 2]
        q = take(t[k] - last, w, f, state)
        last = t[k]
        attitude[k, 0], attitude[k, 1], attitude[k, 2], attitude[k, 3] = q
        if state[REPORT] == 1.0:
            for i in range(3):
                bias[reported, i] = state[BIAS + i]
                for j in range(3):
                    covariance[reported, i, j] = state[COVARIANCE + ROWS[i][j]]
            reports[reported] = k
            reported += 1
        if state[CHANGE] == 1.0:
            resting[changed] = np.int64(state[RESTING])
            changes[changed] = k
            changed += 1
    keep_stamp(last, state)
    return reported, changed


@kernel
def run_one(
    t: int, rate: np.ndarray, force: np.ndarray, state: np.ndarray, attitude: np.ndarray
) -> bool:
    """`run` on one row: rate and force (3,), attitude (4,); return whether state has a message.

    Live, the way into a compiled function costs more than the filter: few arguments count, and
    an array that the caller makes costs half of one that is returned.
    """
    w = rate[0], rate[1], rate[2]
    q = take(t - stamp_of(state), w, (force[0], force[1], force[2]), state)
    keep_stamp(t, state)
    attitude[0], attitude[1], attitude[2], attitude[3] = q
    return state[REPORT] == 1.0 or state[CHANGE] == 1.0
