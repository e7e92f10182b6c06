"""The two stages of recognition as arithmetic on columns.

Source: Hao, Yang and Huang, sections 3 and 4.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from lodeflow_plugins.interference.fuzzy_c_means import belong

TRUSTED = 2
"""Clusters, of those nearest the origin, whose memberships make the credibility (the paper's fourth
and fifth)."""


@njit(cache=True)
def credibility(
    field_error: np.ndarray,
    difference: np.ndarray,
    passed: np.ndarray,
    scales: tuple[float, float],
    first_centres: np.ndarray,
    second_centres: np.ndarray,
    fuzzifier: float,
) -> np.ndarray:
    """Credibility K_c of each sample, (N,); 0 where the stage before has refused it.

    Each compass has the features E_m = |dm| / V_m and E_h = |dh| / V_h, and is as credible as the
    sum of its memberships in the trusted clusters; both together as the lesser.

    Args:
        field_error: (N, 2), of each compass.
        difference: (N,), of the headings.
        passed: (N,), above 0 where the stage before accepts.
        scales: V_m and V_h, in the units of field_error and difference.
        first_centres: (c, 2), of the first compass' clusters, that nearest the origin last.
        second_centres: (c, 2), of the second.
        fuzzifier: m.
    """
    found = np.zeros(len(difference))
    point = np.empty((1, 2))
    first = np.empty((1, len(first_centres)))
    second = np.empty((1, len(second_centres)))
    for k in range(len(found)):
        if passed[k] <= 0:
            continue
        point[0, 1] = abs(difference[k]) / scales[1]
        point[0, 0] = abs(field_error[k, 0]) / scales[0]
        belong(point, first_centres, fuzzifier, first)
        point[0, 0] = abs(field_error[k, 1]) / scales[0]
        belong(point, second_centres, fuzzifier, second)
        one = other = 0.0
        for i in range(TRUSTED):
            one += first[0, len(first_centres) - 1 - i]
            other += second[0, len(second_centres) - 1 - i]
        found[k] = min(one, other)
    return found
