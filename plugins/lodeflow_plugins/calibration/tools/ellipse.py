"""`lodeflow calibrate ellipse`: hard and soft iron of a level compass."""

from __future__ import annotations

from typing import Annotated

import numpy as np
from pydantic import Field

import lodeflow as lf
from lodeflow_plugins.calibration import ellipse
from lodeflow_plugins.calibration.tools import figures

RECORD = "turn the body once or more about the vertical, level, with nothing magnetic near"
ENOUGH = np.radians(270.0)
"""Turn that a compass has to cover, rad."""
MAX_CONDITION = 10.0
"""Of the scaled design: 1.7 for a whole turn."""


class EllipseFit(lf.CalibrationTool):
    """Hard and soft iron of a level compass, for ellipse_calibrator.

    Turn the body once or more about the vertical, level, with nothing magnetic near.

    Source: Hao, Yang and Huang, section 1, best-ellipse fit; Halir and Flusser 1998.
    """

    class Params(lf.Params):
        """What the data do not tell, and what to ask of them."""

        field: Annotated[float | None, lf.Tesla] = Field(None, gt=0)
        """Strength of the undisturbed horizontal field; null keeps the mean radius."""
        tolerance: float = Field(0.03, gt=0)
        """Largest rms distance of the readings from the ellipse, part of the field."""

    def calibrate(self, mag: lf.MagneticField) -> lf.Calibration:
        p = self.params
        points = mag.magnetic_field[:, :2]
        try:
            found = ellipse.fit(points)
        except ValueError as error:
            raise lf.CalibrationError(f"{error}; {RECORD}") from error
        if found.covered < ENOUGH:
            raise lf.CalibrationError(
                f"the body turned through {np.degrees(found.covered):.0f}°; 270° are needed: "
                f"{RECORD}"
            )
        if found.residual > p.tolerance or found.condition > MAX_CONDITION:
            raise lf.CalibrationError(
                f"the data contradict each other: the readings are {100 * found.residual:.2g} % "
                f"off the ellipse (at most {100 * p.tolerance:g} %), so the field was not the same "
                f"all the time, or the body was not level; {RECORD}"
            )
        shape = found.ellipse
        radius = float(np.sqrt(shape.radii[0] * shape.radii[1]))
        field = radius if p.field is None else p.field
        angle_error = np.degrees(found.angle_error)
        notes = ["a turn of the whole circle is not observable: `lodeflow calibrate pair` finds "
                 "that between two compasses, a known heading that of both"]  # fmt: skip
        if p.field is None:
            notes.append("the strength of the field is not observable: set field, or it stays the "
                         "mean radius")  # fmt: skip
        if not angle_error < 45.0:
            notes.append("it is a circle: the angle of the ellipse means nothing")
        after = (points - shape.centre) @ shape.onto_circle()
        return lf.Calibration(
            "ellipse_calibrator",
            {
                "centre": shape.centre,
                "radii": shape.radii,
                "angle": shape.angle,
                "field": field,
            },
            [
                lf.Quantity("centre", 1e6 * np.array(shape.centre), "uT", 1e6 * found.centre_error),
                lf.Quantity("radii", 1e6 * np.array(shape.radii), "uT", 1e6 * found.radii_error),
                lf.Quantity("angle", np.degrees(shape.angle), "°", min(angle_error, 90.0)),
                lf.Quantity("strength of the horizontal field", 1e6 * field, "uT"),
                lf.Quantity("residual rms", 100.0 * found.residual, "% of the field"),
                lf.Quantity("condition number", found.condition),
                lf.Quantity("turn covered", np.degrees(found.covered), "°"),
                lf.Quantity("readings", len(points)),
            ],
            notes,
            figures.circle(points / radius, after),
        )
