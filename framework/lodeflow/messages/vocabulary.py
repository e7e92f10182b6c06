"""The bundled message types.

Frames, unless a type says otherwise (REP 103): body is x forward, y left, z up; earth is x
magnetic east, y magnetic north, z up. A quaternion rotates body vectors into the earth frame,
v_earth = q v q*. Heading counts clockwise from magnetic north to the body's x axis.
"""

from __future__ import annotations

from typing import Annotated, ClassVar, Literal

from lodeflow.messages.fields import (
    GAPS,
    Array,
    Int64,
    Quaternion,
    Scalar,
    UInt8,
    Vector3,
)
from lodeflow.messages.message import Message
from lodeflow.messages.units import (
    Dimensionless,
    Lsb,
    MeterPerSecondSquared,
    PerSecond,
    Radian,
    RadPerSecond,
    Share,
    Tesla,
)


class Imu(Message, ros="sensor_msgs/msg/Imu", frame="body"):
    """Inertial measurement in the body frame; linear_acceleration is specific force."""

    ros_defaults: ClassVar = {
        # REP 145: a first covariance of -1 says that there is no orientation estimate.
        "orientation_covariance": (-1.0, *[0.0] * 8),
        "orientation.w": 1.0,
    }

    angular_velocity: Vector3[RadPerSecond]
    linear_acceleration: Vector3[MeterPerSecondSquared]


class MagneticField(Message, ros="sensor_msgs/msg/MagneticField", frame="body"):
    """Magnetic flux density in the body frame."""

    magnetic_field: Vector3[Tesla]


class Attitude(Message, ros="geometry_msgs/msg/QuaternionStamped", frame="earth"):
    """Attitude of the body in the earth frame; the sign of the quaternion carries no meaning."""

    quaternion: Quaternion


class AttitudeTruth(Message, ros="lodeflow_msgs/msg/AttitudeTruth", frame="earth"):
    """Reference attitude; NaN where the reference lost it. Scored where moving is 1."""

    quaternion: Annotated[Quaternion, GAPS]
    moving: UInt8


class EulerAngles(Message, ros="lodeflow_msgs/msg/EulerAngles", frame="earth"):
    """Heading clockwise from magnetic north, pitch nose up, roll right side down."""

    heading: Scalar[Radian]
    pitch: Scalar[Radian]
    roll: Scalar[Radian]


class Heading(Message, ros="lodeflow_msgs/msg/Heading", frame="earth"):
    """Heading clockwise from magnetic north, from 0 up to 2 pi."""

    heading: Scalar[Radian]


class SpecificForce(Message, ros="lodeflow_msgs/msg/SpecificForce", frame="body"):
    """Specific force in the body frame: what an accelerometer measures, +9.8 upward at rest."""

    specific_force: Vector3[MeterPerSecondSquared]


class AngularRate(Message, ros="lodeflow_msgs/msg/AngularRate", frame="body"):
    """Angular rate of the body against inertial space, in the body frame."""

    angular_rate: Vector3[RadPerSecond]


class RawField(Message, ros="lodeflow_msgs/msg/RawField", frame="magnetometer"):
    """Uncalibrated magnetometer output along its own axes."""

    counts: Vector3[Lsb]


class RawForce(Message, ros="lodeflow_msgs/msg/RawForce", frame="accelerometer"):
    """Uncalibrated accelerometer output along its own axes."""

    counts: Vector3[Lsb]


class RawRate(Message, ros="lodeflow_msgs/msg/RawRate", frame="gyroscope"):
    """Uncalibrated gyroscope output along its own axes."""

    counts: Vector3[Lsb]


class Mode(Message, ros="lodeflow_msgs/msg/Mode"):
    """Which sensor the heading follows."""

    NONE: ClassVar = 0
    COMPASS: ClassVar = 1
    GYRO: ClassVar = 2

    mode: UInt8


class CompassFeatures(Message, ros="lodeflow_msgs/msg/CompassFeatures", frame="body"):
    """What two calibrated compasses side by side say of the field that they are in.

    Fields and their errors are in units of the undisturbed horizontal field. A field error is
    the horizontal strength less 1; the heading difference is first less second, less what it is
    when nothing disturbs.
    """

    heading: Scalar[Radian]
    headings: Array[Radian, Literal[2]]
    heading_difference: Scalar[Radian]
    heading_difference_rate: Scalar[RadPerSecond]
    field_error: Array[Dimensionless, Literal[2]]
    field_error_rate: Array[PerSecond, Literal[2]]
    first_field: Vector3[Dimensionless]
    second_field: Vector3[Dimensionless]


class Credibility(Message, ros="lodeflow_msgs/msg/Credibility"):
    """How far a compass can be trusted, from 0 to 1, and whether that is enough."""

    credibility: Scalar[Dimensionless]
    valid: UInt8


class HeadingStatus(Message, ros="lodeflow_msgs/msg/HeadingStatus", frame="earth"):
    """How good a heading is.

    sigma: standard deviation of the heading; disturbance: strength of the magnetic disturbance,
    in units of the horizontal field; valid: the heading can be used; compass_agrees: the compass
    alone shows nearly this heading; undisturbed: nothing disturbs the compass.
    """

    sigma: Scalar[Radian]
    disturbance: Scalar[Dimensionless]
    valid: UInt8
    compass_agrees: UInt8
    undisturbed: UInt8


class Score(Message):
    """Base of all scores: a run shows them in its summary, a study collects them."""


class AttitudeScore(Score, ros="lodeflow_msgs/msg/AttitudeScore"):
    """Error of an estimated attitude against a reference, over the samples that are scored.

    `missing` of the `samples` have no estimate; one of them makes all errors NaN.
    """

    total_rmse: Annotated[Scalar[Radian], GAPS]
    heading_rmse: Annotated[Scalar[Radian], GAPS]
    inclination_rmse: Annotated[Scalar[Radian], GAPS]
    total_max: Annotated[Scalar[Radian], GAPS]
    heading_max: Annotated[Scalar[Radian], GAPS]
    inclination_max: Annotated[Scalar[Radian], GAPS]
    samples: Int64
    missing: Int64


class RecognitionScore(Score, ros="lodeflow_msgs/msg/RecognitionScore"):
    """How well a stage tells good compass samples from bad ones.

    recognised: share of the good samples that it accepts (RP); mistaken: share of bad samples
    among those that it accepts (MP); kept: share of the good samples accepted by the stage before
    it that it accepts as well; error_max and error_p99: of the accepted samples (WP).
    """

    recognised: Annotated[Scalar[Share], GAPS]
    mistaken: Annotated[Scalar[Share], GAPS]
    kept: Annotated[Scalar[Share], GAPS]
    error_max: Annotated[Scalar[Radian], GAPS]
    error_p99: Annotated[Scalar[Radian], GAPS]
    accepted: Scalar[Share]
    good: Int64
    samples: Int64


class HeadingScore(Score, ros="lodeflow_msgs/msg/HeadingScore"):
    """Error of a heading against the truth.

    valid: share of the samples that the estimator calls valid; valid_max: largest error among
    them; last: error at the end. One of the `samples` without heading makes all errors NaN.
    """

    rmse: Annotated[Scalar[Radian], GAPS]
    p99: Annotated[Scalar[Radian], GAPS]
    max: Annotated[Scalar[Radian], GAPS]
    last: Annotated[Scalar[Radian], GAPS]
    valid: Annotated[Scalar[Share], GAPS]
    valid_max: Annotated[Scalar[Radian], GAPS]
    samples: Int64
    missing: Int64
