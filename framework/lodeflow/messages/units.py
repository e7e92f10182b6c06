"""Units: one SI unit per quantity inside, other spellings converted at the edges.

A unit is a class, so that it can stand in an annotation: `Vector3[Tesla]` for a message field,
`Annotated[float, RadPerSecond]` for a parameter. Where a user gives a value (a graph file, a CSV
header), a plain number is in the SI unit and a text such as "0.15 deg/s" is converted.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, ClassVar

from pydantic import GetCoreSchemaHandler, GetJsonSchemaHandler
from pydantic.json_schema import JsonSchemaValue
from pydantic_core import CoreSchema, PydanticCustomError, core_schema

from lodeflow.errors import MessageError

STANDARD_GRAVITY = 9.80665  # m/s², by definition (CGPM 1901)


class Unit:
    """A physical unit; subclass it with `symbol`, and `accepts` for the spellings it converts."""

    symbol: ClassVar[str] = ""
    accepts: ClassVar[Mapping[str, float]] = {}
    shown: ClassVar[str] = ""
    """The spelling in which people read the quantity, where that is not the SI unit."""

    @classmethod
    def factor(cls, spelling: str) -> float:
        """Return the factor from the unit spelled `spelling` to this unit.

        Raises:
            MessageError: `spelling` is no unit of this quantity.
        """
        if spelling == cls.symbol:
            return 1.0
        try:
            return cls.accepts[spelling]
        except KeyError:
            raise MessageError(f"{spelling!r} is not a unit of {cls.quantity()}") from None

    @classmethod
    def quantity(cls) -> str:
        """Return what may be written for this unit, for error messages and documentation."""
        return " | ".join([cls.symbol or "a plain number", *cls.accepts])

    @classmethod
    def parse(cls, text: str) -> float:
        """Return the value of a text such as "0.15 deg/s" in this unit.

        Raises:
            MessageError: the text is not a number followed by a unit of this quantity.
        """
        number, _, spelling = text.strip().partition(" ")
        try:
            value = float(number)
        except ValueError:
            raise MessageError(f"{text!r} is not a number with a unit ({cls.quantity()})") from None
        return value * cls.factor(spelling.strip()) if spelling.strip() else value

    @classmethod
    def __get_pydantic_core_schema__(
        cls, source: type[Any], handler: GetCoreSchemaHandler
    ) -> CoreSchema:
        """Let a parameter annotated with this unit take texts with a unit beside plain numbers."""

        def convert(value: Any) -> Any:
            if isinstance(value, str):
                try:
                    return cls.parse(value)
                except MessageError as error:
                    raise PydanticCustomError("unit", "{why}", {"why": str(error)}) from None
            if isinstance(value, list):
                return [convert(item) for item in value]
            return value

        return core_schema.no_info_before_validator_function(convert, handler(source))

    @classmethod
    def __get_pydantic_json_schema__(
        cls, schema: CoreSchema, handler: GetJsonSchemaHandler
    ) -> JsonSchemaValue:
        """Describe the parameter to editors: the plain value, or a text with a unit."""
        plain = handler(schema)
        if plain.get("type") == "number":
            return {"anyOf": [plain, {"type": "string"}], "description": f"[{cls.quantity()}]"}
        return {**plain, "description": f"[{cls.quantity()}]"}


class Dimensionless(Unit):
    """A ratio, a count, or a direction cosine."""

    symbol = ""


class Ratio(Dimensionless):
    """A share of something."""

    accepts: ClassVar = {"%": 1e-2, "ppm": 1e-6}
    shown = "%"


class PerSecond(Unit):
    """Rate of change of a ratio."""

    symbol = "1/s"


class Radian(Unit):
    """Plane angle."""

    symbol = "rad"
    accepts: ClassVar = {
        "deg": math.pi / 180,
        "°": math.pi / 180,
        "mrad": 1e-3,
        "arcmin": math.pi / 10_800,
        "arcsec": math.pi / 648_000,
    }
    shown = "°"


class RadPerSecond(Unit):
    """Angular rate."""

    symbol = "rad/s"
    accepts: ClassVar = {
        "deg/s": math.pi / 180,
        "°/s": math.pi / 180,
        "deg/h": math.pi / 180 / 3600,
        "rpm": math.pi / 30,
    }


class AngleVariance(Unit):
    """Variance of an angle."""

    symbol = "rad²"
    accepts: ClassVar = {"rad^2": 1.0, "deg^2": (math.pi / 180) ** 2}


class AngleRandomWalk(Unit):
    """Standard deviation of an angle that wanders, per square root of the time."""

    symbol = "rad/√s"
    accepts: ClassVar = {
        "rad/sqrt(s)": 1.0,
        "deg/√s": math.pi / 180,
        "deg/sqrt(s)": math.pi / 180,
        "deg/√h": math.pi / 180 / 60,
        "deg/sqrt(h)": math.pi / 180 / 60,
    }


class RateVariance(Unit):
    """Variance of an angular rate."""

    symbol = "rad²/s²"
    accepts: ClassVar = {"rad^2/s^2": 1.0, "deg^2/s^2": (math.pi / 180) ** 2}


class MeterPerSecondSquared(Unit):
    """Acceleration, specific force."""

    symbol = "m/s²"
    accepts: ClassVar = {
        "m/s^2": 1.0,
        "m/s2": 1.0,
        "g": STANDARD_GRAVITY,
        "mg": STANDARD_GRAVITY * 1e-3,
        "Gal": 1e-2,
        "mGal": 1e-5,
    }


class Gravity(MeterPerSecondSquared):
    """Gravity and what corrects it: small accelerations, read in mGal."""

    shown = "mGal"


class MeterPerSecond(Unit):
    """Velocity."""

    symbol = "m/s"
    accepts: ClassVar = {"km/h": 1 / 3.6, "kn": 1852 / 3600}


class Tesla(Unit):
    """Magnetic flux density."""

    symbol = "T"
    accepts: ClassVar = {
        "mT": 1e-3,
        "uT": 1e-6,
        "µT": 1e-6,
        "nT": 1e-9,
        "G": 1e-4,
        "mG": 1e-7,
        "gauss": 1e-4,
    }


class TeslaRandomWalk(Unit):
    """Standard deviation of a field that wanders, per square root of the time."""

    symbol = "T/√s"
    accepts: ClassVar = {"T/sqrt(s)": 1.0, "uT/√s": 1e-6, "µT/√s": 1e-6, "uT/sqrt(s)": 1e-6}


class TeslaNoiseDensity(Unit):
    """Noise of a magnetometer, per square root of the bandwidth."""

    symbol = "T/√Hz"
    accepts: ClassVar = {"T/sqrt(Hz)": 1.0, "nT/√Hz": 1e-9, "nT/sqrt(Hz)": 1e-9, "uT/√Hz": 1e-6}


class Second(Unit):
    """Duration."""

    symbol = "s"
    accepts: ClassVar = {"ms": 1e-3, "us": 1e-6, "µs": 1e-6, "ns": 1e-9, "min": 60.0, "h": 3600.0}


class Hertz(Unit):
    """Rate of samples."""

    symbol = "Hz"
    accepts: ClassVar = {"kHz": 1e3}


class Meter(Unit):
    """Length."""

    symbol = "m"
    accepts: ClassVar = {"mm": 1e-3, "cm": 1e-2, "km": 1e3}


class Lsb(Unit):
    """Raw output of a converter, in least significant bits."""

    symbol = "LSB"


class LsbPerTesla(Unit):
    """Sensitivity of a magnetometer."""

    symbol = "LSB/T"
    accepts: ClassVar = {"LSB/uT": 1e6, "LSB/µT": 1e6, "LSB/nT": 1e9, "LSB/G": 1e4}
