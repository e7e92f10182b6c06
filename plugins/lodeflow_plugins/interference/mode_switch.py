"""Which sensor the heading follows, from the credibility of the compass."""

from typing import Annotated

import numpy as np
from numba import njit
from pydantic import Field

import lodeflow as lf

NONE, COMPASS, GYRO = lf.Mode.NONE, lf.Mode.COMPASS, lf.Mode.GYRO

# State: mode, stamp of the last switch, stamp since when samples speak for the other mode, whether
# they do.
SWITCH_STATE = 4


@njit(cache=True)
def switch(
    t: np.ndarray,
    valid: np.ndarray,
    leave: int,
    come_back: int,
    dwell: int,
    state: np.ndarray,
    mode: np.ndarray,
) -> None:
    """Write the mode of each sample into mode (N,); state: (4,) int64, changed in place.

    t: (N,) ns; valid: (N,); leave, come_back: ns for which samples have to be invalid, or valid
    again, without a break; dwell: ns that a mode lasts at least.
    """
    for k in range(len(t)):
        wanted = COMPASS if valid[k] > 0 else GYRO
        if state[0] == NONE:
            state[0], state[1], state[3] = wanted, t[k], 0
        elif wanted == state[0]:
            state[3] = 0
        else:
            if state[3] == 0:
                state[2], state[3] = t[k], 1
            needed = leave if wanted == GYRO else come_back
            if t[k] - state[2] >= needed and t[k] - state[1] >= dwell:
                state[0], state[1], state[3] = wanted, t[k], 0
        mode[k] = state[0]


class ModeSwitch(lf.Node):
    """Compass while its samples are valid, gyro while they are not.

    With the defaults every sample decides for itself, as in the paper. A compass that is believed
    again too early costs a wrong heading, one that is believed too late costs drift.

    Source: Hao, Yang and Huang, section 1.
    """

    class Params(lf.Params):
        """When to switch."""

        leave_after: Annotated[float, lf.Second] = Field(0.0, ge=0)
        """Time for which samples have to be invalid before the gyro takes over."""
        return_after: Annotated[float, lf.Second] = Field(0.0, ge=0)
        """Time for which samples have to be valid before the compass is followed again."""
        dwell: Annotated[float, lf.Second] = Field(0.0, ge=0)
        """Shortest stay in a mode."""

    def start(self) -> None:
        p = self.params
        self.times = tuple(lf.seconds(s) for s in (p.leave_after, p.return_after, p.dwell))
        self.state = np.zeros(SWITCH_STATE, np.int64)
        none = np.empty(0, np.int64)
        switch(none, none, *self.times, self.state, none)  # compiles

    def step(self, credibility: lf.Credibility) -> lf.Mode:
        return self.step_block(credibility.as_block()).row(0)

    def step_block(self, credibility: lf.Credibility) -> lf.Mode:
        mode = np.empty(len(credibility.t), np.int64)
        switch(credibility.t, credibility.valid, *self.times, self.state, mode)
        return lf.Mode(credibility.t, mode)
