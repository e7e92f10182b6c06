"""The difference of two streams of corrections as a node."""

import math

import lodeflow as lf


class ScoreGravity(lf.Node):
    """Mean, standard deviation and maximum of the difference of two streams of corrections.

    Over the stamps that both have. One message, at the end.
    """

    sync = lf.Exact()

    def start(self) -> None:
        self.samples = 0
        self.mean = 0.0
        self.spread = 0.0
        self.square = 0.0
        self.maximum = 0.0
        self.last: int | None = None

    def step(self, estimate: lf.GravityCorrection, reference: lf.GravityCorrection) -> None:
        difference = estimate.correction - reference.correction
        self.samples += 1
        before = difference - self.mean  # Welford's update
        self.mean += before / self.samples
        self.spread += before * (difference - self.mean)
        self.square += difference * difference
        self.maximum = max(self.maximum, abs(difference))
        self.last = estimate.t

    def finish(self) -> lf.GravityScore | None:
        if self.last is None:
            return None
        return lf.GravityScore(
            self.last,
            self.mean,
            math.sqrt(self.spread / self.samples),
            math.sqrt(self.square / self.samples),
            self.maximum,
            self.samples,
        )
