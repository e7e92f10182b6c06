"""What a message class may declare, and the text of each mistake."""

from __future__ import annotations

from typing import Annotated, Any, ClassVar, Literal

import numpy as np
import pytest

import lodeflow as lf
from lodeflow.errors import MessageError
from lodeflow.messages.message import Message, MessageMeta, by_ros_name


class Full(Message, ros="lodeflow_declaration_test/msg/Full", frame="lab"):
    """One field of each kind."""

    LOW: ClassVar = 1
    HIGH: ClassVar[int] = 255
    label: ClassVar = "no constant"

    scalar: lf.Scalar[lf.Radian]
    vector: lf.Vector3[lf.Tesla]
    quaternion: Annotated[lf.Quaternion, lf.GAPS]
    matrix: lf.Matrix3[lf.Dimensionless]
    array: lf.Array[lf.Second, Literal[5]]
    whole: lf.Int64
    word: lf.UInt32
    code: lf.UInt8
    plain: lf.Scalar


class Wider(Full, ros="lodeflow_declaration_test/msg/Wider"):
    """Has one more."""

    extra: lf.Scalar[lf.Meter]


def test_fields_are_resolved() -> None:
    found = {
        f.name: (f.shape, f.integer, f.ros, f.unit, f.gaps, f.size, f.dtype) for f in Full.fields
    }
    real, whole = np.dtype(np.float64), np.dtype(np.int64)
    none = lf.Dimensionless
    vector, quaternion = "geometry_msgs/Vector3", "geometry_msgs/Quaternion"
    assert found == {
        "scalar": ((), False, "float64", lf.Radian, False, 1, real),
        "vector": ((3,), False, vector, lf.Tesla, False, 3, real),
        "quaternion": ((4,), False, quaternion, none, True, 4, real),
        "matrix": ((3, 3), False, "float64[9]", none, False, 9, real),
        "array": ((5,), False, "float64[5]", lf.Second, False, 5, real),
        "whole": ((), True, "int64", none, False, 1, whole),
        "word": ((), True, "uint32", none, False, 1, whole),
        "code": ((), True, "uint8", none, False, 1, whole),
        "plain": ((), False, "float64", none, False, 1, real),
    }
    assert Full.constants == {"LOW": 1, "HIGH": 255}
    assert (Full.ros, Full.frame) == ("lodeflow_declaration_test/msg/Full", "lab")
    assert by_ros_name[Full.ros] is Full


def test_a_type_may_widen_another() -> None:
    assert Wider.field_names == (*Full.field_names, "extra")
    wide = Wider.of(3, extra=2, vector=[1, 2, 3])
    assert (wide.t, wide.extra, wide.vector.tolist()) == (3, 2.0, [1, 2, 3])
    assert Wider.constants == Full.constants
    assert wide.as_block().row(0) == wide


def test_an_abstract_base_has_no_ros_name() -> None:
    assert lf.Score.ros == ""
    assert lf.AttitudeScore.ros == "lodeflow_msgs/msg/AttitudeScore"
    assert issubclass(lf.AttitudeScore, lf.Score)


def declare(ros: str = "lodeflow_declaration_test/msg/Bad", **body: Any) -> type:
    fields = body.pop("fields", {})
    namespace = {"__module__": __name__, "__annotations__": fields, **body}
    return MessageMeta("Bad", (Message,), namespace, ros=ros)


KINDS = "is not a field kind; use Scalar, Vector3, Quaternion, Matrix3, Array, Int64, UInt32"


@pytest.mark.parametrize(
    ("body", "text"),
    [
        ({"fields": {"x": float}}, f"Bad.x: <class 'float'> {KINDS} or UInt8"),
        ({"fields": {"x": "float"}}, f"Bad.x: <class 'float'> {KINDS} or UInt8"),
        (
            {"fields": {"x": list[lf.Scalar]}},
            f"Bad.x: list[lodeflow.messages.fields.Scalar] {KINDS} or UInt8",
        ),
        (
            {"fields": {"x": "Missing"}},
            "Bad: name 'Missing' is not defined; annotations are read when the class is defined",
        ),
        (
            {"fields": {"x": "lf.Scala"}},
            "Bad: module 'lodeflow' has no attribute 'Scala'; annotations are read when the class "
            "is defined",
        ),
        (
            {"fields": {"x": lf.Scalar[float]}},
            "Bad.x: <class 'float'> is not a unit; use for example Tesla",
        ),
        ({"fields": {"x": lf.Array}}, "Bad.x: write Array[UNIT, Literal[CAPACITY]]"),
        ({"fields": {"x": lf.Array[lf.Tesla, int]}}, "Bad.x: write Array[UNIT, Literal[CAPACITY]]"),
        (
            {"fields": {"x": lf.Array[lf.Tesla, Literal[0]]}},
            "Bad.x: write Array[UNIT, Literal[CAPACITY]]",
        ),
        (
            {"fields": {"x": lf.Array[lf.Tesla, Literal[1, 2]]}},
            "Bad.x: write Array[UNIT, Literal[CAPACITY]]",
        ),
        (
            {"fields": {"x": Annotated[lf.UInt8, lf.GAPS]}},
            "Bad.x: an integer has no NaN, so it cannot have GAPS",
        ),
        (
            {"fields": {"Bx": lf.Scalar}},
            "Bad.Bx: a field is named in lower case (a-z, 0-9, _); a constant is annotated as "
            "ClassVar",
        ),
        ({"fields": {"t": lf.Int64}}, "Bad.t: a field cannot have this name, it is taken"),
        (
            {"fields": {"values": lf.Scalar}},
            "Bad.values: a field cannot have this name, it is taken",
        ),
        (
            {"fields": {"header": lf.Scalar}},
            "Bad.header: a field cannot have this name, it is taken",
        ),
        (
            {"fields": {"replace": lf.Scalar}},
            "Bad.replace: a field cannot have this name, it is taken",
        ),
        ({"fields": {"x": lf.Scalar}, "x": 1.0}, "Bad.x: a field has no default value"),
        (
            {"ros": "lodeflow_msgs/msg/Mode"},
            "Bad: the ROS 2 name 'lodeflow_msgs/msg/Mode' is taken by Mode",
        ),
        ({"ros": "Bad"}, "Bad: ros='Bad' must read package/msg/Name"),
        ({"ros": "Pkg/msg/Bad"}, "Bad: ros='Pkg/msg/Bad' must read package/msg/Name"),
        ({"ros": "pkg/msg/bad"}, "Bad: ros='pkg/msg/bad' must read package/msg/Name"),
        ({"ros": "/msg/"}, "Bad: ros='/msg/' must read package/msg/Name"),
        ({"FAULT": 256}, "Bad.FAULT must be from 0 to 255, got 256"),
        ({"FAULT": -1}, "Bad.FAULT must be from 0 to 255, got -1"),
    ],
)
def test_a_wrong_declaration_says_what_is_wrong(body: dict[str, Any], text: str) -> None:
    known = dict(by_ros_name)
    with pytest.raises(MessageError) as found:
        declare(**body)
    assert str(found.value) == text
    assert by_ros_name == known


def test_a_standard_type_must_have_the_declared_members(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delitem(by_ros_name, "sensor_msgs/msg/MagneticField")
    ros = "sensor_msgs/msg/MagneticField"
    with pytest.raises(MessageError) as found:
        declare(ros, fields={"field": lf.Vector3[lf.Tesla]})
    assert str(found.value) == f"Bad.field: {ros} has no member 'geometry_msgs/Vector3 field'"
    with pytest.raises(MessageError) as found:
        declare(ros, fields={"magnetic_field": lf.Scalar[lf.Tesla]})
    assert str(found.value) == f"Bad.magnetic_field: {ros} has no member 'float64 magnetic_field'"
    assert ros not in by_ros_name
