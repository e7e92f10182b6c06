"""What the worlds with two compasses share: static iron, units and axes."""

from typing import Annotated

import numpy as np
from pydantic import Field

import lodeflow as lf
from lodeflow_plugins.calibration.ellipse import Ellipse

FLU = np.array([1.0, -1.0, -1.0])
"""Signs from forward, right, down to forward, left, up."""


class Iron(lf.Params):
    """The ellipse that a compass draws instead of the circle, in units of the circle's radius."""

    centre: tuple[float, float] = (0.0, 0.0)
    """Hard iron, forward and left."""
    radii: tuple[Annotated[float, Field(gt=0)], Annotated[float, Field(gt=0)]] = (1.0, 1.0)
    """Of the ellipse."""
    angle: Annotated[float, lf.Radian] = 0.0
    """From forward to the axis of the first radius, counter-clockwise from above."""


def as_field(fields: np.ndarray, iron: Iron, strength: float) -> np.ndarray:
    """Fields (N, 3) of a calibrated compass as one with this iron reads them, tesla, FLU.

    fields: forward, right, down, in units of the horizontal field, whose strength is in tesla.
    """
    flu = fields * FLU
    soft = Ellipse(iron.centre, iron.radii, iron.angle).from_circle()
    level = flu[:, :2]
    flu[:, 0], flu[:, 1] = (
        iron.centre[0] + soft[0, 0] * level[:, 0] + soft[0, 1] * level[:, 1],
        iron.centre[1] + soft[1, 0] * level[:, 0] + soft[1, 1] * level[:, 1],
    )
    return strength * flu
