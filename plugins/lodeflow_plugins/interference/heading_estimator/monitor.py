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

NONE, TENTATIVE, FIRM = 0.0, 1.0, 2.0
SHARP = math.radians(1.5) ** 2
"""Variance of an anchor that still knows the heading."""
CLOSE = math.radians(1.5) ** 2
"""A square of a departure from such an anchor that confirms the compass at once."""
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

    is_clean: the field has looked clean for a moment; is_disturbed: it does not look so now, or
    its direction contradicts the gyro.
    """
    x, n = s.x, s.n
    if is_disturbed:
        n[m.CLEAN_FOR] = 0.0
        n[m.DISTURBED_SINCE] += seconds
        n[m.EPISODE] = max(n[m.EPISODE], n[m.STRENGTH])
    if is_disturbed or not is_clean:
        return
    n[m.CLEAN_FOR] += seconds
    departure = wrap(x[m.HEADING] - n[m.ANCHOR]) ** 2
    drifted = _anchor_variance(c, s)
    if n[m.CLEAN_FOR] > c.accepted:
        _anchor(FIRM, s)
    elif n[m.IS_ANCHORED] == FIRM:
        if drifted < SHARP:
            # The anchor still knows the heading: a moment tells whether the compass does.
            enough = c.settled if departure < max(CLOSE, 9.0 * drifted) else c.anchored
        else:
            # A disturbance looks clean in passing for the longer, the slower it changes.
            enough = max(c.anchored, c.lasting * n[m.DISTURBED_SINCE])
        if n[m.CLEAN_FOR] >= enough and departure < max(SMALL, 9.0 * drifted):
            _anchor(FIRM, s)
    elif n[m.CLEAN_FOR] >= c.anchored:
        # Nothing to hold against it yet: after a start in a disturbance two clean times have to
        # agree, or one of them has to be long.
        agrees = n[m.IS_ANCHORED] == TENTATIVE and departure < max(SMALL, 9.0 * drifted)
        agrees = agrees and n[m.DISTURBED_SINCE] > 0.0
        if agrees or n[m.EPISODE] == 0.0 or n[m.CLEAN_FOR] > FIRST * c.anchored:
            _anchor(FIRM, s)
        elif n[m.IS_ANCHORED] == NONE or n[m.DISTURBED_SINCE] > 0.0:
            strongest = n[m.EPISODE]
            _anchor(TENTATIVE, s)
            n[m.EPISODE] = strongest


@njit(cache=True)
def _anchor(how: float, s: State) -> None:
    """Take the filter's heading for the anchor."""
    x, P, n = s.x, s.P, s.n
    n[m.IS_ANCHORED], n[m.EPISODE] = how, 0.0
    n[m.ANCHOR], n[m.ANCHOR_BIAS] = x[m.HEADING], x[m.BIAS]
    n[m.ANCHOR_TURN], n[m.DISTURBED_SINCE] = 0.0, 0.0
    n[m.ANCHOR_VARIANCE] = P[m.HEADING, m.HEADING]
    n[m.ANCHOR_COVARIANCE] = P[m.HEADING, m.BIAS]
    n[m.ANCHOR_BIAS_VARIANCE] = P[m.BIAS, m.BIAS]


@njit(cache=True)
def honest_variance(c: Constants, s: State) -> float:
    """Variance of the heading, rad^2: the filter's, unless there is reason to doubt it."""
    x, P, n = s.x, s.P, s.n
    own = P[m.HEADING, m.HEADING]
    if n[m.IS_ANCHORED] != FIRM:
        if n[m.EPISODE] > 0.0 or n[m.CLEAN_FOR] < c.settled:
            return max(own, n[m.EPISODE], SMALL)
        return own
    if n[m.CLEAN_FOR] >= c.settled and n[m.EPISODE] == 0.0:
        return own
    anchor = _anchor_variance(c, s)
    together = anchor * n[m.EPISODE] / max(anchor + n[m.EPISODE], 1e-12)
    departure = wrap(x[m.HEADING] - n[m.ANCHOR]) ** 2
    return max(own, together, DOUBT * departure)
