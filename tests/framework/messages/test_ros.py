"""Schemas: accepted by independent parsers, with the published type hashes."""

from __future__ import annotations

from typing import ClassVar, Literal

import pytest
import ros_oracle as oracle
from mcap_ros2._dynamic import generate_dynamic
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

import lodeflow as lf
from lodeflow.errors import MessageError
from lodeflow.messages.message import Message
from lodeflow.messages.ros import Leaf, definition, full_name, leaves, members, schema_text

each_type = pytest.mark.parametrize("kind", oracle.BUNDLED, ids=lambda kind: kind.__name__)

PUBLISHED = {
    lf.Imu: "RIHS01_7d9a00ff131080897a5ec7e26e315954b8eae3353c3f995c55faf71574000b5b",
    lf.MagneticField: "RIHS01_e80f32f56a20486c9923008fc1a1db07bbb273cbbf6a5b3bfa00835ee00e4dff",
    lf.Attitude: "RIHS01_381add86c6c3160644d228ca342182c7fd6c7fab11c7a85ad817a9cc22dbac6e",
}


@pytest.mark.parametrize("kind", PUBLISHED, ids=lambda kind: kind.ros)
def test_our_definitions_of_standard_types_have_the_published_hash(kind: type[Message]) -> None:
    store = get_typestore(Stores.EMPTY)
    store.register(get_types_from_msg(schema_text(kind), kind.ros))
    assert store.hash_rihs01(kind.ros) == PUBLISHED[kind]


@each_type
def test_rosbags_parses_each_schema_with_its_dependencies(kind: type[Message]) -> None:
    types = get_types_from_msg(schema_text(kind), kind.ros)
    assert {kind.ros, "std_msgs/msg/Header", "builtin_interfaces/msg/Time"} <= types.keys()
    store = get_typestore(Stores.EMPTY)
    store.register(types)
    names = [name for name, _ in store.fielddefs[kind.ros][1]]
    assert names[0] == "header"
    assert set(kind.field_names) <= set(names)
    assert {n: v for n, _, v in store.fielddefs[kind.ros][0]} == kind.constants


@each_type
def test_the_mcap_package_parses_each_schema(kind: type[Message]) -> None:
    assert kind.ros in generate_dynamic(kind.ros, schema_text(kind))


def test_the_schema_of_an_own_type() -> None:
    class Sample(Message, ros="lodeflow_ros_test/msg/Sample"):
        """First line.

        Second, after a gap.
        """

        OFF: ClassVar = 0
        field: lf.Array[lf.Tesla, Literal[4]]
        inverse: lf.Matrix3[lf.Dimensionless]
        count: lf.UInt32

    assert definition(Sample) == (
        "# First line.\n"
        "#\n"
        "# Second, after a gap.\n"
        "uint8 OFF=0\n"
        "std_msgs/Header header\n"
        "float64[4] field  # T\n"
        "float64[9] inverse\n"
        "uint32 count\n"
    )


def test_units_and_gaps_are_comments_of_the_schema() -> None:
    assert "float64 heading  # rad\n" in definition(lf.Heading)
    assert "geometry_msgs/Quaternion quaternion  # NaN: unknown\n" in definition(lf.AttitudeTruth)


def test_leaves_come_in_the_order_of_the_wire() -> None:
    found = list(leaves(definition(lf.MagneticField)))
    assert found == [
        Leaf("header.stamp.sec", "int32", None),
        Leaf("header.stamp.nanosec", "uint32", None),
        Leaf("header.frame_id", "string", None),
        Leaf("magnetic_field.x", "float64", None),
        Leaf("magnetic_field.y", "float64", None),
        Leaf("magnetic_field.z", "float64", None),
        Leaf("magnetic_field_covariance", "float64", 9),
    ]


@pytest.mark.parametrize("line", ["float64[] values", "string<=10 name", "float64[<=3] x"])
def test_a_member_of_variable_size_is_refused(line: str) -> None:
    with pytest.raises(MessageError, match="no fixed size: "):
        list(members(f"uint8 ONE=1\n{line}  # comment\n"))


def test_names_with_and_without_msg() -> None:
    assert full_name("std_msgs/Header") == "std_msgs/msg/Header"
    assert full_name("std_msgs/msg/Header") == "std_msgs/msg/Header"
