"""The paper's integrated heading: the compass while it is trusted, else the gyro."""

from typing import Annotated

import numpy as np
from numba import njit
from pydantic import Field

import lodeflow as lf
from lodeflow_plugins.interference.heading_ports import (
    HeadingPorts,
    at_gyro,
    no_rows,
    rate_to_the_right,
)

COMPASS = lf.Mode.COMPASS

# State: started, stamp in s, rate, heading, time since the compass was trusted, mode.
STARTED, LAST, RATE, HEADING, ALONE, MODE = range(6)
STATE_SIZE = 6


@njit(cache=True)
def integrate(
    t: np.ndarray,
    rate: np.ndarray,
    rate_row: np.ndarray,
    compass: np.ndarray,
    compass_row: np.ndarray,
    mode: np.ndarray,
    mode_row: np.ndarray,
    state: np.ndarray,
    out: np.ndarray,
) -> int:
    """Write heading, rad, and time since the compass was trusted, s, into out (N, 2).

    t: (N,) ns; rate: (M,) rad/s to the right; compass: (K,) headings, rad; mode: (L,); the rows
    (N,) say which of them stand at each stamp, -1 for none. state: (6,), changed in place. A mode
    holds until the next one. Returns the first row with a heading: that of the first compass.
    """
    begins = len(t) if state[STARTED] == 0.0 else 0
    for k in range(len(t)):
        now = t[k] * 1e-9
        measured = rate[rate_row[k]] if rate_row[k] >= 0 else state[RATE]
        if state[STARTED] != 0.0:
            seconds = now - state[LAST]
            state[HEADING] += 0.5 * (measured + state[RATE]) * seconds
            state[ALONE] += seconds
        state[LAST], state[RATE] = now, measured
        if mode_row[k] >= 0:
            state[MODE] = mode[mode_row[k]]
        if compass_row[k] >= 0 and (state[STARTED] == 0.0 or state[MODE] == COMPASS):
            if state[STARTED] == 0.0:
                state[STARTED], begins = 1.0, k
            state[HEADING] = compass[compass_row[k]]
            state[ALONE] = 0.0
        out[k, 0], out[k, 1] = state[HEADING], state[ALONE]
    return begins


class IntegratedHeading(lf.Node):
    """The compass in compass mode, else the gyro from the last trusted heading on.

    There is a heading for each gyro sample from the first compass sample on, trusted or not. Its
    sigma is the compass' accuracy, and grows with the gyro's drift while the gyro is alone.

    Source: Hao, Yang and Huang, section 1.
    """

    sync = lf.Each()

    class Params(lf.Params):
        """Accuracies; the heading itself has no parameter."""

        compass_accuracy: Annotated[float, lf.Radian] = Field(float(np.radians(1.2)), gt=0)
        """Standard deviation of a trusted compass; the paper's static accuracy."""
        drift: Annotated[float, lf.RadPerSecond] = Field(float(np.radians(0.05)), ge=0)
        """Standard deviation of the gyro's bias."""
        valid_sigma: Annotated[float, lf.Radian] = Field(float(np.radians(3.0)), gt=0)
        """Largest sigma of a heading that is called valid."""

    def start(self) -> None:
        self.state = np.zeros(STATE_SIZE)
        self.step_block(no_rows(lf.CompassFeatures), no_rows(lf.Mode), no_rows(lf.AngularRate))

    def step_block(
        self,
        compass: lf.Sparse[lf.CompassFeatures],
        mode: lf.Sparse[lf.Mode],
        gyro: lf.Sparse[lf.AngularRate],
    ) -> HeadingPorts | None:
        p = self.params
        out = np.empty((len(gyro.t), 2))
        first = integrate(
            gyro.t, rate_to_the_right(gyro), gyro.rows, compass.values.heading, compass.rows,
            mode.values.mode, mode.rows, self.state, out,
        )  # fmt: skip
        alone = out[:, 1]
        sigma = np.sqrt(p.compass_accuracy**2 + (p.drift * alone) ** 2)
        followed = (alone == 0.0).astype(np.int64)
        valid = (sigma < p.valid_sigma).astype(np.int64)
        columns = (sigma, np.zeros(len(alone)), valid, followed, followed)
        return at_gyro(gyro, first, out[:, 0], columns)
