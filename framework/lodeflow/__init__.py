"""lodeflow: plugin-based dataflow for heading and orientation sensing. Plugins import this door.

import lodeflow as lf

class Doubler(lf.Node):
    def step(self, rate: lf.AngularRate) -> lf.AngularRate:
        return rate.replace(angular_rate=2 * rate.angular_rate)
"""

from lodeflow.algebra import rotate
from lodeflow.clock import Clock, seconds
from lodeflow.errors import (
    ContractError,
    GraphError,
    LodeflowError,
    MessageError,
    NodeError,
    NodeFailure,
    RecordingError,
    RunError,
    did_you_mean,
)
from lodeflow.messages.cdr import StreamConstants
from lodeflow.messages.fields import (
    GAPS,
    Array,
    Int64,
    Matrix3,
    Quaternion,
    Scalar,
    UInt8,
    UInt32,
    Vector3,
)
from lodeflow.messages.message import Message
from lodeflow.messages.units import (
    STANDARD_GRAVITY,
    Dimensionless,
    Hertz,
    Lsb,
    LsbPerTesla,
    Meter,
    MeterPerSecondSquared,
    PerSecond,
    Radian,
    RadPerSecond,
    Second,
    Share,
    Tesla,
    Unit,
)
from lodeflow.messages.vocabulary import (
    AngularRate,
    Attitude,
    AttitudeScore,
    AttitudeTruth,
    CompassFeatures,
    Credibility,
    EulerAngles,
    Heading,
    HeadingScore,
    HeadingStatus,
    Imu,
    MagneticField,
    Mode,
    RawField,
    RawForce,
    RawRate,
    RecognitionScore,
    Score,
    SpecificForce,
)
from lodeflow.node import Node, Source
from lodeflow.params import Mat3, Params, Vec3
from lodeflow.registry import hookimpl
from lodeflow.sync import Bound, Each, Exact, Hold, Nearest, Sparse

__version__ = "0.1.0"

__all__ = [
    "GAPS",
    "STANDARD_GRAVITY",
    "AngularRate",
    "Array",
    "Attitude",
    "AttitudeScore",
    "AttitudeTruth",
    "Bound",
    "Clock",
    "CompassFeatures",
    "ContractError",
    "Credibility",
    "Dimensionless",
    "Each",
    "EulerAngles",
    "Exact",
    "GraphError",
    "Heading",
    "HeadingScore",
    "HeadingStatus",
    "Hertz",
    "Hold",
    "Imu",
    "Int64",
    "LodeflowError",
    "Lsb",
    "LsbPerTesla",
    "MagneticField",
    "Mat3",
    "Matrix3",
    "Message",
    "MessageError",
    "Meter",
    "MeterPerSecondSquared",
    "Mode",
    "Nearest",
    "Node",
    "NodeError",
    "NodeFailure",
    "Params",
    "PerSecond",
    "Quaternion",
    "RadPerSecond",
    "Radian",
    "RawField",
    "RawForce",
    "RawRate",
    "RecognitionScore",
    "RecordingError",
    "RunError",
    "Scalar",
    "Score",
    "Second",
    "Share",
    "Source",
    "Sparse",
    "SpecificForce",
    "StreamConstants",
    "Tesla",
    "UInt8",
    "UInt32",
    "Unit",
    "Vec3",
    "Vector3",
    "did_you_mean",
    "hookimpl",
    "rotate",
    "seconds",
]
