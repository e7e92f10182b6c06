"""The accelerations of a moving vehicle as nodes."""

import numpy as np

import lodeflow as lf
from lodeflow_plugins.gravimetry.earth import rotation


class Eotvos(lf.Node):
    """Eotvos correction: what the speed of the vehicle takes from the gravity that it senses.

    E = 2 w cos(latitude) v_E + v_E^2 / (N + h) + v_N^2 / (M + h), to be added to the reading.
    """

    def start(self) -> None:
        rotation.coriolis(np.empty(0), np.empty(0), np.empty((0, 3)))  # compiles

    def step_block(self, motion: lf.GeodeticMotion) -> lf.GravityCorrection:
        c = rotation.coriolis(motion.latitude, motion.height, motion.velocity)
        return lf.GravityCorrection(motion.t, -c[:, 2])


class HorizontalCoriolis(lf.Node):
    """Coriolis acceleration C of a moving vehicle, as its accelerometers sense it.

    East and north are what the tilt correction needs; the vertical component, the negative of the
    Eotvos correction, comes along.

    Source: derived for Liu et al. 2018; their Table 3 follows from it.
    """

    def start(self) -> None:
        rotation.coriolis(np.empty(0), np.empty(0), np.empty((0, 3)))  # compiles

    def step_block(self, motion: lf.GeodeticMotion) -> lf.Acceleration:
        return lf.Acceleration(
            motion.t, rotation.coriolis(motion.latitude, motion.height, motion.velocity)
        )


class DisturbingGravity(lf.Node):
    """Horizontal disturbing gravity from the deflection of the vertical: -gravity times it.

    The last deflection at or before each stamp of the motion serves; the vertical component is 0.
    """

    sync = lf.Hold("motion")

    def start(self) -> None:
        rotation.disturbance(np.empty(0), np.empty(0), np.empty(0))  # compiles

    def step_block(self, motion: lf.GeodeticMotion, deflection: lf.Deflection) -> lf.Acceleration:
        return lf.Acceleration(
            motion.t, rotation.disturbance(motion.latitude, deflection.north, deflection.east)
        )


class KinematicAcceleration(lf.Node):
    """Acceleration of a vehicle from its velocity, by central differences.

    The derivative at a stamp takes the samples before and after it, so there is none at the first
    and at the last stamp. It amplifies noise: filter it, and the specific force alike, before
    squares are taken (`tilt_correction` does).
    """

    lookback = lf.seconds(3600.0)  # one sample, however far away it is

    def start(self) -> None:
        self.t = np.empty(0, np.int64)
        self.velocity = np.empty((0, 3))

    def step_block(self, motion: lf.GeodeticMotion) -> lf.Acceleration:
        t = np.concatenate([self.t, motion.t])
        velocity = np.concatenate([self.velocity, motion.velocity])
        self.t, self.velocity = t[-2:].copy(), velocity[-2:].copy()
        if len(t) < 3:
            return lf.Acceleration.empty()
        span = (t[2:] - t[:-2]) * 1e-9
        return lf.Acceleration(t[1:-1].copy(), (velocity[2:] - velocity[:-2]) / span[:, None])
