"""Kinds of message fields: the shape of one sample, its numpy form, and its ROS 2 form.

In an annotation a kind takes its unit: `Vector3[Tesla]`. To a type checker a field is an array;
in a sample, a scalar field is a Python float or int.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import (
    TYPE_CHECKING,
    Annotated,
    Any,
    ClassVar,
    Generic,
    TypeVar,
    get_args,
    get_origin,
)

import numpy as np

from lodeflow.errors import MessageError
from lodeflow.messages.units import Dimensionless, Unit

U = TypeVar("U", bound=Unit)
N = TypeVar("N")

if TYPE_CHECKING:
    _Array = np.ndarray[Any, np.dtype[Any]]

    class _Base(_Array): ...  # what a plugin author sees: arithmetic on arrays
else:

    class _Base: ...


class Kind(_Base):
    """Base of the field kinds."""

    item_shape: ClassVar[tuple[int, ...]] = ()
    integer: ClassVar[bool] = False
    ros: ClassVar[str] = "float64"


class Scalar(Kind, Generic[U]):
    """One float64."""


class Vector3(Kind, Generic[U]):
    """Three components along x, y, z; shape (3,)."""

    item_shape = (3,)
    ros = "geometry_msgs/Vector3"


class Quaternion(Kind):
    """Unit quaternion x, y, z, w (scalar last); shape (4,)."""

    item_shape = (4,)
    ros = "geometry_msgs/Quaternion"


class Matrix3(Kind, Generic[U]):
    """Row-major 3x3 matrix; shape (3, 3)."""

    item_shape = (3, 3)
    ros = "float64[9]"


class Array(Kind, Generic[U, N]):
    """Fixed capacity: `Array[Tesla, Literal[8]]` has shape (8,)."""


class Int64(Kind):
    """Signed integer, 64 bits."""

    integer = True
    ros = "int64"


class UInt32(Kind):
    """Unsigned integer, 32 bits on the wire; int64 in memory."""

    integer = True
    ros = "uint32"


class UInt8(Kind):
    """Unsigned integer, 8 bits on the wire; int64 in memory. For codes with named constants."""

    integer = True
    ros = "uint8"


INTEGER_RANGES: dict[str, tuple[int, int]] = {
    "int64": (-(2**63), 2**63 - 1),
    "uint32": (0, 2**32 - 1),
    "uint8": (0, 255),
}


@dataclass(frozen=True)
class _Gaps:
    """Marks a field that may hold NaN: `Annotated[Quaternion, GAPS]`."""


GAPS = _Gaps()


@dataclass(frozen=True)
class FieldSpec:
    """One declared field, resolved.

    Attributes:
        name: attribute of the message.
        shape: shape of one sample, () for a scalar.
        integer: int64 in memory if true, else float64.
        ros: type in the ROS 2 message definition.
        unit: SI unit of every component.
        gaps: NaN is a value ("unknown") and not an error.
    """

    name: str
    shape: tuple[int, ...]
    integer: bool
    ros: str
    unit: type[Unit]
    gaps: bool

    @property
    def dtype(self) -> np.dtype[Any]:
        """Memory type of a block's column."""
        return np.dtype(np.int64 if self.integer else np.float64)

    @property
    def size(self) -> int:
        """Number of components of one sample."""
        return int(np.prod(self.shape, dtype=int))


def resolve(owner: str, name: str, annotation: Any) -> FieldSpec:
    """Return the field that `annotation` declares.

    Raises:
        MessageError: the annotation is not a field kind.
    """
    gaps = False
    if get_origin(annotation) is Annotated:
        annotation, *marks = get_args(annotation)
        gaps = GAPS in marks
    kind = get_origin(annotation) or annotation
    if not (isinstance(kind, type) and issubclass(kind, Kind) and kind is not Kind):
        raise MessageError(
            f"{owner}.{name}: {annotation!r} is not a field kind; "
            "use Scalar, Vector3, Quaternion, Matrix3, Array, Int64, UInt32 or UInt8"
        )
    arguments = get_args(annotation)
    unit: type[Unit] = Dimensionless
    shape, ros = kind.item_shape, kind.ros
    if kind is Array:
        capacity = get_args(arguments[1]) if len(arguments) == 2 else ()
        if len(capacity) != 1 or type(capacity[0]) is not int or capacity[0] < 1:
            raise MessageError(f"{owner}.{name}: write Array[UNIT, Literal[CAPACITY]]")
        shape, ros = capacity, f"float64[{capacity[0]}]"
    if arguments:
        unit = arguments[0]
        if not _is_unit(unit):
            raise MessageError(f"{owner}.{name}: {unit!r} is not a unit; use for example Tesla")
    if gaps and kind.integer:
        raise MessageError(f"{owner}.{name}: an integer has no NaN, so it cannot have GAPS")
    return FieldSpec(name, shape, kind.integer, ros, unit, gaps)


def _is_unit(found: Any) -> bool:
    return isinstance(found, type) and issubclass(found, Unit)
