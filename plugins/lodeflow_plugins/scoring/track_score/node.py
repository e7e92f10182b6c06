"""The score of a track as a node."""

import math

import numpy as np

import lodeflow as lf
from lodeflow_plugins.scoring.track_score import alignment


class ScoreTrack(lf.Node):
    """Distance of a track from the true one, in m and as a share of the way.

    One message, at the end. Both are compared at the stamps of the track. They are put on each
    other at their start, and the track is turned by the one angle that fits it best, because its
    heading has no north of the truth's; nothing is scaled.
    """

    sync = lf.Exact()

    def start(self) -> None:
        self.last: int | None = None
        self.track = [np.empty((0, 3))]
        self.truth = [np.empty((0, 3))]

    def step_block(self, track: lf.Position, truth: lf.PositionTruth) -> None:
        if len(track):
            self.last = int(track.t[-1])
            self.track.append(track.position.copy())
            self.truth.append(truth.position.copy())

    def finish(self) -> lf.TrackScore | None:
        if self.last is None:
            return None
        found = alignment.score(np.concatenate(self.track), np.concatenate(self.truth))
        way = found.distance if found.distance > 0.0 else math.nan
        return lf.TrackScore(
            self.last,
            found.final,
            found.rms,
            found.maximum,
            found.distance,
            found.length,
            found.final / way,
            found.rms / way,
            found.samples,
        )
