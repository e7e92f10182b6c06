"""A Kalman filter of heading and gyro bias with a gate, for comparison."""

from typing import Annotated, Literal

import numpy as np
from numba import njit
from pydantic import Field

import lodeflow as lf
from lodeflow_plugins.interference.heading_estimator.linear import wrap
from lodeflow_plugins.interference.heading_ports import (
    HeadingPorts,
    at_gyro,
    no_rows,
    rate_to_the_right,
)

COMPASS = lf.Mode.COMPASS
CHI_SQUARE, ORACLE = 0, 1
UNKNOWN = float(np.radians(60.0)) ** 2

# State: started, stamp in s, rate, heading, bias, the covariance's three numbers, mode.
STARTED, LAST, RATE, HEADING, BIAS, P_HEADING, P_CROSS, P_BIAS, MODE = range(9)
STATE_SIZE = 9


@njit(cache=True)
def filter_rows(
    t: np.ndarray,
    rate: np.ndarray,
    rate_row: np.ndarray,
    compass: np.ndarray,
    compass_row: np.ndarray,
    mode: np.ndarray,
    mode_row: np.ndarray,
    truth: np.ndarray,
    truth_row: np.ndarray,
    settings: tuple[float, float, float, float, float],
    oracle: int,
    state: np.ndarray,
    out: np.ndarray,
) -> int:
    """Write heading, its variance, and whether the compass was used, into out (N, 3).

    Rows as in `integrated_heading`; truth: (J,) headings, rad. settings: gyro noise, rad/sqrt(s);
    walk of the bias, rad/s/sqrt(s); bias at the start; compass noise, rad; the gate, in standard
    deviations, or in rad of true error. A compass that is not in compass mode is not used. Returns
    the first row with a heading.
    """
    gyro_noise, gyro_walk, first_bias, compass_noise, gate = settings
    begins = len(t) if state[STARTED] == 0.0 else 0
    for k in range(len(t)):
        now = t[k] * 1e-9
        measured = rate[rate_row[k]] if rate_row[k] >= 0 else state[RATE]
        if state[STARTED] != 0.0:
            dt = now - state[LAST]
            mean = 0.5 * (measured + state[RATE])
            state[HEADING] = wrap(state[HEADING] + (mean - state[BIAS]) * dt)
            state[P_HEADING] += dt * (dt * state[P_BIAS] - 2.0 * state[P_CROSS] + gyro_noise**2)
            state[P_CROSS] -= dt * state[P_BIAS]
            state[P_BIAS] += gyro_walk**2 * dt
        state[LAST], state[RATE] = now, measured
        if mode_row[k] >= 0:
            state[MODE] = mode[mode_row[k]]
        used = 0.0
        if compass_row[k] >= 0:
            heading = compass[compass_row[k]]
            if state[STARTED] == 0.0:
                state[STARTED], state[HEADING], begins = 1.0, wrap(heading), k
                state[P_HEADING], state[P_CROSS], state[P_BIAS] = UNKNOWN, 0.0, first_bias**2
            innovation = wrap(heading - state[HEADING])
            s = state[P_HEADING] + compass_noise**2
            if oracle:
                row = truth_row[k]
                usable = row >= 0 and abs(wrap(heading - truth[row])) < gate
            else:
                usable = state[MODE] == COMPASS and innovation * innovation < gate * gate * s
            if usable:
                used = 1.0
                gain, gain_bias = state[P_HEADING] / s, state[P_CROSS] / s
                state[HEADING] = wrap(state[HEADING] + gain * innovation)
                state[BIAS] += gain_bias * innovation
                state[P_BIAS] -= gain_bias * state[P_CROSS]
                state[P_CROSS] *= 1.0 - gain
                state[P_HEADING] *= 1.0 - gain
        out[k, 0], out[k, 1], out[k, 2] = state[HEADING], state[P_HEADING], used
    return begins


class GatedKalman(lf.Node):
    """Heading and gyro bias by a Kalman filter that refuses compass samples by a gate.

    For comparison with `integrated_heading` and `heading_estimator`. The usual gate refuses what
    lies too many standard deviations from the prediction: it locks itself out once the heading
    has drifted away. The oracle looks at the truth, which nothing in the field has. Without a
    mode, all samples come to the gate.
    """

    sync = lf.Each()

    class Params(lf.Params):
        """Noises and gate."""

        gate: Literal["chi_square", "oracle"] = "chi_square"
        """What refuses compass samples."""
        deviations: float = Field(3.0, gt=0)
        """Of the chi-square gate."""
        error: Annotated[float, lf.Radian] = Field(float(np.radians(2.0)), gt=0)
        """True error of a compass below which the oracle uses it."""
        gyro_noise: Annotated[float, lf.RadPerSecond] = Field(float(np.radians(0.15)), gt=0)
        """White noise of the rate per sample at 20 Hz; at another rate, of the same density."""
        gyro_walk: Annotated[float, lf.RadPerSecond] = Field(float(np.radians(0.0017)), gt=0)
        """Random walk of the bias in a second."""
        gyro_bias: Annotated[float, lf.RadPerSecond] = Field(float(np.radians(0.3)), gt=0)
        """Bias at the start, one standard deviation."""
        compass_noise: Annotated[float, lf.Radian] = Field(float(np.radians(1.2)), gt=0)
        """Standard deviation of an undisturbed compass."""
        valid_sigma: Annotated[float, lf.Radian] = Field(float(np.radians(3.0)), gt=0)
        """Largest sigma of a heading that is called valid."""

    def start(self) -> None:
        p = self.params
        oracle = p.gate == "oracle"
        self.oracle = ORACLE if oracle else CHI_SQUARE
        self.settings = (
            p.gyro_noise * 0.05**0.5,
            p.gyro_walk,
            p.gyro_bias,
            p.compass_noise,
            p.error if oracle else p.deviations,
        )
        self.state = np.zeros(STATE_SIZE)
        self.state[MODE] = COMPASS
        self.step_block(no_rows(lf.CompassFeatures), no_rows(lf.AngularRate))  # compiles

    def step_block(
        self,
        compass: lf.Sparse[lf.CompassFeatures],
        gyro: lf.Sparse[lf.AngularRate],
        mode: lf.Sparse[lf.Mode] | None = None,
        truth: lf.Sparse[lf.Heading] | None = None,
    ) -> HeadingPorts | None:
        absent = np.full(len(gyro.t), -1)
        modes, mode_row = (
            (np.empty(0, np.int64), absent) if mode is None else (mode.values.mode, mode.rows)
        )
        true, true_row = (
            (np.empty(0), absent) if truth is None else (truth.values.heading, truth.rows)
        )
        out = np.empty((len(gyro.t), 3))
        first = filter_rows(
            gyro.t, rate_to_the_right(gyro), gyro.rows, compass.values.heading, compass.rows,
            modes, mode_row, true, true_row, self.settings, self.oracle, self.state, out,
        )  # fmt: skip
        sigma = np.sqrt(out[:, 1])
        used = out[:, 2].astype(np.int64)
        valid = (sigma < self.params.valid_sigma).astype(np.int64)
        return at_gyro(gyro, first, out[:, 0], (sigma, np.zeros(len(sigma)), valid, used, used))
