"""What two compasses say about each other: strengths and headings, and how fast they change.

For compass k with the horizontal field H_k, in units of the undisturbed one, and heading h_k:

    dm_k = |H_k| - 1                      field error
    dh   = h_1 - h_2 - dh_r               heading difference, dh_r where nothing disturbs
    rate = (value(i) - value(j)) / (t(i) - t(j))

The paper takes the sample before for j. In continuous use that is mostly noise, so j may be the
last sample at least `interval` before. After a gap in the stamps rates begin anew, at zero.

Source: Hao, Yang and Huang, section 2.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from lodeflow_plugins.fusion.tilt_compass.compass import wrap as full_turn
from lodeflow_plugins.interference.heading_estimator.linear import wrap

VALUES = 3  # field error of the first, of the second, heading difference


class Memory(NamedTuple):
    """The samples that rates look back to.

    t: (capacity,) ns; values: (capacity, 3); at: (2,), the oldest and the number of samples.
    """

    t: np.ndarray
    values: np.ndarray
    at: np.ndarray


def memory(capacity: int) -> Memory:
    """An empty memory for `capacity` samples, at least 2."""
    return Memory(np.zeros(capacity, np.int64), np.zeros((capacity, VALUES)), np.zeros(2, np.int64))


@njit(cache=True)
def features(
    t: np.ndarray,
    first: np.ndarray,
    second: np.ndarray,
    field: float,
    difference: float,
    interval: int,
    gap: int,
    m: Memory,
    headings: np.ndarray,
    values: np.ndarray,
    rates: np.ndarray,
) -> bool:
    """Write the features of the rows of a block; any split into blocks gives the same bytes.

    Args:
        t: (N,) stamps in ns, increasing, also from block to block.
        first: (N, 3) calibrated field of the first compass, body axes forward, left, up, in any
            unit.
        second: (N, 3), of the second.
        field: strength of the undisturbed horizontal field, in that unit.
        difference: dh_r, rad.
        interval: ns, over which rates are taken; 0 for the sample before.
        gap: ns; after a longer pause rates begin anew.
        m: changed in place.
        headings: (N, 3), written: heading of each compass and of both, rad in [0, 2 pi). That of
            both lies in the middle, with dh_r taken off.
        values: (N, 3), written: field errors and heading difference, rad.
        rates: (N, 3), written: their rates per second.

    Returns:
        Whether the memory held all samples of an interval; else rates looked back less far.
    """
    capacity = len(m.t)
    held = True
    for k in range(len(t)):
        h1 = math.atan2(first[k, 1], first[k, 0])
        h2 = math.atan2(second[k, 1], second[k, 0])
        apart = wrap(h1 - h2 - difference)
        headings[k, 0] = full_turn(h1)
        headings[k, 1] = full_turn(h2)
        headings[k, 2] = full_turn(h1 - 0.5 * (apart + difference))
        values[k, 0] = math.sqrt(first[k, 0] ** 2 + first[k, 1] ** 2) / field - 1.0
        values[k, 1] = math.sqrt(second[k, 0] ** 2 + second[k, 1] ** 2) / field - 1.0
        values[k, 2] = apart
        newest = (m.at[0] + m.at[1] - 1) % capacity
        if m.at[1] and t[k] - m.t[newest] > gap:
            m.at[1] = 0
        if m.at[1] == 0:
            rates[k, 0] = rates[k, 1] = rates[k, 2] = 0.0
        else:
            # The oldest is the last one that lies an interval back, if there is one.
            while m.at[1] > 1 and t[k] - m.t[(m.at[0] + 1) % capacity] >= interval:
                m.at[0] = (m.at[0] + 1) % capacity
                m.at[1] -= 1
            seconds = (t[k] - m.t[m.at[0]]) * 1e-9
            for j in range(2):
                rates[k, j] = (values[k, j] - m.values[m.at[0], j]) / seconds
            rates[k, 2] = wrap(apart - m.values[m.at[0], 2]) / seconds
            if m.at[1] == capacity:
                held = held and t[k] - m.t[m.at[0]] >= interval
                m.at[0] = (m.at[0] + 1) % capacity
                m.at[1] -= 1
        free = (m.at[0] + m.at[1]) % capacity
        m.t[free] = t[k]
        for j in range(VALUES):
            m.values[free, j] = values[k, j]
        m.at[1] += 1
    return held
