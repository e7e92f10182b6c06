"""The score of a step counter as a node."""

from typing import Literal

import numpy as np

import lodeflow as lf
from lodeflow_plugins.scoring.step_score import matching


class ScoreSteps(lf.Node):
    """Steps that were counted against those that were made. One message, at the end.

    A step belongs to the true step in whose interval, from the stance before to the stance after
    it, its moment lies.
    """

    sync = lf.Each()

    class Params(lf.Params):
        """What a true step is."""

        steps_per_stance: Literal[1, 2] = 1
        """As of the counter; 2 where it counts the steps of both feet and the truth those of
        one."""

    def start(self) -> None:
        self.last: int | None = None
        self.count = 0
        self.found: list[tuple[int, int]] = []
        self.truth: list[tuple[int, int]] = []

    def step_block(self, steps: lf.Sparse[lf.Step], truth: lf.Sparse[lf.StepTruth]) -> None:
        if not len(steps.t):
            return
        self.last = int(steps.t[-1])
        counts = steps.values.count
        times = np.diff(counts, prepend=self.count)
        if len(counts):
            self.count = int(counts[-1])
        self.found += zip(steps.values.moment.tolist(), times.tolist(), strict=True)
        self.truth += zip(truth.values.t.tolist(), truth.values.count.tolist(), strict=True)

    def finish(self) -> lf.StepScore | None:
        if self.last is None:
            return None
        found = np.array(self.found, np.int64).reshape(-1, 2)
        truth = np.array(self.truth, np.int64).reshape(-1, 2)
        counts = truth[:, 1] * self.params.steps_per_stance
        score = matching.score(found[:, 0], found[:, 1], truth[:, 0], counts)
        error = abs(score.counted - score.true)
        return lf.StepScore(self.last, score.counted, score.true, error, score.missed, score.extra)
