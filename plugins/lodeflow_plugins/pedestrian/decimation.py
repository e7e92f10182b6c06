"""Fewer samples, each the mean of several."""

import numpy as np
from numba import njit
from pydantic import Field

import lodeflow as lf


class ImuDecimator(lf.Node):
    """Replace each `factor` consecutive samples by their mean, at the stamp of the last.

    200 Hz become 50 Hz with a factor of 4. What is left over at the end is dropped.
    """

    class Params(lf.Params):
        """How many."""

        factor: int = Field(4, ge=1)
        """Samples that become one."""

    def start(self) -> None:
        self.sums = np.zeros(7)
        self.step_block(lf.Imu.empty())  # compiles

    def step_block(self, imu: lf.Imu) -> lf.Imu:
        size = len(imu) // self.params.factor + 1
        rate, force, row = np.empty((size, 3)), np.empty((size, 3)), np.empty(size, np.int64)
        n = means(
            imu.angular_velocity,
            imu.linear_acceleration,
            self.params.factor,
            self.sums,
            rate,
            force,
            row,
        )
        return lf.Imu(imu.t[row[:n]], rate[:n], force[:n])


@njit(cache=True)
def means(
    rate: np.ndarray,
    force: np.ndarray,
    factor: int,
    sums: np.ndarray,
    mean_rate: np.ndarray,
    mean_force: np.ndarray,
    row: np.ndarray,
) -> int:
    """Write the mean of each `factor` rows, and the last row of each; return how many.

    rate, force: (N, 3). sums: (7,), zeros at first: the sums of an unfinished mean and how many
    rows are in it. mean_rate, mean_force: (N // factor + 1, 3); row: int64 (N // factor + 1,).
    """
    done = 0
    for k in range(len(rate)):
        for i in range(3):
            sums[i] += rate[k, i]
            sums[3 + i] += force[k, i]
        sums[6] += 1.0
        if sums[6] == factor:
            for i in range(3):
                mean_rate[done, i] = sums[i] / factor
                mean_force[done, i] = sums[3 + i] / factor
            sums[:] = 0.0
            row[done] = k
            done += 1
    return done
