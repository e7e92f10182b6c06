"""What the ellipsoid fits of raw counts and of calibrated fields share."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

import lodeflow as lf
from lodeflow_plugins.calibration import ellipsoid

APART = 0.02
"""Readings nearer than this part of the radius to the last one taken tell nothing new."""
STILL = 0.1
"""Specific force within so many m/s^2 of its usual strength is taken for the vertical."""
NEAR = 20_000_000
"""Nanoseconds within which a specific force belongs to a reading of the field."""
RECORD = "turn the sensor slowly about all its axes, each pointing up and down once, far from iron"


@dataclass(frozen=True, eq=False)
class Aligned:
    """The map (3, 3) from readings less the centre to fields of unit strength in the body.

    found: the alignment behind it, if one was made; notes: what to say of it.
    """

    matrix: np.ndarray
    found: ellipsoid.Alignment | None
    notes: list[str]


def thinned(readings: np.ndarray, fitted: ellipsoid.Ellipsoid | None = None) -> np.ndarray:
    """Return the readings (N, 3) that are apart from each other, so that rests do not outweigh."""
    if fitted is None:
        apart = APART * float(np.linalg.norm(np.ptp(readings, axis=0))) / 2.0
    else:
        apart = APART * float(fitted.sensitivity.mean())
    return readings[_apart(readings, apart)]


def _apart(readings: np.ndarray, apart: float) -> list[int]:
    """Return the rows that are apart from each other.

    Of those that are apart from the row taken last, the first shows that it is so, and the next
    one is taken: the noise of the first is no more at random, it runs ahead of the turn, and would
    turn the field about the axis that the sensor was mostly turned about.
    """
    kept, shown = ([0] if len(readings) else []), False
    for at in range(1, len(readings)):
        if shown:
            kept.append(at)
            shown = False
        else:
            shown = bool(np.sum((readings[at] - readings[kept[-1]]) ** 2) >= apart**2)
    return kept


def fit(readings: np.ndarray, tolerance: float) -> ellipsoid.Ellipsoid:
    """Fit an ellipsoid to readings (N, 3).

    Raises CalibrationError where they do not determine one, or lie too far from it.
    """
    try:
        fitted = ellipsoid.fit(thinned(readings))
    except ValueError as error:
        raise lf.CalibrationError(f"{error}; {RECORD}") from error
    if fitted.residual_rms > tolerance:
        raise lf.CalibrationError(
            f"the data contradict each other: the readings are {100 * fitted.residual_rms:.2g} % "
            f"off the ellipsoid (at most {100 * tolerance:g} %), so the field was not the same "
            f"everywhere; {RECORD}"
        )
    return fitted


def align(
    fitted: ellipsoid.Ellipsoid,
    t: np.ndarray,
    readings: np.ndarray,
    force: tuple[np.ndarray, np.ndarray] | None,
) -> Aligned:
    """Align the axes of an ellipsoid to the body by the specific force, (stamps, (N, 3)), if any.

    Raises CalibrationError where the force does not tell the rotation.
    """
    if force is None:
        return Aligned(
            fitted.shape,
            None,
            [
                "a rotation common to all axes is not observable from the field alone: the axes "
                "of the body are taken to be those that leave the ellipsoid's shape symmetric; "
                "record the calibrated specific force along"
            ],
        )
    force_t, specific_force = force
    norm = np.linalg.norm(specific_force, axis=1)
    still = np.abs(norm - np.median(norm)) < STILL
    partner = _nearest(t, force_t)
    rows = np.flatnonzero((np.abs(force_t[partner] - t) <= NEAR) & still[partner])
    rows = rows[_apart(readings[rows], APART * float(fitted.sensitivity.mean()))]
    field = (readings[rows] - fitted.centre) @ fitted.shape
    field /= np.linalg.norm(field, axis=1, keepdims=True)
    up = specific_force[partner[rows]] / norm[partner[rows], None]
    try:
        found = ellipsoid.align(field, up)
    except ValueError as error:
        raise lf.CalibrationError(f"{error}; {RECORD}, or leave the force out") from error
    notes = []
    if found.dip < 0.0:
        notes.append(
            "the field points upward: right in the south, else the axes of the sensor are a "
            "left-handed triad, and this calibration is of no use"
        )
    return Aligned(found.rotation @ fitted.shape, found, notes)


def _nearest(t: np.ndarray, others: np.ndarray) -> np.ndarray:
    """Return the index of the nearest of other stamps for each stamp."""
    after = np.clip(np.searchsorted(others, t), 1, max(len(others) - 1, 1))
    before = after - 1
    after = np.minimum(after, len(others) - 1)
    return np.where(t - others[before] <= others[after] - t, before, after)


def quantities(fitted: ellipsoid.Ellipsoid, aligned: Aligned, readings: int) -> list[lf.Quantity]:
    """How good an ellipsoid and its alignment are."""
    found = [
        lf.Quantity("residual rms", 100.0 * fitted.residual_rms, "% of the field"),
        lf.Quantity("condition number", fitted.condition),
        lf.Quantity("readings", readings),
    ]
    if (way := aligned.found) is not None:
        found += [
            lf.Quantity("dip", np.degrees(way.dip), "°", np.degrees(way.dip_error)),
            lf.Quantity(
                "alignment, standard error about x y z", np.degrees(way.rotation_error), "°"
            ),
            lf.Quantity("alignment, residual rms", 100.0 * way.residual_rms, "% of the field"),
            lf.Quantity("alignment, condition number", way.condition),
        ]
    return found
