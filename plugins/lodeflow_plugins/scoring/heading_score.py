"""The score of a heading as a node."""

from typing import Annotated

import numpy as np
from pydantic import Field

import lodeflow as lf
from lodeflow_plugins.scoring.recognition import heading_error


class ScoreHeading(lf.Node):
    """Error of a heading against the truth, and of what its estimator calls valid.

    Scored are the truth's rows, each against the heading of the same stamp. A row without heading
    is missing, and one of them makes all errors NaN; `settle` leaves a beginning out on purpose.
    Without a status, all headings count as valid. One message, at the end.
    """

    sync = lf.Each()

    class Params(lf.Params):
        """What is scored."""

        settle: Annotated[float, lf.Second] = Field(0.0, ge=0)
        """Time after the first row of the truth that is not scored."""

    def start(self) -> None:
        self.last: int | None = None
        self.begin: int | None = None
        self.errors: list[np.ndarray] = []
        self.valid: list[np.ndarray] = []

    def step_block(
        self,
        estimate: lf.Sparse[lf.Heading],
        truth: lf.Sparse[lf.Heading],
        status: lf.Sparse[lf.HeadingStatus] | None = None,
    ) -> None:
        self.last = int(truth.t[-1])
        if self.begin is None and len(truth.values):
            self.begin = int(truth.values.t[0]) + lf.seconds(self.params.settle)
        at = np.flatnonzero(truth.rows >= 0)
        at = at[truth.t[at] >= self.begin] if len(at) else at
        # The last row stands for "none", which is index -1.
        headings = np.append(estimate.values.heading, np.nan)[estimate.rows[at]]
        self.errors.append(heading_error(headings, truth.values.heading[truth.rows[at]]))
        if status is not None:
            self.valid.append(np.append(status.values.valid, 0)[status.rows[at]] > 0)

    def finish(self) -> lf.HeadingScore | None:
        if self.last is None:
            return None
        error = np.concatenate(self.errors)
        missing = int(np.isnan(error).sum())
        valid = np.concatenate(self.valid) if self.valid else np.isfinite(error)
        nan = float("nan")
        found = [nan] * 6
        if len(error) and not missing:
            found = [
                float(np.sqrt(np.mean(error * error))),
                float(np.percentile(error, 99)),
                float(error.max()),
                float(error[-1]),
                float(valid.mean()),
                float(error[valid].max()) if valid.any() else nan,
            ]
        elif missing:
            self.log.warning("%d of %d samples have no heading, so the errors are NaN", missing,
                             len(error))  # fmt: skip
        return lf.HeadingScore(self.last, *found, len(error), missing)
