"""Units: what may be written, by which factor, and what is said of a mistake."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

import lodeflow as lf
from lodeflow.errors import MessageError
from lodeflow.messages.units import Unit

UNITS = Unit.__subclasses__()


@pytest.mark.parametrize(
    ("unit", "text", "value"),
    [
        (lf.RadPerSecond, "180 deg/s", math.pi),
        (lf.RadPerSecond, "180 °/s", math.pi),
        (lf.RadPerSecond, "1 deg/h", math.radians(1) / 3600),
        (lf.RadPerSecond, "60 rpm", 2 * math.pi),
        (lf.RadPerSecond, "0.25", 0.25),
        (lf.RadPerSecond, " -1e-3  rad/s ", -1e-3),
        (lf.Radian, "90 deg", math.pi / 2),
        (lf.Radian, "5 mrad", 5e-3),
        (lf.MeterPerSecondSquared, "1 g", 9.80665),
        (lf.MeterPerSecondSquared, "2 mg", 2 * 9.80665e-3),
        (lf.MeterPerSecondSquared, "3 m/s^2", 3.0),
        (lf.MeterPerSecondSquared, "3 m/s²", 3.0),
        (lf.MeterPerSecondSquared, "1 mGal", 1e-5),
        (lf.Tesla, "50 uT", 50e-6),
        (lf.Tesla, "50 µT", 50e-6),
        (lf.Tesla, "500 mG", 50e-6),
        (lf.Tesla, "0.5 gauss", 50e-6),
        (lf.Tesla, "50000 nT", 50e-6),
        (lf.Second, "2 min", 120.0),
        (lf.Second, "5 ms", 5e-3),
        (lf.Hertz, "1 kHz", 1e3),
        (lf.Meter, "3 cm", 0.03),
        (lf.Lsb, "7 LSB", 7.0),
        (lf.LsbPerTesla, "15 LSB/uT", 15e6),
        (lf.LsbPerTesla, "1000 LSB/G", 1e7),
        (lf.Dimensionless, "0.5", 0.5),
    ],
)
def test_a_text_is_converted(unit: type[Unit], text: str, value: float) -> None:
    assert unit.parse(text) == pytest.approx(value, rel=1e-15)


@pytest.mark.parametrize("unit", UNITS, ids=lambda unit: unit.__name__)
def test_every_spelling_has_a_positive_factor_and_parses(unit: type[Unit]) -> None:
    for spelling in [unit.symbol, *unit.accepts]:
        factor = unit.factor(spelling)
        assert factor > 0
        assert unit.parse(f"2 {spelling}") == 2 * factor
    assert unit.factor(unit.symbol) == 1.0


@given(st.floats(allow_nan=False))
def test_a_plain_number_is_in_the_si_unit(value: float) -> None:
    assert lf.Tesla.parse(repr(value)) == value


def test_the_text_of_each_mistake() -> None:
    with pytest.raises(MessageError) as found:
        lf.Radian.parse("3 degrees")
    assert str(found.value) == "'degrees' is not a unit of rad | deg | ° | mrad | arcmin | arcsec"
    with pytest.raises(MessageError) as found:
        lf.Radian.parse("3deg")
    assert (
        str(found.value)
        == "'3deg' is not a number with a unit (rad | deg | ° | mrad | arcmin | arcsec)"
    )
    with pytest.raises(MessageError) as found:
        lf.Radian.parse("")
    assert (
        str(found.value)
        == "'' is not a number with a unit (rad | deg | ° | mrad | arcmin | arcsec)"
    )
    with pytest.raises(MessageError) as found:
        lf.Dimensionless.parse("3 T")
    assert str(found.value) == "'T' is not a unit of a plain number"


def test_a_unit_of_another_quantity_is_refused() -> None:
    for unit in UNITS:
        for other in UNITS:
            for spelling in {other.symbol, *other.accepts} - {unit.symbol, *unit.accepts}:
                with pytest.raises(MessageError, match="is not a unit of"):
                    unit.factor(spelling)
