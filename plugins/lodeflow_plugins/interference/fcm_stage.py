"""The second stage of recognition as a node."""

import itertools
from typing import Annotated, ClassVar

import numpy as np
from pydantic import Field, field_validator

import lodeflow as lf
from lodeflow_plugins.interference import stages

Centres = tuple[tuple[float, float], ...]
"""Of clusters: field error and heading difference, each as a share of its limit."""


class FcmParams(lf.Params):
    """Features and memberships; shared by what learns the clusters and what uses them."""

    field_error: float = Field(200 / 1168, gt=0)
    """V_m, the limit of the stage before, in units of the horizontal field."""
    heading_difference: Annotated[float, lf.Radian] = Field(float(np.radians(8)), gt=0)
    """V_h, the limit of the stage before."""
    fuzzifier: float = Field(2.0, gt=1, le=10)
    """m of the memberships; clusters learned with another one do not fit."""

    @property
    def scales(self) -> tuple[float, float]:
        """V_m and V_h."""
        return self.field_error, self.heading_difference


class FcmLearning(FcmParams):
    """How clusters are learned."""

    clusters: int = Field(5, ge=2)
    """How many."""
    tolerance: float = Field(0.01, gt=0)
    """Largest change of a membership at which the iteration stops."""
    seed: int = Field(0, ge=0)
    """Of the first memberships."""


class FcmStage(lf.Node):
    """How credible a compass is, by its memberships in fuzzy clusters that were learned before.

    A sample that the stage before refused has no credibility. Of the others, the features
    |dm| / V_m and |dh| / V_h of each compass belong to each cluster by a closed formula, without
    iteration; the credibility is the sum of the memberships in the two clusters nearest zero, and
    of the two compasses the lesser counts. Centres come in the order of their distance from zero,
    the farthest first.

    Source: Hao, Yang and Huang, section 4.2 and Table 4.
    """

    sync = lf.Exact()

    class Params(FcmParams):
        """The clusters, and how much is enough."""

        file: lf.CalibrationFile = None
        """What `lodeflow calibrate fcm` wrote; gives the centres and what they count in."""
        first_centres: Centres = Field(min_length=2)
        """Of the first compass."""
        second_centres: Centres = Field(min_length=2)
        """Of the second compass."""
        credible: float = Field(0.8, ge=0, le=1)
        """Credibility above which a sample is valid."""

        @field_validator("first_centres", "second_centres")
        @classmethod
        def _nearest_last(cls, centres: Centres) -> Centres:
            far = [np.hypot(*centre) for centre in centres]
            if any(a < b for a, b in itertools.pairwise(far)):
                raise ValueError("centres should be in the order of their distance from zero, the "
                                 "farthest first")  # fmt: skip
            return centres

    example: ClassVar = {
        "first_centres": [[0.77, 0.35], [0.33, 0.66], [0.42, 0.21], [0.1, 0.33], [0.07, 0.09]],
        "second_centres": [[0.77, 0.35], [0.33, 0.66], [0.42, 0.21], [0.1, 0.33], [0.07, 0.09]],
    }

    def start(self) -> None:
        p = self.params
        self.settings = (
            p.scales,
            np.array(p.first_centres, float),
            np.array(p.second_centres, float),
            p.fuzzifier,
        )
        none = np.empty((0, 2)), np.empty(0), np.empty(0, np.int64)
        stages.credibility(*none, *self.settings)  # compiles

    def step(self, features: lf.CompassFeatures, passed: lf.Credibility) -> lf.Credibility:
        return self.step_block(features.as_block(), passed.as_block()).row(0)

    def step_block(self, features: lf.CompassFeatures, passed: lf.Credibility) -> lf.Credibility:
        found = stages.credibility(
            features.field_error, features.heading_difference, passed.valid, *self.settings
        )
        return lf.Credibility(features.t, found, (found > self.params.credible).astype(np.int64))
