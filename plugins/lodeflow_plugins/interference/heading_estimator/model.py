"""What the heading estimator assumes of its sensors, and the layout of its state.

Angles in rad, fields in units of the undisturbed horizontal field, times in s. Horizontal body
axes are forward and right here, headings clockwise from magnetic north.
"""

from __future__ import annotations

import math
from dataclasses import astuple, dataclass, fields
from typing import NamedTuple

import numpy as np


@dataclass(frozen=True)
class Assumptions:
    """Constants of the filter. Those of the sensors come first, and matter most.

    dip: of the earth's field; vertical: 1 where the vertical field is used, 0 for compasses that
    measure only the horizontal.
    gyro_noise: rad/sqrt(s), angle random walk; gyro_walk: rad/s/sqrt(s), of the bias;
    gyro_bias, gyro_scale: standard deviations at the start.
    compass_noise: white, per sample and axis; compass_colour: sqrt(s), density of all slow errors
    of an undisturbed compass; place: variation of the field in clean places, of strength and
    direction; gradient: of the difference of the two compasses.
    calibration: standard deviation of the residual hard and soft iron; calibration_walk: its
    drift, per sqrt(s).
    """

    dip: float = math.radians(48.0)
    vertical: float = 1.0
    gyro_noise: float = math.radians(0.15) * 0.05**0.5
    gyro_walk: float = math.radians(3e-3)
    gyro_bias: float = math.radians(0.3)
    gyro_scale: float = 0.003
    compass_noise: float = 0.005
    compass_colour: float = 0.055 * 0.05**0.5
    place: float = 0.003
    gradient: float = 0.002
    calibration: float = 0.008
    calibration_walk: float = 3e-5
    # How disturbances behave.
    correlation: float = 25.0
    smoothing: float = 0.5
    hold: float = 0.4
    gradient_gate: float = 3.0
    return_time: float = 10.0
    opening_after: float = 50.0
    opening_walk: float = 0.003
    # When a heading can be called valid.
    settled: float = 3.0
    anchored: float = 10.0
    lasting: float = 0.33
    accepted: float = 300.0

    def constants(self) -> Constants:
        """All of it, as a compiled function takes it."""
        return Constants(*(float(value) for value in astuple(self)))


Constants = NamedTuple("Constants", [(f.name, float) for f in fields(Assumptions)])  # type: ignore[misc]
"""The fields of `Assumptions`."""

# The state vector of the main filter: heading, gyro bias, mean hard iron of the two compasses
# (forward, right), mean symmetric soft iron, gyro scale error.
HEADING, BIAS, HARD_X, HARD_Y, SOFT_X, SOFT_Y, SOFT_XY, SCALE = range(8)
STATES = 8

# Numbers beside the matrices.
(
    STARTED, LAST, LAST_RATE, LAST_COMPASS, COUNT,
    VERTICAL, VERTICAL_VARIANCE, VERTICAL_DIFFERENCE, VERTICAL_DIFFERENCE_VARIANCE,
    ALONG, ACROSS, DIFFERENCE_X, DIFFERENCE_Y, DOWN, DOWN_DIFFERENCE,
    PLAIN_ALONG, PLAIN_X, PLAIN_Y, PLAIN_DOWN, PLAIN_DOWN_DIFFERENCE,
    STRENGTH, FIELD_STRENGTH, DISTURBED_FOR, NOMINAL_FOR, COMPASS_HEADING,
    CLEAN_FOR, IS_ANCHORED, ANCHOR, ANCHOR_BIAS, ANCHOR_VARIANCE, ANCHOR_COVARIANCE,
    ANCHOR_BIAS_VARIANCE, ANCHOR_TURN, DISTURBED_SINCE, EPISODE,
) = range(35)  # fmt: skip
NUMBERS = 35


class State(NamedTuple):
    """All that the filter carries from one row to the next.

    x (8,), P (8, 8): the main filter; g (2, 3), G (3, 3): difference of the two compasses along
    forward and right, as constant + cos + sin of the heading, with one covariance for both;
    n (35,): numbers, by the indices above; h (4, 8): room to work.
    """

    x: np.ndarray
    P: np.ndarray
    g: np.ndarray
    G: np.ndarray
    n: np.ndarray
    h: np.ndarray


def new_state() -> State:
    """State of a filter that has seen nothing."""
    return State(
        np.zeros(STATES),
        np.zeros((STATES, STATES)),
        np.zeros((2, 3)),
        np.zeros((3, 3)),
        np.zeros(NUMBERS),
        np.zeros((4, STATES)),
    )
