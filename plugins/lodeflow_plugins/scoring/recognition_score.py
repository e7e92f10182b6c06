"""Scores of the stages that recognise interference, as nodes."""

from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field

import lodeflow as lf
from lodeflow_plugins.interference import fuzzy_c_means, stages
from lodeflow_plugins.interference.fcm_stage import FcmLearning
from lodeflow_plugins.scoring import recognition

GOOD = Annotated[float, lf.Radian]


class _Collecting(lf.Node):
    """Keeps columns until the end, when they are scored together."""

    def start(self) -> None:
        self.last: int | None = None
        self.kept: list[tuple[Any, ...]] = []

    def keep(self, t: np.ndarray, *columns: np.ndarray) -> None:
        """Keep columns (N, ...) of a block."""
        if len(t):
            self.last = int(t[-1])
            self.kept.append(columns)

    def columns(self) -> list[np.ndarray]:
        """Whole columns of what was kept."""
        return [np.concatenate(parts) for parts in zip(*self.kept, strict=True)]

    def message(self, scores: recognition.Scores) -> lf.RecognitionScore:
        """The score at the end."""
        return lf.RecognitionScore(
            self.last,
            scores.recognised,
            scores.mistaken,
            scores.kept,
            scores.error_max,
            scores.error_p99,
            scores.accepted,
            scores.good,
            scores.samples,
        )


class ScoreRecognition(_Collecting):
    """RP, MP and WP of a stage: which compass samples it accepts, and how good they are.

    `candidates` is what the stage before it accepts; without it, all samples are.

    Source: Hao, Yang and Huang, note under Table 1.
    """

    sync = lf.Exact()

    class Params(lf.Params):
        """What is good, and of which compass."""

        good: GOOD = Field(float(np.radians(5.0)), gt=0)
        """Heading error below which a sample is good."""
        compass: Literal["both", "first", "second"] = "both"
        """Whose heading is scored; of both it is that in the middle."""

    def step_block(
        self,
        features: lf.CompassFeatures,
        accepted: lf.Credibility,
        truth: lf.Heading,
        candidates: lf.Credibility | None = None,
    ) -> None:
        heading = {
            "both": features.heading,
            "first": features.headings[:, 0],
            "second": features.headings[:, 1],
        }[self.params.compass]
        error = recognition.heading_error(heading, truth.heading)
        before = np.ones(len(error), np.int64) if candidates is None else candidates.valid
        self.keep(features.t, error, accepted.valid > 0, before > 0)

    def finish(self) -> lf.RecognitionScore | None:
        if self.last is None:
            return None
        return self.message(recognition.score(*self.columns(), self.params.good))


class ScoreFcm(_Collecting):
    """RP, MP and WP of fuzzy clusters that are learned from the data that they are scored on.

    The experiment of Tables 3 and 4: with all rows, the clusters of a sample classify the sample
    itself; with `learn`, those of its first rows classify the others. Not a stage, as it has to
    have seen all before it says anything; `fcm_stage` is.

    Source: Hao, Yang and Huang, section 4.2.
    """

    sync = lf.Exact()

    class Params(FcmLearning):
        """How clusters are learned, and what is good."""

        credible: float = Field(0.8, ge=0, le=1)
        """Credibility above which a sample is accepted."""
        learn: int | None = Field(None, ge=1)
        """Rows at the beginning to learn from; the others are scored. null: learn from all, and
        score all."""
        good: GOOD = Field(float(np.radians(5.0)), gt=0)
        """Heading error below which a sample is good."""

    def start(self) -> None:
        super().start()
        p = self.params
        points = np.random.default_rng(0).random((2 * p.clusters, 2))
        centres = fuzzy_c_means.fit(points, p.clusters, fuzzifier=p.fuzzifier).centres  # compiles
        none, nothing = np.empty((0, 2)), np.empty(0)
        used = np.empty(0, np.int64)
        stages.credibility(none, nothing, used, p.scales, centres, centres, p.fuzzifier)

    def step_block(
        self, features: lf.CompassFeatures, candidates: lf.Credibility, truth: lf.Heading
    ) -> None:
        error = recognition.heading_error(features.heading, truth.heading)
        self.keep(
            features.t,
            error,
            candidates.valid,
            features.field_error,
            features.heading_difference,
        )

    def finish(self) -> lf.RecognitionScore | None:
        if self.last is None:
            return None
        p = self.params
        error, candidates, field_error, difference = self.columns()
        learn = slice(0, p.learn)
        scored = slice(p.learn or 0, None)
        used = candidates[learn] > 0
        centres = []
        for compass in range(2):
            points = np.column_stack([
                np.abs(field_error[learn, compass][used]) / p.scales[0],
                np.abs(difference[learn][used]) / p.scales[1],
            ])  # fmt: skip
            fitted = fuzzy_c_means.fit(
                points, p.clusters, fuzzifier=p.fuzzifier, tolerance=p.tolerance, seed=p.seed
            )
            centres.append(fitted.centres)
        found = stages.credibility(
            field_error[scored], difference[scored], candidates[scored], p.scales, *centres,
            p.fuzzifier,
        )  # fmt: skip
        return self.message(
            recognition.score(error[scored], found > p.credible, candidates[scored] > 0, p.good)
        )
