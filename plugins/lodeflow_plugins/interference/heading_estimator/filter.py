"""A heading filter that takes magnetic disturbances for correlated noise.

A disturbance is neither white nor rare. What the seen components of the field exceed their own
prediction by is taken for the variance S of the unseen one, the error of the direction:

    along the expected field   strength of the field against 1
    difference                 first compass less second: the gradient of a near source
    down                       the vertical, where the compasses measure it
    across                     direction of the field against the gyro's heading

All updates are weighted with R = colour + 2 tau / dt S, for a disturbance of correlation time tau
is one error for that long, not many. There is no gate: the weight falls, and never to nothing. A
field that looks clean and disagrees with the gyro wins after a while (`return_time`), so the
filter cannot lock itself out. Hard and soft iron are states.

Source: our own; state, residuals and variances as in docs/interference.md. Body axes are forward
and right here, headings clockwise; units as in `model.Assumptions`.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from lodeflow_plugins.interference.heading_estimator import model as m
from lodeflow_plugins.interference.heading_estimator import monitor
from lodeflow_plugins.interference.heading_estimator.linear import gain, variance, wrap
from lodeflow_plugins.interference.heading_estimator.model import Constants, State

UNKNOWN = math.radians(60.0) ** 2
"""Variance of a heading of which nothing is known."""
FIRST_STRENGTH = 0.1**2
"""Variance of the disturbance that is taken for granted at the first sample."""
CLEAN, DISTURBED = 0.01**2, 0.02**2
"""Variances of the disturbance below which a field looks clean, and above which it does not."""
WIDEST_IRON, WIDEST_DIFFERENCE = 0.05**2, 0.07**2
"""Largest variances that the hard iron is opened to."""
FASTEST_TURN = math.radians(5.0)
"""Rate, rad/s, at which the hard iron opens at full speed: without a turn it does not show."""
FORGIVENESS = 3.0
"""How much faster than it builds up a suspicion fades."""
GAP, WILD = 1.0, 0.5
"""A gap of more than 1 s in the rate, in which the body may turn with 0.5 rad/s."""
CONFIRMED = 10.0
"""Time, s, after which a field that fits the first calibration brings it back."""


@njit(cache=True)
def predict(seconds: float, rate: float, c: Constants, s: State) -> None:
    """Move the filter on by `seconds` with the measured rate, rad/s to the right."""
    x, P, G, n = s.x, s.P, s.G, s.n
    turned = rate * seconds
    x[m.HEADING] = wrap(x[m.HEADING] + turned * (1.0 + x[m.SCALE]) - x[m.BIAS] * seconds)
    for j in range(m.STATES):
        P[m.HEADING, j] += turned * P[m.SCALE, j] - seconds * P[m.BIAS, j]
    for j in range(m.STATES):
        P[j, m.HEADING] += turned * P[j, m.SCALE] - seconds * P[j, m.BIAS]
    P[m.HEADING, m.HEADING] += c.gyro_noise**2 * seconds
    if seconds > GAP:
        P[m.HEADING, m.HEADING] = min(
            P[m.HEADING, m.HEADING] + (WILD * (seconds - GAP)) ** 2, UNKNOWN
        )
    P[m.BIAS, m.BIAS] += c.gyro_walk**2 * seconds
    drift = c.calibration_walk**2 * seconds
    for j in range(m.HARD_X, m.SCALE):
        P[j, j] += drift
    for j in range(3):
        G[j, j] += 2.0 * drift
    n[m.VERTICAL_VARIANCE] += drift
    n[m.VERTICAL_DIFFERENCE_VARIANCE] += 2.0 * drift
    monitor.predict(seconds, turned, c, s)


@njit(cache=True)
def _prior(c: Constants, s: State) -> None:
    """Bring the calibration states back to where they were before any data."""
    x, P, G, n = s.x, s.P, s.G, s.n
    calibration = c.calibration**2
    for i in range(m.HARD_X, m.STATES):
        x[i] = 0.0
        for j in range(m.STATES):
            P[i, j] = 0.0
            P[j, i] = 0.0
        P[i, i] = calibration
    P[m.SCALE, m.SCALE] = c.gyro_scale**2
    s.g[:] = 0.0
    G[:] = 0.0
    for i in range(3):
        G[i, i] = 2.0 * calibration
    n[m.VERTICAL], n[m.VERTICAL_DIFFERENCE] = 0.0, 0.0
    n[m.VERTICAL_VARIANCE] = 2.0 * calibration
    n[m.VERTICAL_DIFFERENCE_VARIANCE] = 4.0 * calibration
    n[m.DISTURBED_FOR], n[m.NOMINAL_FOR] = 0.0, 0.0


@njit(cache=True)
def begin(first: np.ndarray, second: np.ndarray, c: Constants, s: State) -> None:
    """Start from the first fields (3,) of the two compasses."""
    x, P, n = s.x, s.P, s.n
    x[:] = 0.0
    P[:] = 0.0
    x[m.HEADING] = math.atan2(-first[1] - second[1], first[0] + second[0])
    P[m.HEADING, m.HEADING] = UNKNOWN
    P[m.BIAS, m.BIAS] = c.gyro_bias**2
    _prior(c, s)
    n[m.STRENGTH] = n[m.FIELD_STRENGTH] = FIRST_STRENGTH
    n[m.STARTED] = 1.0
    monitor.begin(s)


@njit(cache=True)
def correct(first: np.ndarray, second: np.ndarray, seconds: float, c: Constants, s: State) -> None:
    """Use the fields (3,) of both compasses, `seconds` after those before; above 0."""
    x, P, g, G, n, h = s.x, s.P, s.g, s.G, s.n, s.h
    cos, sin = math.cos(x[m.HEADING]), math.sin(x[m.HEADING])
    plain_x, plain_y = 0.5 * (first[0] + second[0]), 0.5 * (first[1] + second[1])
    apart_x, apart_y = first[0] - second[0], first[1] - second[1]
    plain_down = 0.5 * (first[2] + second[2]) - math.tan(c.dip)
    apart_down = first[2] - second[2]
    n[m.COMPASS_HEADING] = math.atan2(-plain_y, plain_x)

    # Residuals against what heading and calibration states expect.
    field_x = plain_x - x[m.HARD_X] - x[m.SOFT_X] * cos + x[m.SOFT_XY] * sin
    field_y = plain_y - x[m.HARD_Y] + x[m.SOFT_Y] * sin - x[m.SOFT_XY] * cos
    along = math.sqrt(field_x * field_x + field_y * field_y) - 1.0
    across = wrap(math.atan2(-field_y, field_x) - x[m.HEADING])
    difference_x = apart_x - (g[0, 0] + g[0, 1] * cos + g[0, 2] * sin)
    difference_y = apart_y - (g[1, 0] + g[1, 1] * cos + g[1, 2] * sin)
    down = plain_down - n[m.VERTICAL]
    down_difference = apart_down - n[m.VERTICAL_DIFFERENCE]

    # Smoothed, to see a disturbance below the noise of one sample.
    n[m.COUNT] += 1.0
    usual = 1.0 - math.exp(-seconds / c.smoothing)
    a = max(usual, 1.0 / n[m.COUNT])
    n[m.ALONG] += a * (along - n[m.ALONG])
    n[m.ACROSS] = wrap(n[m.ACROSS] + a * wrap(across - n[m.ACROSS]))
    n[m.DIFFERENCE_X] += a * (difference_x - n[m.DIFFERENCE_X])
    n[m.DIFFERENCE_Y] += a * (difference_y - n[m.DIFFERENCE_Y])
    n[m.DOWN] += a * (down - n[m.DOWN])
    n[m.DOWN_DIFFERENCE] += a * (down_difference - n[m.DOWN_DIFFERENCE])
    n[m.PLAIN_ALONG] += a * (
        math.sqrt(plain_x * plain_x + plain_y * plain_y) - 1.0 - n[m.PLAIN_ALONG]
    )
    n[m.PLAIN_X] += a * (apart_x - n[m.PLAIN_X])
    n[m.PLAIN_Y] += a * (apart_y - n[m.PLAIN_Y])
    n[m.PLAIN_DOWN] += a * (plain_down - n[m.PLAIN_DOWN])
    n[m.PLAIN_DOWN_DIFFERENCE] += a * (apart_down - n[m.PLAIN_DOWN_DIFFERENCE])

    h_across, h_along, basis, k = h[0], h[1], h[2], h[3]
    h_across[m.HEADING], h_across[m.BIAS], h_across[m.SCALE] = 1.0, 0.0, 0.0
    h_across[m.HARD_X], h_across[m.HARD_Y] = -sin, -cos
    h_across[m.SOFT_X], h_across[m.SOFT_Y] = -sin * cos, sin * cos
    h_across[m.SOFT_XY] = sin * sin - cos * cos
    h_along[m.HEADING], h_along[m.BIAS], h_along[m.SCALE] = 0.0, 0.0, 0.0
    h_along[m.HARD_X], h_along[m.HARD_Y] = cos, -sin
    h_along[m.SOFT_X], h_along[m.SOFT_Y] = cos * cos, sin * sin
    h_along[m.SOFT_XY] = -2.0 * sin * cos
    basis[0], basis[1], basis[2] = 1.0, cos, sin

    # Variance of the disturbance: what a residual exceeds its own prediction by.
    white = usual / (2.0 - usual) * c.compass_noise**2
    usual_along = variance(P, h_along) + 0.5 * white + c.place**2
    usual_across = variance(P, h_across) + 0.5 * white + c.place**2
    usual_difference = variance(G, basis) + 2.0 * white + c.gradient**2
    gate = c.gradient_gate**2
    square = n[m.DIFFERENCE_X] ** 2 + n[m.DIFFERENCE_Y] ** 2
    field = max(0.0, n[m.ALONG] ** 2 - usual_along, 0.5 * (square - gate * usual_difference))
    if c.vertical > 0.0:
        usual_down = n[m.VERTICAL_VARIANCE] + 0.5 * white + c.place**2
        usual_apart = n[m.VERTICAL_DIFFERENCE_VARIANCE] + 2.0 * white + c.gradient**2
        square = n[m.DOWN_DIFFERENCE] ** 2
        field = max(field, 0.5 * (n[m.DOWN] ** 2 - usual_down), 0.5 * (square - gate * usual_apart))
    fade = math.exp(-seconds / c.hold)
    before = n[m.STRENGTH]
    n[m.FIELD_STRENGTH] = max(field, n[m.FIELD_STRENGTH] * fade)
    n[m.STRENGTH] = max(field, n[m.ACROSS] ** 2 - usual_across, before * fade)
    r = (c.compass_colour**2 + 2.0 * c.correlation * n[m.STRENGTH]) / seconds

    if n[m.FIELD_STRENGTH] < CLEAN and n[m.ACROSS] ** 2 > usual_across:
        P[m.HEADING, m.HEADING] = min(
            P[m.HEADING, m.HEADING] + n[m.ACROSS] ** 2 * seconds / c.return_time, UNKNOWN
        )

    gain(P, h_across, r, k)
    for i in range(m.STATES):
        x[i] += k[i] * across
    gain(P, h_along, r, k)
    for i in range(m.STATES):
        x[i] += k[i] * along
    x[m.HEADING] = wrap(x[m.HEADING])
    gain(G, basis, 2.0 * r, k)
    for i in range(3):
        g[0, i] += k[i] * difference_x
        g[1, i] += k[i] * difference_y
    weight = n[m.VERTICAL_VARIANCE] / (n[m.VERTICAL_VARIANCE] + r)
    n[m.VERTICAL] += weight * down
    n[m.VERTICAL_VARIANCE] *= 1.0 - weight
    weight = n[m.VERTICAL_DIFFERENCE_VARIANCE] / (n[m.VERTICAL_DIFFERENCE_VARIANCE] + 2.0 * r)
    n[m.VERTICAL_DIFFERENCE] += weight * down_difference
    n[m.VERTICAL_DIFFERENCE_VARIANCE] *= 1.0 - weight

    _open(before, seconds, c, s)
    disagrees = n[m.ACROSS] ** 2 - usual_across > monitor.SMALL
    monitor.correct(n[m.FIELD_STRENGTH] < CLEAN, field > DISTURBED or disagrees, seconds, c, s)


@njit(cache=True)
def _suspicion(is_so: bool, so_far: float, seconds: float) -> float:
    return so_far + seconds if is_so else max(0.0, so_far - FORGIVENESS * seconds)


@njit(cache=True)
def _open(before: float, seconds: float, c: Constants, s: State) -> None:
    """Let the hard iron move in a disturbance that does not end, and back if it was none.

    before: variance of the disturbance at the sample before.
    """
    P, G, n = s.P, s.G, s.n
    n[m.DISTURBED_FOR] = _suspicion(before > DISTURBED, n[m.DISTURBED_FOR], seconds)
    if n[m.DISTURBED_FOR] > c.opening_after:
        opened = c.opening_walk**2 * seconds * abs(n[m.LAST_RATE]) / FASTEST_TURN
        for i in (m.HARD_X, m.HARD_Y):
            if P[i, i] < WIDEST_IRON:
                P[i, i] = min(WIDEST_IRON, P[i, i] + opened)
        if G[0, 0] < WIDEST_DIFFERENCE:
            G[0, 0] = min(WIDEST_DIFFERENCE, G[0, 0] + 2.0 * opened)
        if n[m.VERTICAL_VARIANCE] < WIDEST_IRON:
            n[m.VERTICAL_VARIANCE] = min(WIDEST_IRON, n[m.VERTICAL_VARIANCE] + opened)
        if n[m.VERTICAL_DIFFERENCE_VARIANCE] < 2.0 * WIDEST_IRON:
            n[m.VERTICAL_DIFFERENCE_VARIANCE] = min(
                2.0 * WIDEST_IRON, n[m.VERTICAL_DIFFERENCE_VARIANCE] + 4.0 * opened
            )
    # What was learned in the disturbance may make the clean field look disturbed.
    limit = 3.0 * c.calibration
    apart = math.sqrt(2.0) * limit
    nominal = abs(n[m.PLAIN_ALONG]) < limit
    nominal = nominal and n[m.PLAIN_X] ** 2 + n[m.PLAIN_Y] ** 2 < apart**2
    if c.vertical > 0.0:
        nominal = nominal and abs(n[m.PLAIN_DOWN]) < apart
        nominal = nominal and abs(n[m.PLAIN_DOWN_DIFFERENCE]) < 2.0 * limit
    is_so = nominal and n[m.FIELD_STRENGTH] > DISTURBED
    n[m.NOMINAL_FOR] = _suspicion(is_so, n[m.NOMINAL_FOR], seconds)
    if n[m.NOMINAL_FOR] > CONFIRMED:
        _prior(c, s)
        n[m.ALONG], n[m.DOWN] = n[m.PLAIN_ALONG], n[m.PLAIN_DOWN]
        n[m.DIFFERENCE_X], n[m.DIFFERENCE_Y] = n[m.PLAIN_X], n[m.PLAIN_Y]
        n[m.DOWN_DIFFERENCE] = n[m.PLAIN_DOWN_DIFFERENCE]


@njit(cache=True)
def run(
    t: np.ndarray,
    rate: np.ndarray,
    rate_row: np.ndarray,
    first: np.ndarray,
    second: np.ndarray,
    field_row: np.ndarray,
    c: Constants,
    state: State,
    out: np.ndarray,
) -> int:
    """Filter the rows of a block; any split into blocks gives the same bytes.

    Args:
        t: (N,) stamps in ns, increasing, also from block to block.
        rate: (M,) angular rate, rad/s to the right.
        rate_row: (N,) its row at each stamp, -1 for none, where the last one serves.
        first: (K, 3) field of the first compass: forward, right, down.
        second: (K, 3), of the second.
        field_row: (N,) their row at each stamp, -1 for none.
        c: of `Assumptions.constants`.
        state: changed in place.
        out: (N, 5), written from the first row with an estimate on: heading in [-pi, pi), its
            standard deviation, strength of the disturbance, deviation of the compasses' heading
            from the estimate, and 1 where the field looks clean.

    Returns:
        The first row with an estimate; N if there is none.
    """
    n = state.n
    begins = len(t) if n[m.STARTED] == 0.0 else 0
    for k in range(len(t)):
        now = t[k] * 1e-9
        present = rate_row[k] >= 0
        measured = rate[rate_row[k]] if present else n[m.LAST_RATE]
        if n[m.STARTED] != 0.0:
            predict(now - n[m.LAST], 0.5 * (measured + n[m.LAST_RATE]), c, state)
        n[m.LAST], n[m.LAST_RATE] = now, measured
        j = field_row[k]
        if j >= 0:
            if n[m.STARTED] == 0.0:
                begin(first[j], second[j], c, state)
                begins = k
            else:
                correct(first[j], second[j], now - n[m.LAST_COMPASS], c, state)
            n[m.LAST_COMPASS] = now
        if n[m.STARTED] != 0.0:
            x = state.x[m.HEADING]
            out[k, 0] = x
            out[k, 1] = math.sqrt(monitor.honest_variance(c, state))
            out[k, 2] = math.sqrt(n[m.STRENGTH])
            out[k, 3] = wrap(n[m.COMPASS_HEADING] - x)
            out[k, 4] = 1.0 if n[m.FIELD_STRENGTH] < CLEAN else 0.0
    return begins
