"""The ellipse of a level compass as a node."""

from typing import Annotated, ClassVar

import numpy as np
from pydantic import Field

import lodeflow as lf
from lodeflow_plugins.calibration.ellipse import Ellipse


class EllipseCalibrator(lf.Node):
    """Make a circle of the ellipse that a level compass draws as it turns.

    The horizontal field (forward, left) is moved by the hard iron, the centre, and stretched by
    the soft iron; its strength becomes `field`. The vertical is passed on as it is.

    Source: Hao, Yang and Huang, section 2; the transformation is symmetric, as a turn of the
    whole circle does not show in the data.
    """

    class Params(lf.Params):
        """The ellipse, and the circle."""

        file: lf.CalibrationFile = None
        """What `lodeflow calibrate ellipse` wrote; gives all that is needed here."""
        centre: tuple[Annotated[float, lf.Tesla], Annotated[float, lf.Tesla]]
        """Hard iron, forward and left."""
        radii: tuple[
            Annotated[float, lf.Tesla, Field(gt=0)], Annotated[float, lf.Tesla, Field(gt=0)]
        ]
        """Of the ellipse, that at `angle` first."""
        angle: Annotated[float, lf.Radian] = 0.0
        """From forward to the first radius, counter-clockwise from above."""
        field: Annotated[float, lf.Tesla] = Field(33.5e-6, gt=0)
        """Strength of the undisturbed horizontal field."""

    example: ClassVar = {"centre": [2e-6, -1e-6], "radii": [35e-6, 32e-6], "angle": 0.3}

    def start(self) -> None:
        p = self.params
        self.matrix, self.offset = np.eye(3), np.array([*p.centre, 0.0])
        self.matrix[:2, :2] = Ellipse(p.centre, p.radii, p.angle).onto_circle(p.field)

    def step(self, mag: lf.MagneticField) -> lf.MagneticField:
        return lf.MagneticField(mag.t, lf.rotate(self.matrix, mag.magnetic_field - self.offset))

    step_block = step  # one expression serves a sample and a block, with the same bits
