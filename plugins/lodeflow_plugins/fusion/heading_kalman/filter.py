"""The heading stage as a filter of streams: attitudes in, fields now and then, attitudes out.

`kalman.py` has the filter. Here fields and rates are gathered between its steps, and each attitude
is turned by the heading that it knows, so that a step for every fifth sample is enough.
"""

import math

import numpy as np

from lodeflow_plugins.fusion.heading_kalman.kalman import (
    BELIEFS,
    COS,
    HARD_IRON,
    LEVEL,
    UNKNOWN,
    P,
    begin,
    correct,
    face,
    facing,
    look_for_magnet,
    predict,
    report,
)
from lodeflow_plugins.fusion.rotations import (
    Rotation,
    Vector,
    conjugate,
    four,
    inlined,
    kernel,
    multiply,
    rotate,
    three,
    turn_about_vertical,
    turn_by,
)
from lodeflow_plugins.fusion.stamps import SECOND, keep_stamp, stamp_of

# The state of `run`: the stamp of the last row; durations in whole nanoseconds; what the Kalman
# filter remembers; the constants.
STARTED = 2  # 0 or 1
ORIENTED = 3  # whether there has been an attitude
SINCE_ATTITUDE = 4
ATTITUDE = 5  # the last one
RATE = 9  # between the last two, in the attitude's frame, rad/s
PHASE = 12  # NOTHING, AVERAGING or RUNNING
SINCE_STEP = 13
AGE = 14  # since the first field
FIELD = 15  # the last one
COUNT = 18  # of fields since the last step, and their sums: field and rate
FIELD_SUM, RATE_SUM = 19, 22
MEAN_FIELD = 25  # before the filter runs
DUE = 28  # time until the next report
REPORT = 29  # 1 where the last row has a report
KALMAN = 30
CONSTANTS = KALMAN + BELIEFS
STATE_SIZE = CONSTANTS + 18

NOTHING, AVERAGING, RUNNING = 0.0, 1.0, 2.0
SMOOTHING = 0.5  # time constant of the mean field before the filter runs, s
REPORTED = 11  # numbers of a report


def new_state(constants: np.ndarray) -> np.ndarray:
    """State of a filter that has seen nothing, float64."""
    state = np.zeros(STATE_SIZE)
    state[KALMAN + LEVEL] = 1.0
    state[KALMAN + P] = UNKNOWN
    state[KALMAN + COS] = 1.0
    state[CONSTANTS:] = constants
    return state


def constants(
    *,
    heading_walk: float,
    drift: float,
    drift_time: float,
    field_walk: float,
    disturbance: float,
    disturbance_time: float,
    level_time: float,
    field_noise: float,
    surprise: float,
    lag: float,
    update_interval: float,
    start_duration: float,
    output_advance: float,
    report_interval: float,
    horizontal: float,
    vertical: float,
    field_tolerance: float,
    magnet_time: float,
) -> np.ndarray:
    """Constants of the filter, float64 (18,), in s, rad and tesla, all standard deviations squared.

    The names are those of the node's parameters, where they are explained; horizontal and
    vertical are the expected field to the north and upwards, NaN where nothing is expected.
    """
    return np.array(
        [
            heading_walk**2,
            drift**2,
            drift_time,
            field_walk**2,
            disturbance**2,
            disturbance_time,
            level_time,
            field_noise**2,
            surprise,
            lag**2,
            update_interval * SECOND,
            start_duration * SECOND,
            output_advance,
            report_interval * SECOND,
            horizontal,
            vertical,
            field_tolerance**2,
            magnet_time,
        ]
    )


@kernel
def step(constants: np.ndarray, state: np.ndarray, x: np.ndarray) -> None:
    """Use the fields since the last step."""
    scale = 1.0 / state[COUNT]
    y, w = three(state, FIELD_SUM), three(state, RATE_SUM)
    y = scale * y[0], scale * y[1], scale * y[2]
    w = scale * w[0], scale * w[1], scale * w[2]
    for i in range(COUNT, MEAN_FIELD):
        state[i] = 0.0
    seconds = 1e-9 * state[SINCE_STEP]
    state[SINCE_STEP] = 0.0
    if state[PHASE] == RUNNING:
        predict(seconds, constants, x)
        correct(y, w, seconds, constants, x)
        look_for_magnet(four(state, ATTITUDE), seconds, constants, x)
        return
    weight = min(1.0, seconds / SMOOTHING) if state[PHASE] == AVERAGING else 1.0
    state[PHASE] = AVERAGING
    for i in range(3):
        state[MEAN_FIELD + i] += weight * (y[i] - state[MEAN_FIELD + i])
    face(math.atan2(state[MEAN_FIELD], state[MEAN_FIELD + 1]), x)
    if state[AGE] >= constants[11]:
        state[PHASE] = RUNNING
        begin(three(state, MEAN_FIELD), constants, x)


@inlined
def gather(m: Vector, constants: np.ndarray, state: np.ndarray, x: np.ndarray) -> None:
    """Take a field in the body's frame; step when there has been time enough."""
    last = three(state, FIELD)
    # The same numbers again are the last reading once more, and zeros (as at first) are none.
    repeated = m[0] == last[0] and m[1] == last[1] and m[2] == last[2]
    if repeated or not math.isfinite(m[0] + m[1] + m[2]):
        return
    for i in range(3):
        state[FIELD + i] = m[i]
    if m[0] == 0.0 and m[1] == 0.0 and m[2] == 0.0:
        return
    iron = three(x, HARD_IRON)
    m = m[0] - iron[0], m[1] - iron[1], m[2] - iron[2]
    y = rotate(four(state, ATTITUDE), m)
    for i in range(3):
        state[FIELD_SUM + i] += y[i]
        state[RATE_SUM + i] += state[RATE + i]
    state[COUNT] += 1.0
    if state[PHASE] == NOTHING or state[SINCE_STEP] >= constants[10]:
        step(constants, state, x)


@inlined
def take(
    interval: int,
    has_attitude: bool,
    q: Rotation,
    has_field: bool,
    m: Vector,
    state: np.ndarray,
) -> Rotation:
    """Take the next row, `interval` ns after the last; return the attitude with heading."""
    constants, x = state[CONSTANTS:], state[KALMAN:]
    state[SINCE_ATTITUDE] += interval
    state[SINCE_STEP] += interval
    state[DUE] -= interval
    if state[PHASE] != NOTHING or state[COUNT] > 0.0:
        state[AGE] += interval
    if has_attitude:
        if state[ORIENTED] == 1.0:
            moved = multiply(q, conjugate(four(state, ATTITUDE)))
            rate = (2e9 if moved[3] >= 0.0 else -2e9) / state[SINCE_ATTITUDE]
            for i in range(3):
                state[RATE + i] = rate * moved[i]
        state[ORIENTED] = 1.0
        state[SINCE_ATTITUDE] = 0.0
        for i in range(4):
            state[ATTITUDE + i] = q[i]
    if has_field and state[ORIENTED] == 1.0:
        gather(m, constants, state, x)
    state[REPORT] = 0.0
    if not has_attitude:
        return q
    if state[DUE] <= 0.0:
        state[REPORT] = 1.0
        state[DUE] = max(state[DUE] + constants[13], 0.0)
    if constants[12] != 0.0:
        ahead, w = constants[12], three(state, RATE)
        q = multiply(turn_by((ahead * w[0], ahead * w[1], ahead * w[2])), q)
    sin, cos = facing(1e-9 * state[SINCE_STEP], constants, x)
    q = turn_about_vertical(sin, cos, q)
    return q if q[3] >= 0.0 else (-q[0], -q[1], -q[2], -q[3])


@inlined
def first_or_last(t: int, state: np.ndarray) -> int:
    """Return the stamp of the last row; before the first, its own, which is t."""
    if state[STARTED] == 0.0:
        state[STARTED] = 1.0
        return t
    return stamp_of(state)


@kernel
def run(
    t: np.ndarray,
    attitude: np.ndarray,
    attitude_row: np.ndarray,
    field: np.ndarray,
    field_row: np.ndarray,
    state: np.ndarray,
    out: np.ndarray,
    believed: np.ndarray,
    reports: np.ndarray,
) -> int:
    """Give the attitudes of a block a heading; any split into blocks gives the same bytes.

    t: int64 (N,), stamps in ns, strictly increasing over all calls.
    attitude: (A, 4), unit quaternions with z up, scalar last; attitude_row: int64 (N,), which of
    them belongs to each stamp, or -1. field: (F, 3), tesla, in the body frame, and field_row
    alike; a field that is not finite, zero, or the one before once more counts as none.
    state: of `new_state`.

    Written: state; out (A, 4), magnetic ENU <- body, w >= 0. For each of the attitudes listed in
    reports, int64 (A,), what `kalman.report` says in believed (A, 11). Returns how many there are.
    """
    if len(t) == 0:
        return 0
    last = first_or_last(t[0], state)
    constants, x = state[CONSTANTS:], state[KALMAN:]
    reported = 0
    q, m = (0.0, 0.0, 0.0, 1.0), (0.0, 0.0, 0.0)
    for k in range(len(t)):
        a, f = attitude_row[k], field_row[k]
        if a >= 0:
            q = attitude[a, 0], attitude[a, 1], attitude[a, 2], attitude[a, 3]
        if f >= 0:
            m = field[f, 0], field[f, 1], field[f, 2]
        turned_to = take(t[k] - last, a >= 0, q, f >= 0, m, state)
        last = t[k]
        if a >= 0:
            out[a, 0], out[a, 1], out[a, 2], out[a, 3] = turned_to
            if state[REPORT] == 1.0:
                report(1e-9 * state[SINCE_STEP], constants, x, believed[reported])
                reports[reported] = a
                reported += 1
    keep_stamp(last, state)
    return reported


@kernel
def report_of(state: np.ndarray) -> np.ndarray:
    """What `kalman.report` says after the last row, (11,)."""
    out = np.empty(REPORTED)
    report(1e-9 * state[SINCE_STEP], state[CONSTANTS:], state[KALMAN:], out)
    return out


@kernel
def run_one(
    t: int,
    has_attitude: bool,
    attitude: np.ndarray,
    has_field: bool,
    field: np.ndarray,
    state: np.ndarray,
    out: np.ndarray,
) -> bool:
    """`run` on one row: attitude (4,), field (3,), out (4,); return whether there is a report.

    Live, the way into a compiled function costs more than the filter: few arguments count, and
    an array that the caller makes costs half of one that is returned.
    """
    q = attitude[0], attitude[1], attitude[2], attitude[3]
    m = field[0], field[1], field[2]
    interval = t - first_or_last(t, state)
    out[0], out[1], out[2], out[3] = take(interval, has_attitude, q, has_field, m, state)
    keep_stamp(t, state)
    return state[REPORT] == 1.0
