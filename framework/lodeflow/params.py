"""Parameters of a plugin: typed, frozen, with units, checked before anything runs."""

from __future__ import annotations

import ast
import inspect
import itertools
import textwrap
from functools import cache
from typing import Annotated, Any, get_args

import numpy as np
from numpy.typing import NDArray
from pydantic import (
    AfterValidator,
    BaseModel,
    ConfigDict,
    GetCoreSchemaHandler,
    GetJsonSchemaHandler,
)
from pydantic.json_schema import JsonSchemaValue
from pydantic_core import CoreSchema, PydanticCustomError, core_schema

from lodeflow.messages.units import Dimensionless, Unit


class Params(BaseModel):
    """Base of the nested `Params` of every plugin.

    Unknown names are refused, values cannot be assigned after construction. A quantity carries its
    unit in the annotation, `gyro_noise: Annotated[float, RadPerSecond] = 0.01`; a user may then
    write a plain number in that unit, or a text such as "0.5 deg/s".
    """

    model_config = ConfigDict(
        extra="forbid",
        frozen=True,
        arbitrary_types_allowed=True,
        allow_inf_nan=False,
        validate_default=True,
    )

    def __eq__(self, other: object) -> bool:
        if type(self) is not type(other):
            return NotImplemented
        return _same(self.__dict__, other.__dict__)

    __hash__ = None  # type: ignore[assignment]


def _same(one: Any, other: Any) -> bool:
    """Return whether two values are equal, arrays in them included."""
    if isinstance(one, np.ndarray) or isinstance(other, np.ndarray):
        return np.array_equal(one, other)
    if isinstance(one, (list, tuple)) and type(one) is type(other):
        return len(one) == len(other) and all(map(_same, one, other))
    if isinstance(one, dict) and isinstance(other, dict):
        return one.keys() == other.keys() and all(_same(one[key], other[key]) for key in one)
    return bool(one == other)


class _ArrayOf:
    """Pydantic schema of a float64 array of fixed shape, given as nested lists."""

    def __init__(self, *shape: int) -> None:
        self.shape = shape

    def __get_pydantic_core_schema__(
        self, source: type[Any], handler: GetCoreSchemaHandler
    ) -> CoreSchema:
        def convert(value: Any) -> NDArray[np.float64]:
            try:
                array = np.array(value, dtype=np.float64)
            except (TypeError, ValueError):
                raise self._refusal() from None
            if array.shape != self.shape or not np.isfinite(array).all():
                raise self._refusal()
            array.flags.writeable = False
            return array

        return core_schema.no_info_plain_validator_function(
            convert,
            serialization=core_schema.plain_serializer_function_ser_schema(lambda a: a.tolist()),
        )

    def _refusal(self) -> PydanticCustomError:
        shape = " x ".join(map(str, self.shape))
        return PydanticCustomError(
            "array", "should be {shape} finite numbers, as a list", {"shape": shape}
        )

    def __get_pydantic_json_schema__(
        self, schema: CoreSchema, handler: GetJsonSchemaHandler
    ) -> JsonSchemaValue:
        inner: JsonSchemaValue = {"anyOf": [{"type": "number"}, {"type": "string"}]}
        for length in reversed(self.shape):
            inner = {"type": "array", "items": inner, "minItems": length, "maxItems": length}
        return inner


Vec3 = Annotated[NDArray[np.float64], _ArrayOf(3)]
"""Three numbers; float64 of shape (3,), read-only."""
Mat3 = Annotated[NDArray[np.float64], _ArrayOf(3, 3)]
"""Three rows of three numbers; float64 of shape (3, 3), read-only."""


class _ReadFromFile:
    """Marks the parameter that names calibration files."""


def _refuse_file(value: Any) -> Any:
    if value is not None:
        raise PydanticCustomError(
            "file", "is read where a graph is loaded; here, give the values that are in it"
        )
    return value


CalibrationFile = Annotated[str | list[str] | None, AfterValidator(_refuse_file), _ReadFromFile()]
"""A parameter, `file: CalibrationFile = None`, that brings the others of its node.

It names a file that `lodeflow calibrate` wrote, or a list of them, of which the later win; paths
start at the current folder. Loading a graph puts what the files hold in the place of all
parameters that were set before, so that the graph in a recording needs no file. In the node it is
always None.
"""


def file_parameter(params: type[BaseModel]) -> str | None:
    """Return the name of the parameter that names calibration files, if there is one."""
    for name, field in params.model_fields.items():
        if any(isinstance(mark, _ReadFromFile) for mark in field.metadata):
            return name
    return None


@cache
def docs_of(params: type[BaseModel]) -> dict[str, str]:
    """Return what is said of each field of parameters: the text below it in the source.

    Pydantic can read them for each class as it is made; but to parse its source then is a fifth of
    what a command takes to start, for texts that few commands show.
    """
    found: dict[str, str] = {}
    for base in reversed(params.__mro__):
        if base is not BaseModel and issubclass(base, BaseModel):
            found |= _docstrings(base)
    said = {name: field.description for name, field in params.model_fields.items()}
    return {name: text for name in said if (text := found.get(name) or said[name])}


def models_of(annotation: Any) -> list[type[BaseModel]]:
    """Return the nested models in an annotation such as `Inner | None` or `list[Inner]`."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return [annotation]
    return [model for inner in get_args(annotation) for model in models_of(inner)]


def _docstrings(made: type) -> dict[str, str]:
    """Return the texts below the fields of a class, as far as there is a source."""
    try:
        source = textwrap.dedent(inspect.getsource(made))
        (body,) = ast.parse(source).body
    except (OSError, TypeError, SyntaxError, ValueError):
        return {}
    found = {}
    lines = body.body if isinstance(body, ast.ClassDef) else []
    for line, below in itertools.pairwise(lines):
        if (
            isinstance(line, ast.AnnAssign)
            and isinstance(line.target, ast.Name)
            and isinstance(below, ast.Expr)
            and isinstance(below.value, ast.Constant)
            and isinstance(below.value.value, str)
        ):
            found[line.target.id] = inspect.cleandoc(below.value.value)
    return found


def unit_of(metadata: list[Any]) -> type[Unit]:
    """Return the unit among the metadata of a pydantic field."""
    units = [m for m in metadata if isinstance(m, type) and issubclass(m, Unit)]
    return units[0] if units else Dimensionless
