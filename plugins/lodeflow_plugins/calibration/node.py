"""Nodes that turn raw counts into physical quantities in the body frame."""

from typing import Annotated, ClassVar, Literal

import numpy as np
from pydantic import Field, model_validator

import lodeflow as lf
from lodeflow_plugins.calibration import chu2017, error_models

BodyAxes = Literal["flu", "frd"]
SIGNS = {"flu": np.array([1.0, 1.0, 1.0]), "frd": np.array([1.0, -1.0, -1.0])}
"""What turns a vector in the named body axes into lodeflow's own, FLU."""


def into_body(model: error_models.Affine, unit: float, body_axes: BodyAxes) -> error_models.Affine:
    """The map from counts to `model`'s own unit and axes, extended to SI and FLU."""
    scale = unit * SIGNS[body_axes]
    return error_models.Affine(scale[:, None] * model.matrix, scale * model.offset)


class MagCalibrator(lf.Node):
    """Remove bias, sensitivity and misalignment of a three-axis magnetometer.

    raw = K M h + b, so h = M^-1 K^-1 (raw - b), with K the diagonal matrix of the sensitivities.
    The bias holds the sensor's own offset and the hard iron of the vehicle. Input along the
    sensor's axes, output in the body frame (FLU).

    Source: Chu et al. 2017, Eq. 7.
    """

    class Params(lf.Params):
        """K, M and b of Eq. 6."""

        file: lf.CalibrationFile = None
        """What `lodeflow calibrate mag` wrote; gives all that is needed here."""
        unit: Annotated[float, lf.Tesla] = Field(gt=0)
        """Flux density that `sensitivity` counts per: "50 uT" for an earth field; 1 for LSB/T."""
        sensitivity: lf.Vec3
        """K, LSB per `unit`, of each sensor axis."""
        bias: Annotated[lf.Vec3, lf.Lsb]
        """b, of each sensor axis."""
        misalignment: lf.Mat3 | None = None
        """M: each row is the unit vector of a sensor axis in the body. Or give `axis_angles`."""
        axis_angles: Annotated[lf.Mat3 | None, lf.Radian] = None
        """Angles of the sensor axes (rows) to the body's x, y, z (columns): M as its arc cosine."""
        body_axes: BodyAxes = "flu"
        """Body axes that the matrix is given in: x forward, y left, z up, or y right, z down."""

        @model_validator(mode="after")
        def _is_a_sensor(self) -> "MagCalibrator.Params":
            self.inverse()
            return self

        def inverse(self) -> error_models.Affine:
            """The map from counts to the field, in `unit` and `body_axes`.

            Raises ValueError when the constants are not those of a magnetometer.
            """
            if (self.misalignment is None) == (self.axis_angles is None):
                raise ValueError("give one of misalignment and axis_angles")
            rows = self.misalignment if self.axis_angles is None else np.cos(self.axis_angles)
            return error_models.magnetometer(self.sensitivity, rows, self.bias).inverse()

    example: ClassVar = {
        "unit": "50 uT",
        "sensitivity": chu2017.MAGNETOMETER_SENSITIVITY.tolist(),
        "bias": chu2017.MAGNETOMETER_BIAS.tolist(),
        "misalignment": chu2017.MAGNETOMETER_MISALIGNMENT.tolist(),
        "body_axes": "frd",
    }

    def start(self) -> None:
        self.field = into_body(self.params.inverse(), self.params.unit, self.params.body_axes)

    def step(self, raw: lf.RawField) -> lf.MagneticField:
        return lf.MagneticField(raw.t, self.field(raw.counts))

    step_block = step  # one expression serves a sample and a block, with the same bits


class AccelCalibrator(lf.Node):
    """Turn counts of a three-axis accelerometer into specific force.

    f = A raw + A0 with twelve coefficients: sensitivity, misalignment and offset in one. Input
    along the sensor's axes, output in the body frame (FLU), +9.8 m/s^2 on z when flat at rest.

    Source: Chu et al. 2017, Eq. 8 and Table 3, whose A^b is in FLU.
    """

    class Params(lf.Params):
        """A and A0 of Eq. 8."""

        file: lf.CalibrationFile = None
        """What `lodeflow calibrate accel` wrote; gives all that is needed here."""
        unit: Annotated[float, lf.MeterPerSecondSquared] = Field(gt=0)
        """Specific force that `gain` and `offset` count in: "1 g", or 1 for m/s^2."""
        gain: lf.Mat3
        """A, `unit` per LSB; rows are body axes, columns sensor axes."""
        offset: lf.Vec3
        """A0, `unit`, of each body axis."""
        body_axes: BodyAxes = "flu"
        """Body axes of the rows: x forward, y left, z up, or x forward, y right, z down."""

    example: ClassVar = {
        "unit": "1 g",
        "gain": chu2017.ACCELEROMETER_GAIN.tolist(),
        "offset": chu2017.ACCELEROMETER_OFFSET.tolist(),
    }

    def start(self) -> None:
        p = self.params
        model = error_models.accelerometer(p.gain, p.offset)
        self.force = into_body(model, p.unit, p.body_axes)

    def step(self, raw: lf.RawForce) -> lf.SpecificForce:
        return lf.SpecificForce(raw.t, self.force(raw.counts))

    step_block = step  # one expression serves a sample and a block, with the same bits


class GyroCalibrator(lf.Node):
    """Turn counts of a three-axis gyroscope into angular rate.

    w = K[:3]^T raw + K[3] with twelve coefficients, three rows of transposed gain and one of
    bias. Input along the sensor's axes, output in the body frame (FLU).

    Source: Chu et al. 2017, Eq. 12 (with a scale for each axis, where the print has that of x
    three times) and Eq. 17, whose w^b is in FRD.
    """

    class Params(lf.Params):
        """K of Eq. 14."""

        file: lf.CalibrationFile = None
        """What `lodeflow calibrate gyro` wrote; gives all that is needed here."""
        unit: Annotated[float, lf.RadPerSecond] = Field(gt=0)
        """Angular rate that `k` counts in: "1 deg/s", or 1 for rad/s."""
        k: tuple[lf.Vec3, lf.Vec3, lf.Vec3, lf.Vec3]
        """K: three rows of transposed gain, `unit` per LSB, and one of bias, `unit`."""
        body_axes: BodyAxes = "flu"
        """Body axes of the columns: x forward, y left, z up, or x forward, y right, z down."""
        zero_rate: Annotated[lf.Vec3 | None, lf.Lsb] = None
        """Output at rest, of each sensor axis; in the place of the bias in `k` if given."""

    example: ClassVar = {"unit": "1 deg/s", "k": chu2017.GYROSCOPE_K.tolist(), "body_axes": "frd"}

    def start(self) -> None:
        p = self.params
        model = error_models.gyroscope(p.k)
        if p.zero_rate is not None:
            model = error_models.Affine(model.matrix, -(model.matrix @ p.zero_rate))
        self.rate = into_body(model, p.unit, p.body_axes)

    def step(self, raw: lf.RawRate) -> lf.AngularRate:
        return lf.AngularRate(raw.t, self.rate(raw.counts))

    step_block = step  # one expression serves a sample and a block, with the same bits


class IronCalibrator(lf.Node):
    """Remove hard and soft iron from a magnetometer that reads in tesla.

    h = S (m - b), with the hard iron b and the soft iron's inverse S, which may also turn the
    magnetometer's axes into the body's.
    """

    class Params(lf.Params):
        """S and b."""

        file: lf.CalibrationFile = None
        """What `lodeflow calibrate iron` wrote; gives all that is needed here."""
        hard_iron: Annotated[lf.Vec3, lf.Tesla]
        """b, of each sensor axis."""
        soft_iron: lf.Mat3 = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
        """S: rows are body axes, columns sensor axes."""

    example: ClassVar = {
        "hard_iron": [2e-6, -1e-6, 4e-6],
        "soft_iron": [[1.02, 0.01, 0.0], [0.01, 0.98, -0.02], [0.0, -0.02, 1.01]],
    }

    def start(self) -> None:
        soft_iron = self.params.soft_iron
        self.field = error_models.Affine(soft_iron, -(soft_iron @ self.params.hard_iron))

    def step(self, mag: lf.MagneticField) -> lf.MagneticField:
        return lf.MagneticField(mag.t, self.field(mag.magnetic_field))

    step_block = step  # one expression serves a sample and a block, with the same bits


class ImuCombiner(lf.Node):
    """Put specific force and angular rate of equal stamps together, both in the body frame."""

    sync = lf.Exact()

    def step(self, force: lf.SpecificForce, rate: lf.AngularRate) -> lf.Imu:
        return lf.Imu(force.t, rate.angular_rate, force.specific_force)

    step_block = step
