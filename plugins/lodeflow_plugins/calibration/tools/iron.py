"""`lodeflow calibrate iron`: hard and soft iron of a magnetometer that reads in tesla."""

from __future__ import annotations

from typing import Annotated

import numpy as np
from pydantic import Field

import lodeflow as lf
from lodeflow_plugins.calibration.tools import figures, sphere
from lodeflow_plugins.calibration.tools.mag import strength_note


class Iron(lf.CalibrationTool):
    """Hard and soft iron around a magnetometer that reads in tesla, for iron_calibrator.

    An ellipsoid through the readings. Turn the vehicle with the sensor slowly about all axes, each
    pointing up and down once, far from other iron. With `imu`, the axes of the magnetometer are
    aligned to those of the accelerometer; without, a rotation common to all axes is not
    observable, and left out.
    """

    class Params(lf.Params):
        """What the data do not tell, and what to ask of them."""

        field: Annotated[float | None, lf.Tesla] = Field(None, gt=0)
        """Strength of the earth's field at the place; null keeps the mean sensitivity as it is."""
        tolerance: float = Field(0.03, gt=0)
        """Largest rms distance of the readings from the ellipsoid, part of the field."""

    def calibrate(self, mag: lf.MagneticField, imu: lf.Imu | None = None) -> lf.Calibration:
        p = self.params
        fitted = sphere.fit(mag.magnetic_field, p.tolerance)
        force = None if imu is None else (imu.t, imu.linear_acceleration)
        aligned = sphere.align(fitted, mag.t, mag.magnetic_field, force)
        radius = float(np.linalg.det(fitted.shape) ** (-1.0 / 3.0))
        field = radius if p.field is None else p.field
        soft_iron = field * aligned.matrix
        readings = sphere.thinned(mag.magnetic_field, fitted)
        after = (readings - fitted.centre) @ aligned.matrix.T
        return lf.Calibration(
            "iron_calibrator",
            {"soft_iron": soft_iron, "hard_iron": fitted.centre},
            [
                lf.Quantity("hard iron", 1e6 * fitted.centre, "uT", 1e6 * fitted.centre_error),
                lf.Quantity("soft iron", soft_iron),
                lf.Quantity("strength of the field", 1e6 * field, "uT"),
                *sphere.quantities(fitted, aligned, len(readings)),
            ],
            [strength_note(field), *aligned.notes],
            figures.spheres(readings / radius, after, "reading"),
        )
