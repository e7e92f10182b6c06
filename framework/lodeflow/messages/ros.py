"""ROS 2 message definitions: generated for our own types, written down for the standard ones.

A definition is kept as parsed members, from which follow the `ros2msg` text with its
dependencies, and the flat list of primitives that the CDR layout is compiled from.
"""

from __future__ import annotations

import inspect
import re
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING

from lodeflow.errors import MessageError

if TYPE_CHECKING:
    from lodeflow.messages.message import Message

PRIMITIVES: dict[str, tuple[int, str]] = {  # size in bytes, struct format
    "bool": (1, "?"),
    "byte": (1, "B"),
    "char": (1, "B"),
    "int8": (1, "b"),
    "uint8": (1, "B"),
    "int16": (2, "h"),
    "uint16": (2, "H"),
    "int32": (4, "i"),
    "uint32": (4, "I"),
    "float32": (4, "f"),
    "int64": (8, "q"),
    "uint64": (8, "Q"),
    "float64": (8, "d"),
}

STANDARD: dict[str, str] = {
    "builtin_interfaces/msg/Time": "int32 sec\nuint32 nanosec\n",
    "std_msgs/msg/Header": "builtin_interfaces/Time stamp\nstring frame_id\n",
    "geometry_msgs/msg/Vector3": "float64 x\nfloat64 y\nfloat64 z\n",
    "geometry_msgs/msg/Quaternion": "float64 x\nfloat64 y\nfloat64 z\nfloat64 w\n",
    "geometry_msgs/msg/QuaternionStamped": (
        "std_msgs/Header header\ngeometry_msgs/Quaternion quaternion\n"
    ),
    "sensor_msgs/msg/Imu": (
        "std_msgs/Header header\n"
        "geometry_msgs/Quaternion orientation\n"
        "float64[9] orientation_covariance\n"
        "geometry_msgs/Vector3 angular_velocity\n"
        "float64[9] angular_velocity_covariance\n"
        "geometry_msgs/Vector3 linear_acceleration\n"
        "float64[9] linear_acceleration_covariance\n"
    ),
    "sensor_msgs/msg/MagneticField": (
        "std_msgs/Header header\n"
        "geometry_msgs/Vector3 magnetic_field\n"
        "float64[9] magnetic_field_covariance\n"
    ),
}

_MEMBER = re.compile(r"^(?P<type>[\w/]+)(\[(?P<count>\d+)\])?\s+(?P<name>[a-z]\w*)\s*$")
_CONSTANT = re.compile(r"^\w+\s+[A-Z]\w*\s*=")


@dataclass(frozen=True)
class Leaf:
    """One primitive member of a flattened message.

    Attributes:
        path: members from the top, joined by dots ("header.stamp.sec").
        type: primitive name, or "string".
        count: length of a fixed array, None for a single value.
    """

    path: str
    type: str
    count: int | None


def full_name(name: str) -> str:
    """Return "pkg/msg/Name" for "pkg/Name" or "pkg/msg/Name"."""
    package, _, last = name.replace("/msg/", "/").partition("/")
    return f"{package}/msg/{last}"


def definition(cls: type[Message]) -> str:
    """Return the definition of a message type, without its dependencies.

    Raises:
        MessageError: a standard type lacks a declared field, or has it in another shape.
    """
    if cls.ros in STANDARD:
        for field in cls.fields:
            if not re.search(rf"^{re.escape(field.ros)} {field.name}$", STANDARD[cls.ros], re.M):
                raise MessageError(
                    f"{cls.__name__}.{field.name}: {cls.ros} has no member "
                    f"'{field.ros} {field.name}'"
                )
        return STANDARD[cls.ros]
    lines = [f"# {line}".rstrip() for line in inspect.cleandoc(cls.__doc__ or "").splitlines()]
    lines += [f"uint8 {name}={value}" for name, value in cls.constants.items()]
    lines.append("std_msgs/Header header")
    for field in cls.fields:
        comment = f"  # {field.unit.symbol}" if field.unit.symbol else ""
        comment += ("; " if comment else "  # ") + "NaN: unknown" if field.gaps else ""
        lines.append(f"{field.ros} {field.name}{comment}")
    return "\n".join(lines) + "\n"


def members(text: str) -> Iterator[tuple[str, int | None, str]]:
    """Yield (type, count, name) of each member of a definition; constants are left out.

    Raises:
        MessageError: a member of variable size, which has no columnar form.
    """
    for line in text.splitlines():
        line = line.partition("#")[0].strip()
        if not line or _CONSTANT.match(line):
            continue
        found = _MEMBER.match(line)
        if found is None:
            raise MessageError(f"no fixed size: {line!r}")
        count = found["count"]
        yield found["type"], None if count is None else int(count), found["name"]


def leaves(text: str, prefix: str = "") -> Iterator[Leaf]:
    """Yield the primitives of a definition in wire order."""
    for kind, count, name in members(text):
        path = prefix + name
        if kind in PRIMITIVES or kind == "string":
            yield Leaf(path, kind, count)
        else:
            yield from leaves(STANDARD[full_name(kind)], f"{path}.")


@cache
def schema_text(cls: type[Message]) -> str:
    """Return the `ros2msg` text of a type: its definition and all that it depends on."""
    texts = {cls.ros: definition(cls)}
    pending = [cls.ros]
    while pending:
        for kind, _, _ in members(texts[pending.pop()]):
            if kind not in PRIMITIVES and kind != "string" and full_name(kind) not in texts:
                texts[full_name(kind)] = STANDARD[full_name(kind)]
                pending.append(full_name(kind))
    (_, top), *rest = texts.items()
    parts = [top]
    for name, text in rest:
        parts.append(f"MSG: {name.replace('/msg/', '/')}\n{text}")
    return ("=" * 80 + "\n").join(parts)
