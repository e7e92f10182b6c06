"""The difference of two streams of corrections as a node."""

import numpy as np

import lodeflow as lf
from lodeflow_plugins.scoring.gravity_score import difference


class ScoreGravity(lf.Node):
    """Mean, standard deviation and maximum of the difference of two streams of corrections.

    Over the stamps that both have. One message, at the end.
    """

    sync = lf.Exact()

    def start(self) -> None:
        self.state = difference.new_state()
        self.last: int | None = None
        difference.accumulate(np.empty(0), np.empty(0), self.state)  # compiles

    def step_block(self, estimate: lf.GravityCorrection, reference: lf.GravityCorrection) -> None:
        if len(estimate):
            self.last = int(estimate.t[-1])
        difference.accumulate(estimate.correction, reference.correction, self.state)

    def finish(self) -> lf.GravityScore | None:
        if self.last is None:
            return None
        return lf.GravityScore(self.last, *difference.figures(self.state))
