"""The bundled message types.

Frames, unless a type says otherwise (REP 103): body is x forward, y left, z up; earth is x
magnetic east, y magnetic north, z up. A quaternion rotates body vectors into the earth frame,
v_earth = q v q*. Heading counts clockwise from magnetic north to the body's x axis.
"""

# Annotations are no texts here: each would have to be compiled, at every start.

from typing import Annotated, ClassVar, Literal

from lodeflow.messages.fields import (
    GAPS,
    Array,
    Int64,
    Matrix3,
    Quaternion,
    Scalar,
    UInt8,
    Vector3,
)
from lodeflow.messages.message import Message
from lodeflow.messages.units import (
    AngleVariance,
    Dimensionless,
    Gravity,
    Lsb,
    Meter,
    MeterPerSecond,
    MeterPerSecondSquared,
    PerSecond,
    Radian,
    RadPerSecond,
    RateVariance,
    Ratio,
    Second,
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


class Acceleration(Message, ros="lodeflow_msgs/msg/Acceleration", frame="earth"):
    """Acceleration of the body against the earth, along the axes of the earth frame."""

    acceleration: Vector3[MeterPerSecondSquared]


class Position(Message, ros="lodeflow_msgs/msg/Position", frame="earth"):
    """Position of the body in the earth frame, against a point of its own."""

    position: Vector3[Meter]


class PositionTruth(Message, ros="lodeflow_msgs/msg/PositionTruth", frame="earth"):
    """Reference position; NaN where the reference lost it or does not measure a component."""

    position: Annotated[Vector3[Meter], GAPS]


class Step(Message, ros="lodeflow_msgs/msg/Step", frame="body"):
    """A step was counted. The stamp says when this was known.

    `count` is the number of steps so far, `moment` the event time in ns at which the step was
    made: when the foot came to rest, or the height of its swing, as the counter says.
    """

    count: Int64
    moment: Int64


class StepTruth(Message, ros="lodeflow_msgs/msg/StepTruth", frame="body"):
    """Reference: how many steps were made up to the stamp."""

    count: Int64


class GeodeticMotion(Message, ros="lodeflow_msgs/msg/GeodeticMotion", frame="earth"):
    """Place on the WGS84 ellipsoid, and velocity east, north, up; north is true north."""

    latitude: Scalar[Radian]
    longitude: Scalar[Radian]
    height: Scalar[Meter]
    velocity: Vector3[MeterPerSecond]


class GravityCorrection(Message, ros="lodeflow_msgs/msg/GravityCorrection"):
    """A correction to be added to the reading of a gravimeter."""

    correction: Scalar[Gravity]


class Deflection(Message, ros="lodeflow_msgs/msg/Deflection", frame="earth"):
    """Deflection of the vertical: its components xi to the north and eta to the east."""

    north: Scalar[Radian]
    east: Scalar[Radian]


class GyroBias(Message, ros="lodeflow_msgs/msg/GyroBias", frame="body"):
    """Estimated bias of the gyroscope: angular rate measured where there is none."""

    bias: Vector3[RadPerSecond]
    covariance: Matrix3[RateVariance]


class Rest(Message, ros="lodeflow_msgs/msg/Rest", frame="body"):
    """Whether the body is at rest, from each message on until the next."""

    MOVING: ClassVar = 0
    RESTING: ClassVar = 1

    rest: UInt8


class HeadingState(Message, ros="lodeflow_msgs/msg/HeadingState", frame="earth"):
    """What a heading filter believes of its heading and of the magnetic field around it."""

    variance: Scalar[AngleVariance]
    """Of the heading; pi^2 / 3 where nothing is known."""
    disturbance: Vector3[Tesla]
    """Of the field, to the east, north and up."""
    level: Scalar[Dimensionless]
    """Mean square of the disturbance relative to the usual one; the heading coasts above one."""
    magnetometer_lag: Scalar[Second]
    """By how much the magnetometer is behind the attitude."""
    hard_iron: Vector3[Tesla]
    """Field of a magnet on the body, in the body frame."""
    horizontal: Scalar[Tesla]
    """The undisturbed field to the north."""
    vertical: Scalar[Tesla]
    """The undisturbed field upwards."""


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


class StepScore(Score, ros="lodeflow_msgs/msg/StepScore"):
    """Counted steps against the true ones.

    `error` is the difference of the two counts, without sign. `missed` and `extra` look at each
    true step by itself: steps without a counted one, and counted ones too many.
    """

    counted: Int64
    true: Int64
    error: Int64
    missed: Int64
    extra: Int64


class TrackScore(Score, ros="lodeflow_msgs/msg/TrackScore"):
    """Distance of a track from the true one, after the two were laid on each other.

    `final`, `rms` and `maximum` are horizontal distances; the shares are of the way that was
    covered, `distance`. `length` is the length of the track itself.
    """

    final: Annotated[Scalar[Meter], GAPS]
    rms: Annotated[Scalar[Meter], GAPS]
    maximum: Annotated[Scalar[Meter], GAPS]
    distance: Annotated[Scalar[Meter], GAPS]
    length: Annotated[Scalar[Meter], GAPS]
    final_share: Annotated[Scalar[Ratio], GAPS]
    rms_share: Annotated[Scalar[Ratio], GAPS]
    samples: Int64


class GravityScore(Score, ros="lodeflow_msgs/msg/GravityScore"):
    """Difference of two streams of corrections over the samples that both have."""

    mean: Annotated[Scalar[Gravity], GAPS]
    std: Annotated[Scalar[Gravity], GAPS]
    rms: Annotated[Scalar[Gravity], GAPS]
    maximum: Annotated[Scalar[Gravity], GAPS]
    samples: Int64


class TiltErrorScore(Score, ros="lodeflow_msgs/msg/TiltErrorScore"):
    """Errors of a tilt correction, by where they come from.

    `observations` from those of force and acceleration, `gravity` from that of g, `total` from
    both; `angle` is the error of each tilt angle, and `by_angle` what it does to the correction.
    """

    observations: Scalar[Gravity]
    gravity: Scalar[Gravity]
    total: Scalar[Gravity]
    angle: Scalar[Radian]
    by_angle: Scalar[Gravity]


class RecognitionScore(Score, ros="lodeflow_msgs/msg/RecognitionScore"):
    """How well a stage tells good compass samples from bad ones.

    recognised: share of the good samples that it accepts (RP); mistaken: share of bad samples
    among those that it accepts (MP); kept: share of the good samples accepted by the stage before
    it that it accepts as well; error_max and error_p99: of the accepted samples (WP).
    """

    recognised: Annotated[Scalar[Ratio], GAPS]
    mistaken: Annotated[Scalar[Ratio], GAPS]
    kept: Annotated[Scalar[Ratio], GAPS]
    error_max: Annotated[Scalar[Radian], GAPS]
    error_p99: Annotated[Scalar[Radian], GAPS]
    accepted: Scalar[Ratio]
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
    valid: Annotated[Scalar[Ratio], GAPS]
    valid_max: Annotated[Scalar[Radian], GAPS]
    samples: Int64
    missing: Int64
