"""Message types of the calibration family."""

import lodeflow as lf


class TeslaSquared(lf.Unit):
    """Covariance of a magnetic flux density."""

    symbol = "T²"


class HardIron(lf.Message, ros="lodeflow_msgs/msg/HardIron", frame="body"):
    """Estimated hard iron in the body frame, its covariance, and what of it is being removed."""

    bias: lf.Vector3[lf.Tesla]
    covariance: lf.Matrix3[TeslaSquared]
    applied: lf.Vector3[lf.Tesla]
