"""The features of two differential magnetic compasses as a node."""

from typing import Annotated

import numpy as np
from pydantic import Field

import lodeflow as lf
from lodeflow_plugins.interference import features

CAPACITY = 4096
"""Samples that the longest interval may hold."""


class DmcFeatures(lf.Node):
    """Field errors and heading difference of two level compasses, and how fast they change.

    Inputs are the calibrated fields (FLU), whose horizontal part draws a circle when the body
    turns undisturbed. Rates are zero at the first sample, and after a gap.

    Source: Hao, Yang and Huang, section 2.
    """

    sync = lf.Exact()

    class Params(lf.Params):
        """The undisturbed field, and how rates are taken."""

        file: lf.CalibrationFile = None
        """What `lodeflow calibrate pair` wrote: the field, and the difference."""
        field: Annotated[float, lf.Tesla] = Field(33.5e-6, gt=0)
        """Strength of the undisturbed horizontal field, the radius of the circle."""
        initial_difference: Annotated[float, lf.Radian] = 0.0
        """Heading difference of the two compasses, first less second, where nothing disturbs."""
        rate_interval: Annotated[float, lf.Second] = Field(0.0, ge=0)
        """Time over which rates are taken; 0 for the sample before, as in the paper."""
        gap: Annotated[float, lf.Second] = Field(2.0, gt=0)
        """Pause after which a new series begins."""

    def start(self) -> None:
        p = self.params
        self.settings = (
            p.field,
            p.initial_difference,
            lf.seconds(p.rate_interval),
            lf.seconds(p.gap),
        )
        self.memory = features.memory(CAPACITY if p.rate_interval else 2)
        self.told = False
        self._features(np.empty(0, np.int64), np.empty((0, 3)), np.empty((0, 3)))  # compiles

    def _features(self, t: np.ndarray, first: np.ndarray, second: np.ndarray) -> list[np.ndarray]:
        out = [np.empty((len(t), 3)) for _ in range(3)]
        held = features.features(t, first, second, *self.settings, self.memory, *out)
        if not held and not self.told:
            self.told = True
            self.log.warning(
                "rates look back less than rate_interval: more than %d samples", CAPACITY
            )
        return out

    def step(self, first: lf.MagneticField, second: lf.MagneticField) -> lf.CompassFeatures:
        return self.step_block(first.as_block(), second.as_block()).row(0)

    def step_block(self, first: lf.MagneticField, second: lf.MagneticField) -> lf.CompassFeatures:
        one, other = first.magnetic_field, second.magnetic_field
        headings, values, rates = self._features(first.t, one, other)
        return lf.CompassFeatures(
            first.t,
            np.ascontiguousarray(headings[:, 2]),
            np.ascontiguousarray(headings[:, :2]),
            np.ascontiguousarray(values[:, 2]),
            np.ascontiguousarray(rates[:, 2]),
            np.ascontiguousarray(values[:, :2]),
            np.ascontiguousarray(rates[:, :2]),
            one / self.params.field,
            other / self.params.field,
        )
