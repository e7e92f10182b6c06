"""The first stage of recognition as a node."""

from typing import Annotated, Literal

import numpy as np
from pydantic import Field

import lodeflow as lf


class ThresholdStage(lf.Node):
    """Accept a sample while field errors, heading difference and their rates are small.

    All that is tested has to be below its limit, for both compasses, or for one of them alone.
    Credibility is 1 or 0. The defaults are the paper's loose set, 200 and 100 LSB of 1168, 8
    degrees and 8 degrees a sample, with a sample a second.

    Source: Hao, Yang and Huang, section 3, Tables 1 and 2.
    """

    class Params(lf.Params):
        """The limits; null for a feature that is not tested."""

        field_error: float | None = Field(200 / 1168, gt=0)
        """Largest field error, in units of the horizontal field."""
        field_error_rate: Annotated[float | None, lf.PerSecond] = Field(100 / 1168, gt=0)
        """Largest rate of the field error."""
        heading_difference: Annotated[float | None, lf.Radian] = Field(float(np.radians(8)), gt=0)
        """Largest heading difference."""
        heading_difference_rate: Annotated[float | None, lf.RadPerSecond] = Field(
            float(np.radians(8)), gt=0
        )
        """Largest rate of the heading difference."""
        compasses: Literal["both", "first", "second"] = "both"
        """Whose field errors are tested."""

    def start(self) -> None:
        p = self.params
        limits = (
            p.field_error,
            p.field_error_rate,
            p.heading_difference,
            p.heading_difference_rate,
        )
        self.limits = [np.inf if limit is None else limit for limit in limits]
        self.of = {"both": slice(0, 2), "first": slice(0, 1), "second": slice(1, 2)}[p.compasses]

    def _accepted(self, features: lf.CompassFeatures) -> np.ndarray:
        field, field_rate, difference, difference_rate = self.limits
        return (
            (np.abs(features.field_error[..., self.of]) < field).all(axis=-1)
            & (np.abs(features.field_error_rate[..., self.of]) < field_rate).all(axis=-1)
            & (np.abs(features.heading_difference) < difference)
            & (np.abs(features.heading_difference_rate) < difference_rate)
        )

    def step(self, features: lf.CompassFeatures) -> lf.Credibility:
        accepted = bool(self._accepted(features))
        return lf.Credibility(features.t, float(accepted), int(accepted))

    def step_block(self, features: lf.CompassFeatures) -> lf.Credibility:
        accepted = self._accepted(features)
        return lf.Credibility(features.t, accepted.astype(float), accepted.astype(np.int64))
