"""A track laid on the true one, and how far they are apart."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Score:
    """Horizontal distances in m, after alignment; NaN without two positions that both have.

    final, rms, maximum: between the two tracks. distance: length of the true track through the
    compared positions. length: of the track itself. samples: positions compared.
    """

    final: float
    rms: float
    maximum: float
    distance: float
    length: float
    samples: int


def align(track: np.ndarray, truth: np.ndarray) -> np.ndarray:
    """The track (N, 2), put on the start of the truth (N, 2) and turned to fit it best.

    An attitude without magnetometer has an arbitrary heading, and the truth axes of its own.
    Nothing is scaled.
    """
    ours = (track - track[0]) @ np.array([1.0, 1j])
    theirs = (truth - truth[0]) @ np.array([1.0, 1j])
    turn = np.vdot(ours, theirs)
    ours = ours * (turn / abs(turn) if abs(turn) > 0.0 else 1.0)
    return np.column_stack([ours.real, ours.imag]) + truth[0]


def score(track: np.ndarray, truth: np.ndarray) -> Score:
    """Compare the horizontal components of positions (N, 2 or 3); rows with NaN truth are out."""
    seen = ~np.isnan(truth[:, :2]).any(axis=1)
    track, truth = track[seen, :2], truth[seen, :2]
    if len(track) < 2:
        return Score(*[math.nan] * 5, len(track))
    apart = np.linalg.norm(align(track, truth) - truth, axis=1)
    distance, length = (
        float(np.linalg.norm(np.diff(way, axis=0), axis=1).sum()) for way in (truth, track)
    )
    rms = math.sqrt(float(np.mean(apart * apart)))
    return Score(float(apart[-1]), rms, float(apart.max()), distance, length, len(track))
