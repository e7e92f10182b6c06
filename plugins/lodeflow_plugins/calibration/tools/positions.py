"""Positions of a platform: where a reference stands still, and what a sensor reads meanwhile."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

import lodeflow as lf
from lodeflow_plugins.calibration import rests


@dataclass(frozen=True, eq=False)
class Positions:
    """Means over P positions.

    seconds: (P,), at which each begins, since the sensor's first row; reference: (P, K);
    sensor: (P, 3); count: (P,), rows of the sensor.
    """

    seconds: np.ndarray
    reference: np.ndarray
    sensor: np.ndarray
    count: np.ndarray

    def __len__(self) -> int:
        return len(self.seconds)


def find(
    t: np.ndarray,
    reference: np.ndarray,
    floor: float,
    sensor_t: np.ndarray,
    sensor: np.ndarray,
    samples: int,
) -> Positions:
    """Return the positions in which the reference holds still for `samples` rows of the sensor.

    t: (N,), ns; reference: (N, K); floor: scatter of it that is no motion; sensor_t: (M,), ns;
    sensor: (M, 3).

    Raises CalibrationError where there is none.
    """
    found = []
    for rest in rests.find(t, reference, _rows(t, sensor_t, samples), floor):
        first, last = np.searchsorted(sensor_t, t[[rest.first, rest.last - 1]]).tolist()
        if last - first >= samples:
            rows = sensor[first:last]
            seconds = (int(t[rest.first]) - int(sensor_t[0])) * 1e-9
            found.append((seconds, rest.mean, rows.mean(axis=0), last - first))
    if not found:
        raise lf.CalibrationError(
            f"nothing holds still for {samples} samples; record positions that are held, each for "
            "a second or more, and not only a motion"
        )
    return Positions(*map(np.array, zip(*found, strict=True)))


def _rows(t: np.ndarray, sensor_t: np.ndarray, samples: int) -> int:
    """Return how many rows of a reference last as long as `samples` rows of a sensor."""
    if len(t) < 2 or len(sensor_t) < 2:
        return samples
    ratio = float(np.median(np.diff(sensor_t)) / np.median(np.diff(t)))
    return max(round(samples * ratio), 4)


def matrices(quaternion: np.ndarray) -> np.ndarray:
    """Return the rotation matrices (N, 3, 3) of quaternions (N, 4), scalar last, of any norm."""
    x, y, z, w = (quaternion / np.linalg.norm(quaternion, axis=1, keepdims=True)).T
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    return np.moveaxis(np.array(rows), 2, 0)


def continuous(quaternion: np.ndarray) -> np.ndarray:
    """Return quaternions (N, 4) with the signs that leave no jump between rows."""
    signs = np.sign(np.sum(quaternion[1:] * quaternion[:-1], axis=1))
    return quaternion * np.cumprod(np.concatenate([[1.0], np.where(signs < 0, -1.0, 1.0)]))[:, None]


def at_attitudes(
    attitude: lf.Attitude, t: np.ndarray, counts: np.ndarray, samples: int
) -> tuple[Positions, np.ndarray]:
    """Return the positions in which a platform holds still, and its attitudes (P, 3, 3) there."""
    found = find(attitude.t, continuous(attitude.quaternion), 5e-5, t, counts, samples)
    return found, matrices(found.reference)


def too_far(
    found: Positions, residual: np.ndarray, tolerance: float, unit: str
) -> lf.CalibrationError | None:
    """Return what to say if a position lies further from a fit than the tolerance.

    residual: (P, 3), in the unit.
    """
    distance = np.linalg.norm(residual, axis=1)
    worst = int(np.argmax(distance))
    if distance[worst] <= tolerance:
        return None
    return lf.CalibrationError(
        f"the data contradict each other: what was read in position {worst + 1} of {len(found)}, "
        f"at {found.seconds[worst]:.1f} s, is {distance[worst]:.3g} {unit} off the fit (at most "
        f"{tolerance:g}); look for a wrong reference, a knock, or iron that came near, and record "
        "it again"
    )
