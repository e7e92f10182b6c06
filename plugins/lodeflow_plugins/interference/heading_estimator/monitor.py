"""Whether the heading can be called valid: a second opinion, by the gyro alone.

The covariance of the main filter knows neither a disturbance that stays for minutes, which is
nearly the same as a new calibration, nor one whose strength happens to pass through that of the
clean field. So a heading is anchored where the field has looked clean for a while, and carried on
with the gyro alone, with all its uncertainties. In a disturbance the compass is worth one
measurement of that disturbance, however long it lasts: the heading cannot be better than anchor
and that one measurement together. And where the filter has left the anchor, it is doubted by as
much, until the field has looked clean for so long that the anchor must be wrong.
"""

from __future__ import annotations

import math

from numba import njit

from lodeflow_plugins.interference.heading_estimator import model as m
from lodeflow_plugins.interference.heading_estimator.linear import wrap
from lodeflow_plugins.interference.heading_estimator.model import Constants, State

SMALL = math.radians(3.0) ** 2
"""A square of a departure from the anchor that no one needs to doubt."""
DOUBT = 1.0 / 1.5**2
"""Variance that a square departure in a disturbance is taken for."""
FIRST = 2.5
"""How much longer than else the field has to look clean after a start in a disturbance."""
WORST = math.radians(60.0) ** 2
"""Variance where nothing is known."""


@njit(cache=True)
def begin(s: State) -> None:
    """Start without an anchor."""
    n = s.n
    n[m.IS_ANCHORED], n[m.CLEAN_FOR], n[m.EPISODE], n[m.DISTURBED_SINCE] = 0.0, 0.0, 0.0, 0.0


@njit(cache=True)
def predict(seconds: float, turned: float, c: Constants, s: State) -> None:
    """Carry the anchor on by the gyro, which has turned by `turned`, rad."""
    n = s.n
    n[m.ANCHOR] = wrap(n[m.ANCHOR] + turned - n[m.ANCHOR_BIAS] * seconds)
    n[m.ANCHOR_TURN] += turned
    n[m.ANCHOR_VARIANCE] += seconds * (
        c.gyro_noise**2 - 2.0 * n[m.ANCHOR_COVARIANCE] + seconds * n[m.ANCHOR_BIAS_VARIANCE]
    )
    n[m.ANCHOR_COVARIANCE] -= seconds * n[m.ANCHOR_BIAS_VARIANCE]
    n[m.ANCHOR_BIAS_VARIANCE] += c.gyro_walk**2 * seconds


@njit(cache=True)
def _anchor_variance(c: Constants, s: State) -> float:
    n = s.n
    return min(n[m.ANCHOR_VARIANCE] + (c.gyro_scale * n[m.ANCHOR_TURN]) ** 2, WORST)


@njit(cache=True)
def correct(is_clean: bool, is_disturbed: bool, seconds: float, c: Constants, s: State) -> None:
    """Look at the filter after a compass sample, `seconds` after the one before.

    is_clean: the field has looked clean for a moment; is_disturbed: it does not look so now.
    """
    x, P, n = s.x, s.P, s.n
    if is_disturbed:
        n[m.CLEAN_FOR] = 0.0
        n[m.DISTURBED_SINCE] += seconds
        n[m.EPISODE] = max(n[m.EPISODE], n[m.STRENGTH])
    if not is_clean:
        return
    n[m.CLEAN_FOR] += seconds
    # A disturbance looks clean in passing for the longer, the slower it changes; and without an
    # anchor there is nothing to hold against it.
    enough = c.anchored
    if n[m.IS_ANCHORED] == 0.0 and n[m.EPISODE] > 0.0:
        enough = FIRST * c.anchored
    if n[m.CLEAN_FOR] < max(enough, c.lasting * n[m.DISTURBED_SINCE]):
        return
    departure = wrap(x[m.HEADING] - n[m.ANCHOR]) ** 2
    expected = max(SMALL, 9.0 * _anchor_variance(c, s))
    if n[m.IS_ANCHORED] == 0.0 or departure < expected or n[m.CLEAN_FOR] > c.accepted:
        n[m.IS_ANCHORED], n[m.EPISODE] = 1.0, 0.0
        n[m.ANCHOR], n[m.ANCHOR_BIAS] = x[m.HEADING], x[m.BIAS]
        n[m.ANCHOR_TURN], n[m.DISTURBED_SINCE] = 0.0, 0.0
        n[m.ANCHOR_VARIANCE], n[m.ANCHOR_COVARIANCE] = P[m.HEADING, m.HEADING], P[m.HEADING, m.BIAS]
        n[m.ANCHOR_BIAS_VARIANCE] = P[m.BIAS, m.BIAS]


@njit(cache=True)
def honest_variance(c: Constants, s: State) -> float:
    """Variance of the heading, rad^2: the filter's, unless there is reason to doubt it."""
    x, P, n = s.x, s.P, s.n
    own = P[m.HEADING, m.HEADING]
    if n[m.IS_ANCHORED] == 0.0:
        if n[m.EPISODE] > 0.0 or n[m.CLEAN_FOR] < c.settled:
            return max(own, n[m.EPISODE], SMALL)
        return own
    if n[m.CLEAN_FOR] >= c.anchored and n[m.EPISODE] == 0.0:
        return own
    anchor = _anchor_variance(c, s)
    together = anchor * n[m.EPISODE] / max(anchor + n[m.EPISODE], 1e-12)
    departure = wrap(x[m.HEADING] - n[m.ANCHOR]) ** 2
    return max(own, together, DOUBT * departure)
