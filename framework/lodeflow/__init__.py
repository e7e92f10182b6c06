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
    AngleRandomWalk,
    AngleVariance,
    Dimensionless,
    Hertz,
    Lsb,
    LsbPerTesla,
    Meter,
    MeterPerSecondSquared,
    Radian,
    RadPerSecond,
    RateVariance,
    Second,
    Tesla,
    TeslaNoiseDensity,
    TeslaRandomWalk,
    Unit,
)
from lodeflow.messages.vocabulary import (
    AngularRate,
    Attitude,
    AttitudeScore,
    AttitudeTruth,
    EulerAngles,
    GyroBias,
    Heading,
    HeadingState,
    Imu,
    MagneticField,
    Mode,
    RawField,
    RawForce,
    RawRate,
    Rest,
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
    "AngleRandomWalk",
    "AngleVariance",
    "AngularRate",
    "Array",
    "Attitude",
    "AttitudeScore",
    "AttitudeTruth",
    "Bound",
    "Clock",
    "ContractError",
    "Dimensionless",
    "Each",
    "EulerAngles",
    "Exact",
    "GraphError",
    "GyroBias",
    "Heading",
    "HeadingState",
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
    "Quaternion",
    "RadPerSecond",
    "Radian",
    "RateVariance",
    "RawField",
    "RawForce",
    "RawRate",
    "RecordingError",
    "Rest",
    "RunError",
    "Scalar",
    "Score",
    "Second",
    "Source",
    "Sparse",
    "SpecificForce",
    "Tesla",
    "TeslaNoiseDensity",
    "TeslaRandomWalk",
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
