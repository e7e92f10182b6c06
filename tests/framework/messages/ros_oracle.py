"""rosbags as the oracle of our CDR, and hypothesis strategies of messages of any type."""

from __future__ import annotations

from typing import Any

import numpy as np
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

import lodeflow  # declares the bundled types
from lodeflow.messages.cdr import FIRST_STAMP, LAST_STAMP, StreamConstants
from lodeflow.messages.fields import INTEGER_RANGES
from lodeflow.messages.message import Message, by_ros_name
from lodeflow.messages.ros import definition

BUNDLED = [kind for kind in by_ros_name.values() if kind.__module__.startswith("lodeflow.")]
STANDARD = [lodeflow.Imu, lodeflow.MagneticField, lodeflow.Attitude]

ORACLE = get_typestore(Stores.ROS2_HUMBLE)
for bundled in BUNDLED:
    if bundled not in STANDARD:  # of the standard types, rosbags has its own definitions
        ORACLE.register(get_types_from_msg(definition(bundled), bundled.ros))

MEMBERS = {"geometry_msgs/Vector3": "xyz", "geometry_msgs/Quaternion": "xyzw"}


def stamps() -> st.SearchStrategy[int]:
    edges = st.sampled_from([FIRST_STAMP, -1, 0, 999_999_999, 10**9, LAST_STAMP])
    return edges | st.integers(FIRST_STAMP, LAST_STAMP)


@st.composite
def blocks(draw: Any, kind: type[Message], min_size: int = 0, max_size: int = 5) -> Any:
    n = draw(st.integers(min_size, max_size))
    t = np.array(draw(st.lists(stamps(), min_size=n, max_size=n)), dtype=np.int64)
    columns = []
    for field in kind.fields:
        if field.integer:
            low, high = INTEGER_RANGES[field.ros]
            elements = st.sampled_from([low, high]) | st.integers(low, high)
        else:
            elements = st.floats(allow_nan=field.gaps, allow_infinity=True)
        columns.append(draw(hnp.arrays(field.dtype, (n, *field.shape), elements=elements)))
    return kind(t, *columns)


def samples(kind: type[Message]) -> st.SearchStrategy[Any]:
    return blocks(kind, 1, 1).map(lambda block: block.row(0))


@st.composite
def constants(draw: Any, kind: type[Message]) -> StreamConstants:
    values = []
    for path, default in StreamConstants.of(kind).values:
        if isinstance(default, tuple):
            size = len(default)
            values.append((path, tuple(draw(st.lists(finite(), min_size=size, max_size=size)))))
        else:
            values.append((path, draw(finite())))
    frame = draw(st.text(st.characters(exclude_categories=["Cs"]), max_size=12))
    return StreamConstants(frame, tuple(values))


def finite() -> st.SearchStrategy[float]:
    return st.floats(allow_nan=False)


def flat(message: Any, constants: StreamConstants) -> dict[str, Any]:
    """Return what a record of a sample must hold, by the path of each primitive."""
    found: dict[str, Any] = {
        "header.stamp.sec": message.t // 10**9,
        "header.stamp.nanosec": message.t % 10**9,
        "header.frame_id": constants.frame_id,
        **dict(constants.values),
    }
    for field, value in zip(message.fields, message.values(), strict=True):
        if field.gaps:
            value = np.where(np.isnan(value), np.nan, value)  # the one pattern of NaN
        if not field.shape:
            value = np.asarray(value).item()
        if field.ros in MEMBERS:
            names = MEMBERS[field.ros]
            parts = zip(names, value.tolist(), strict=True)
            found.update({f"{field.name}.{name}": part for name, part in parts})
        else:
            found[field.name] = tuple(value.ravel().tolist()) if field.shape else value
    return found


def encode(name: str, values: dict[str, Any]) -> bytes:
    """Return the record that rosbags makes of primitives."""
    return bytes(ORACLE.serialize_cdr(_build(name, values, ""), name))


def _build(name: str, values: dict[str, Any], prefix: str) -> Any:
    arguments = {}
    for member, (node, detail) in ORACLE.fielddefs[name][1]:
        path = prefix + member
        if node.name == "NAME":
            arguments[member] = _build(detail, values, f"{path}.")
        elif node.name == "ARRAY":
            arguments[member] = np.array(values[path], dtype=detail[0][1][0])
        else:
            arguments[member] = values[path]
    return ORACLE.types[name](**arguments)


def decode(name: str, record: bytes) -> dict[str, Any]:
    """Return the primitives that rosbags finds in a record."""
    return _flatten(name, ORACLE.deserialize_cdr(record, name), "")


def _flatten(name: str, message: Any, prefix: str) -> dict[str, Any]:
    found: dict[str, Any] = {}
    for member, (node, detail) in ORACLE.fielddefs[name][1]:
        value = getattr(message, member)
        if node.name == "NAME":
            found.update(_flatten(detail, value, f"{prefix}{member}."))
        else:
            found[prefix + member] = tuple(value.tolist()) if node.name == "ARRAY" else value
    return found


def spelled(values: dict[str, Any]) -> dict[str, str]:
    """Return values in a form in which NaN equals NaN, and -0.0 is not 0.0."""
    return {path: repr(value) for path, value in values.items()}
