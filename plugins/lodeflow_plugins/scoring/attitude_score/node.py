"""The score of an attitude as a node."""

from typing import Annotated

import numpy as np
from pydantic import Field

import lodeflow as lf
from lodeflow_plugins.scoring.attitude_score import metric


class ScoreAttitude(lf.Node):
    """Error of an estimated attitude against the truth, in total, in heading and in inclination.

    Both are earth <- body with z vertical. Scored are the truth's rows with moving = 1 and
    without NaN, each against the estimate of the same stamp. A scored row without estimate
    counts as missing, also at the beginning, when a filter has not started yet: one such row, and
    the errors are NaN, so that silence is no way to a good score. `settle` leaves a beginning out
    on purpose. One message, at the end.

    Source: Laidig et al. 2021, Data 6(7):72 (BROAD). No heading offset is removed.
    """

    sync = lf.Each()

    class Params(lf.Params):
        """What is scored."""

        settle: Annotated[float, lf.Second] = Field(0.0, ge=0)
        """Time after the first row of the truth that is not scored."""

    def start(self) -> None:
        self.state = metric.new_state()
        self.last: int | None = None
        self.begin: int | None = None
        metric.accumulate(np.empty((0, 4)), np.empty((0, 4)), np.empty(0, np.int64), self.state)

    def step_block(
        self, estimate: lf.Sparse[lf.Attitude], truth: lf.Sparse[lf.AttitudeTruth]
    ) -> None:
        self.last = int(truth.t[-1])
        at = truth.rows >= 0
        t = truth.t[at]
        if not len(t):
            return
        if self.begin is None:
            self.begin = int(t[0]) + lf.seconds(self.params.settle)
        # The last row stands for "no estimate", which is index -1.
        estimates = np.concatenate([estimate.values.quaternion, np.full((1, 4), np.nan)])
        moving = np.where(t >= self.begin, truth.values.moving, 0)
        rows = estimates[estimate.rows[at]]
        metric.accumulate(rows, truth.values.quaternion, moving, self.state)

    def finish(self) -> lf.AttitudeScore | None:
        if self.last is None:
            return None
        score = metric.score(self.state)
        if score.missing:
            self.log.warning(
                "%d of %d scored samples have no estimate, so the errors are NaN",
                score.missing,
                score.rows,
            )
        return lf.AttitudeScore(
            self.last,
            score.total_rmse,
            score.heading_rmse,
            score.inclination_rmse,
            score.total_max,
            score.heading_max,
            score.inclination_max,
            score.rows,
            score.missing,
        )
