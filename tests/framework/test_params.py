"""Parameters: units, arrays, and all mistakes at once."""

from __future__ import annotations

import math
from typing import Annotated, Any

import numpy as np
import pytest
from pydantic import BaseModel, Field, ValidationError

import lodeflow as lf
from lodeflow.params import unit_of


class Inner(lf.Params):
    depth: Annotated[float, lf.Meter] = 1.0


class Params(lf.Params):
    gyro_noise: Annotated[float, lf.RadPerSecond] = Field(0.01, ge=0)
    """Standard deviation of the gyroscope."""
    rates: Annotated[list[float], lf.RadPerSecond] = Field([1.0])
    bias: Annotated[lf.Vec3, lf.Tesla] = (0, 0, 0)
    misalignment: lf.Mat3 = np.eye(3).tolist()
    count: int = 3
    inner: Inner = Inner()
    names: dict[str, list[lf.Vec3]] = Field({})


def wrong(**values: Any) -> list[tuple[tuple[Any, ...], str]]:
    with pytest.raises(ValidationError) as found:
        Params(**values)
    return [(error["loc"], error["msg"]) for error in found.value.errors()]


def test_defaults_are_validated_too() -> None:
    params = Params()
    assert params.bias.dtype == np.float64
    assert params.misalignment.shape == (3, 3)

    class Impossible(lf.Params):
        gain: Annotated[float, Field(gt=0)] = -1.0

    with pytest.raises(ValidationError):
        Impossible()


def test_texts_with_units_are_converted_everywhere() -> None:
    params = Params(
        gyro_noise="0.5 deg/s",
        rates=["180 deg/s", 2, "3"],
        bias=["10 uT", 0, "-1e-6"],
        inner={"depth": "3 cm"},
    )
    assert params.gyro_noise == pytest.approx(math.radians(0.5))
    assert params.rates == pytest.approx([math.pi, 2, 3])
    assert params.bias == pytest.approx([10e-6, 0, -1e-6])
    assert params.inner.depth == pytest.approx(0.03)


def test_all_mistakes_come_at_once_with_their_place() -> None:
    assert wrong(
        gyro_nois=1,
        gyro_noise="5 m",
        bias=[1, 2],
        misalignment=[[1, 0, 0], [0, 1, 0], [0, 0, "x"]],
        count="many",
        inner={"depth": "deep"},
    ) == [
        (("gyro_noise",), "'m' is not a unit of rad/s | deg/s | °/s | deg/h | rpm"),
        (("bias",), "should be 3 finite numbers, as a list"),
        (("misalignment",), "should be 3 x 3 finite numbers, as a list"),
        (("count",), "Input should be a valid integer, unable to parse string as an integer"),
        (("inner", "depth"), "'deep' is not a number with a unit (m | mm | cm | km)"),
        (("gyro_nois",), "Extra inputs are not permitted"),
    ]


@pytest.mark.parametrize("value", [math.nan, math.inf, "nan", "inf rad/s"])
def test_numbers_are_finite(value: Any) -> None:
    assert wrong(gyro_noise=value)[0][1] == "Input should be a finite number"
    assert wrong(bias=[0, 0, value])[0][0] == ("bias",)


def test_a_range_is_checked_in_the_si_unit() -> None:
    assert wrong(gyro_noise="-1 deg/s") == [
        (("gyro_noise",), "Input should be greater than or equal to 0")
    ]


@pytest.mark.parametrize("value", [None, 1.0, {}, [[1, 2], [3]], [1, 2, 3, 4]])
def test_an_array_has_its_shape(value: Any) -> None:
    assert wrong(bias=value) == [(("bias",), "should be 3 finite numbers, as a list")]


def test_nothing_changes_afterwards() -> None:
    params = Params()
    with pytest.raises(ValidationError, match="frozen"):
        params.count = 4
    with pytest.raises(ValueError, match="read-only"):
        params.bias[0] = 1.0
    mine = np.ones(3)
    other = Params(bias=mine)
    mine[0] = 7
    assert other.bias.tolist() == [1, 1, 1]


def test_equality_looks_into_arrays_and_nested_values() -> None:
    assert Params() == Params()
    assert Params(bias=[1, 2, 3]) == Params(bias=[1.0, 2.0, 3.0])
    assert Params(bias=[1, 2, 3]) != Params(bias=[1, 2, 4])
    assert Params(inner={"depth": 2}) != Params()
    assert Params(rates=[1, 2]) != Params(rates=[1])
    assert Params(names={"a": [[1, 2, 3]]}) == Params(names={"a": [[1, 2, 3]]})
    assert Params(names={"a": [[1, 2, 3]]}) != Params(names={"a": [[1, 2, 4]]})
    assert Params(names={"a": [[1, 2, 3]]}) != Params(names={"b": [[1, 2, 3]]})
    assert Params() != Inner()
    assert (Params() == 3) is False

    class Ragged(lf.Params):
        rows: list[list[int]]

    assert Ragged(rows=[[1], [2, 3]]) == Ragged(rows=[[1], [2, 3]])
    assert Ragged(rows=[[1], [2, 3]]) != Ragged(rows=[[1], [2, 4]])


def test_values_are_written_as_plain_data() -> None:
    dumped = Params(bias=["1 uT", 0, 0]).model_dump(mode="json")
    assert dumped["bias"] == [1e-6, 0, 0]
    assert dumped["misalignment"] == np.eye(3).tolist()
    assert Params(**dumped) == Params(bias=[1e-6, 0, 0])


def test_the_json_schema_is_for_editors() -> None:
    schema = Params.model_json_schema()
    assert schema["additionalProperties"] is False
    fields = schema["properties"]
    assert fields["gyro_noise"]["anyOf"] == [{"type": "number", "minimum": 0}, {"type": "string"}]
    vector = {"anyOf": [{"type": "number"}, {"type": "string"}]}
    row = {"type": "array", "items": vector, "minItems": 3, "maxItems": 3}
    assert {key: fields["bias"][key] for key in row} == row
    assert "T | mT" in fields["bias"]["description"]
    assert fields["misalignment"]["items"] == row


def test_unit_of() -> None:
    fields = Params.model_fields
    assert unit_of(fields["gyro_noise"].metadata) is lf.RadPerSecond
    assert unit_of(fields["bias"].metadata) is lf.Tesla
    assert unit_of(fields["count"].metadata) is lf.Dimensionless
    assert issubclass(lf.Params, BaseModel)
