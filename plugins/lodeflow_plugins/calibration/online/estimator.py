"""Hard iron from a magnetometer and a gyroscope, estimated while running.

While a body turns, the earth's field turns in its axes as the gyroscope says, and a hard iron b
does not. Within a segment of a few seconds, with the rotation R_k from the body at row k into the
body at its beginning,

    m_k = R_k^T e + b + noise,

where the field e at the beginning is unknown. With the means S = mean(R_k), m = mean(m_k) and
g = mean(R_k m_k) over the segment, e eliminated, least squares for b is

    (I - S^T S) b = m - S^T g.

I - S^T S is what the segment tells: nothing without rotation, nothing about the axis of a
rotation, up to one across it. No strength or dip of the field is assumed, and no level.

The error of a segment is not the sensor's noise, which averages out, but the field itself, which
is nowhere the same indoors. Its variance s^2 is that of a component of what segments have against
the estimate before them, or `sigma` squared if that is more, and counts for a segment as a whole,
however many samples it has. So segments add up as information

    L = sum (I - S^T S) / s^2,      P = (L + I / prior^2)^-1,      b = P sum (m - S^T g) / s^2

with an exponential memory. Two gates keep b from doing harm:

- observability: only the part of b along the axes of P whose standard deviation is below `trusted`
  is a candidate;
- evidence: before a segment is added, the candidate found without it is judged by how much nearer
  to the segment it comes than no correction does; the sum of that, per s^2 and with the same
  memory, has to exceed `evidence`.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

GAP = 200_000_000
"""Nanoseconds without a row, or a rate, after which the rotation is lost and a segment begins."""


class Settings(NamedTuple):
    """What the kernel takes: ns, fraction, tesla, and without unit.

    segment: length, ns; fading: what is left of the past after a segment; sigma: least standard
    error of a segment, T; prior: of b before any, T; trusted: largest standard deviation of what is
    applied, T; evidence: least gain of what is applied.
    """

    segment: int
    fading: float
    sigma: float
    prior: float
    trusted: float
    evidence: float


NEVER = np.iinfo(np.int64).min


class Segment(NamedTuple):
    """What a segment ended with: an estimate of the hard iron, and what is removed from then on.

    row: of the field, at which it ended; estimate, applied: (3,), T; covariance: (3, 3), T^2, of
    the estimate.
    """

    row: int
    estimate: np.ndarray
    covariance: np.ndarray
    applied: np.ndarray


class Estimator:
    """Removes hard iron from fields as they come, and estimates it.

    Sums over a segment are a compiled loop over rows; what comes of a segment is a few products of
    small matrices, once in some seconds.
    """

    def __init__(self, settings: Settings) -> None:
        self.settings = settings
        self.times = np.array([NEVER, NEVER, 0, NEVER])
        """Stamps of the last row and of the segment's beginning, the segment's rows, and the stamp
        of the last rate."""
        self.rate = np.zeros(3)
        self.turn = np.empty((3, 3))
        self.sums = np.empty(16)
        """Over the segment: of R (9), m (3), R m (3) and |m|^2 (1)."""
        _begin(NEVER, self.times, self.turn, self.sums)
        self.information = np.zeros((3, 3))
        self.vector = np.zeros(3)
        self.misfits, self.weight = 0.0, 0.0
        """Mean squares of what segments had against the estimate before them, and their number."""
        self.gain = 0.0
        self.estimate = np.zeros(3)
        self.candidate = np.zeros(3)
        self.applied = np.zeros(3)

    def run(
        self,
        t: np.ndarray,
        rate: np.ndarray,
        rate_rows: np.ndarray,
        field: np.ndarray,
        field_rows: np.ndarray,
    ) -> tuple[np.ndarray, list[Segment]]:
        """Return the corrected fields (M, 3), and the segments that ended.

        t: (N,), ns; rate: (L, 3), rad/s; rate_rows: (N,), its index at each row, -1 for none;
        field: (M, 3), T; field_rows: (N,), likewise.
        """
        corrected = np.empty(field.shape)
        inputs = t, rate, rate_rows, field, field_rows
        state = self.times, self.rate, self.turn, self.sums
        segments = []
        row = _sum_up(0, *inputs, self.settings.segment, *state, self.applied, corrected)
        while row < len(t):
            segments.append(self._fold(int(field_rows[row])))
            corrected[field_rows[row]] = field[field_rows[row]] - self.applied
            row = _sum_up(row + 1, *inputs, self.settings.segment, *state, self.applied, corrected)
        return corrected, segments

    def _fold(self, row: int) -> Segment:
        """Judge the candidate by a segment, then add the segment, and find the next candidate."""
        settings = self.settings
        means = self.sums / self.times[2]
        turn, field, turned, square = means[:9].reshape(3, 3), means[9:12], means[12:15], means[15]

        def misfit(b: np.ndarray) -> float:
            earth = turned - turn @ b
            return float(square - 2.0 * (b @ field) + b @ b - earth @ earth)

        without = misfit(np.zeros(3))
        self.gain = settings.fading * self.gain + without - misfit(self.candidate)
        self.weight = settings.fading * self.weight + 3.0
        self.misfits = settings.fading * self.misfits + min(without, misfit(self.estimate))
        variance = max(settings.sigma**2, self.misfits / self.weight)
        self.information = settings.fading * self.information + np.eye(3) - turn.T @ turn
        self.vector = settings.fading * self.vector + field - turn.T @ turned
        covariance = np.linalg.inv(self.information / variance + np.eye(3) / settings.prior**2)
        self.estimate = covariance @ self.vector / variance
        values, axes = np.linalg.eigh(covariance)
        told = axes[:, values < settings.trusted**2]
        self.candidate = told @ (told.T @ self.estimate)
        proved = self.gain > settings.evidence * variance
        self.applied = self.candidate if proved else np.zeros(3)
        _begin(self.times[0], self.times, self.turn, self.sums)
        return Segment(row, self.estimate, covariance, self.applied)


@njit(cache=True)
def _begin(t: int, times: np.ndarray, turn: np.ndarray, sums: np.ndarray) -> None:
    """Begin a segment."""
    times[1], times[2] = t, 0
    for i in range(3):
        for j in range(3):
            turn[i, j] = 1.0 if i == j else 0.0
    sums[:] = 0.0


@njit(cache=True)
def _rotate(turn: np.ndarray, x: float, y: float, z: float) -> None:
    """Multiply a rotation by exp of the rotation vector (x, y, z), rad, from the right."""
    angle2 = x * x + y * y + z * z
    angle = np.sqrt(angle2)
    if angle < 1e-6:
        sine, versine = 1.0, 0.5
    else:
        sine, versine = np.sin(angle) / angle, (1.0 - np.cos(angle)) / angle2
    for i in range(3):
        a, b, c = turn[i, 0], turn[i, 1], turn[i, 2]
        # The row r times exp(w x) is r + sine (r x w) + versine ((r x w) x w).
        p, q, s = b * z - c * y, c * x - a * z, a * y - b * x
        turn[i, 0] = a + sine * p + versine * (q * z - s * y)
        turn[i, 1] = b + sine * q + versine * (s * x - p * z)
        turn[i, 2] = c + sine * s + versine * (p * y - q * x)


@njit(cache=True)
def _sum_up(
    first: int,
    t: np.ndarray,
    rate: np.ndarray,
    rate_rows: np.ndarray,
    field: np.ndarray,
    field_rows: np.ndarray,
    segment: int,
    times: np.ndarray,
    held: np.ndarray,
    turn: np.ndarray,
    sums: np.ndarray,
    applied: np.ndarray,
    corrected: np.ndarray,
) -> int:
    """Go on from row `first` to the row that ends a segment, and return it; N if none does."""
    for k in range(first, len(t)):
        last = times[0]
        times[0] = t[k]
        heard, at = times[3], rate_rows[k]
        if at >= 0:
            times[3] = t[k]
        known = times[3] != NEVER and t[k] - times[3] <= GAP
        if heard == NEVER or t[k] - heard > GAP or t[k] - last > GAP:
            _begin(t[k], times, turn, sums)
        else:
            # Half a sample of delay is a microtesla of hard iron in a fast turn: no rectangles.
            dt = (t[k] - last) * 1e-9
            x, y, z = held[0], held[1], held[2]
            if at >= 0:
                x, y, z = (x + rate[at, 0]) / 2, (y + rate[at, 1]) / 2, (z + rate[at, 2]) / 2
            _rotate(turn, x * dt, y * dt, z * dt)
        if at >= 0:
            held[:] = rate[at]
        row = field_rows[k]
        if row < 0:
            continue
        for i in range(3):
            corrected[row, i] = field[row, i] - applied[i]
        if not known:
            continue
        times[2] += 1
        for i in range(3):
            turned = 0.0
            for j in range(3):
                sums[3 * i + j] += turn[i, j]
                turned += turn[i, j] * field[row, j]
            sums[9 + i] += field[row, i]
            sums[12 + i] += turned
            sums[15] += field[row, i] * field[row, i]
        if t[k] - times[1] >= segment:
            return k
    return len(t)
