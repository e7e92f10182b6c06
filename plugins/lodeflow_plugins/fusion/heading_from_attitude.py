"""Heading of an attitude."""

import numpy as np

import lodeflow as lf
from lodeflow_plugins.fusion.tilt_compass import compass


class HeadingFromAttitude(lf.Node):
    """Heading of the body's x axis, clockwise from magnetic north, from 0 up to 2 pi.

    Attitude: magnetic ENU <- FLU. Where x points straight up or down, a heading means nothing.

    Source: Chu et al. 2017, Eq. 30.
    """

    def start(self) -> None:
        compass.euler(np.empty((0, 4)))  # compiles

    def step(self, attitude: lf.Attitude) -> lf.Heading:
        return lf.Heading(attitude.t, compass.euler(attitude.quaternion[None]).item(0))

    def step_block(self, attitude: lf.Attitude) -> lf.Heading:
        angles = compass.euler(attitude.quaternion)
        return lf.Heading(attitude.t, np.ascontiguousarray(angles[:, 0]))
