"""Heading of a frame that is level and drifts slowly, from a magnetometer turned into it.

A tilted body has no level compass. Its attitude, whose inclination is right and whose heading
drifts, turns the field into a frame with z up; the field tells the heading of that frame. The
attitude has the gyro in it already, so the rate that the heading estimator hears is zero, and its
gyro bias is the drift. There is one magnetometer, which stands for both compasses, so nothing
differs between them; hard iron turns in that frame and is not a state there.

Source: our own; the frame as in Laidig and Seel 2023, VQF, section 3.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from lodeflow_plugins.fusion.rotations import apply, four, matrix, multiply, three
from lodeflow_plugins.interference.heading_estimator import filter as estimator
from lodeflow_plugins.interference.heading_estimator.model import Constants, State


class Place(NamedTuple):
    """What is known of the undisturbed field, as the mean of the first seconds.

    mean (3,): mean of the field in the level frame, T; n (4,): how many, stamp of the first, 1
    when that time is over, horizontal strength, T.
    """

    mean: np.ndarray
    n: np.ndarray


COUNT, BEGAN, KNOWN, HORIZONTAL = range(4)
NO_ROW = np.full(1, -1)
ROW = np.zeros(1, np.int64)
STILL = np.zeros(1)


def new_place() -> Place:
    """A place of which nothing is known."""
    return Place(np.zeros(3), np.zeros(4))


@njit(cache=True)
def run(
    t: np.ndarray,
    attitude: np.ndarray,
    attitude_row: np.ndarray,
    field: np.ndarray,
    field_row: np.ndarray,
    start_duration: float,
    c: Constants,
    state: State,
    place: Place,
    out: np.ndarray,
    status: np.ndarray,
) -> int:
    """Filter the rows of a block; any split into blocks gives the same bytes.

    Args:
        t: (N,) stamps in ns, increasing, also from block to block.
        attitude: (A, 4) level frame <- body.
        attitude_row: (N,) its row at each stamp, -1 for none.
        field: (F, 3) magnetic field in the body frame, T; used where an attitude meets it.
        field_row: (N,) its row at each stamp, -1 for none.
        start_duration: s, over which the undisturbed field is measured.
        c: of `Assumptions.constants`, with a dip of 0: down is the difference from that field.
        state: changed in place.
        place: of `new_place`, changed in place.
        out: (A, 4), magnetic ENU <- body, written from the first row with an estimate on.
        status: (A, 5), written likewise; as `filter.run` writes it.

    Returns:
        The first attitude with an estimate; A if there is none.
    """
    begins = len(attitude)
    level, one = np.empty((1, 3)), np.empty((1, 5))
    for k in range(len(t)):
        a = attitude_row[k]
        if a < 0:
            continue
        q = four(attitude[a], 0)
        f = field_row[k]
        if f >= 0:
            forward, left, up = apply(matrix(q), three(field[f], 0))
            _look(t[k], forward, left, up, start_duration, place)
            if place.n[KNOWN] != 0.0:
                h = place.n[HORIZONTAL]
                level[0, 0], level[0, 1] = forward / h, -left / h
                level[0, 2] = (place.mean[2] - up) / h
            else:
                f = -1
        if place.n[KNOWN] == 0.0:
            continue
        estimator.run(
            t[k : k + 1], STILL, ROW, level, level, ROW if f >= 0 else NO_ROW, c, state, one
        )
        # From clockwise of north to counter-clockwise of east.
        half = 0.25 * math.pi - 0.5 * one[0, 0]
        turned = multiply((0.0, 0.0, math.sin(half), math.cos(half)), q)
        for i in range(4):
            out[a, i] = turned[i]
        status[a] = one[0]
        begins = min(begins, a)
    return begins


@njit(cache=True)
def _look(now: int, x: float, y: float, z: float, duration: float, place: Place) -> None:
    """Measure the field (x, y, z) of the place until `duration` is over; then keep it."""
    mean, n = place.mean, place.n
    if n[KNOWN] != 0.0:
        return
    if n[COUNT] == 0.0:
        n[BEGAN] = now
    n[COUNT] += 1.0
    for i, value in enumerate((x, y, z)):
        mean[i] += (value - mean[i]) / n[COUNT]
    horizontal = math.hypot(mean[0], mean[1])
    if (now - n[BEGAN]) * 1e-9 >= duration and horizontal > 0.0:
        n[HORIZONTAL], n[KNOWN] = horizontal, 1.0
