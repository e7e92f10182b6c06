"""Statistics by their text."""

import math

import pytest

from lodeflow.messages.units import Dimensionless, Meter, Radian
from lodeflow.study.statistics import Statistic

VALUES = [3.0, 1.0, 2.0, 6.0]


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("mean", 3.0),
        ("median", 2.5),
        ("rms", math.sqrt(12.5)),
        ("std", math.sqrt(3.5)),
        ("min", 1.0),
        ("max", 6.0),
        ("sum", 12.0),
        ("p50", 2.5),
        ("p95", 5.55),
        ("count above 2", 2.0),
        ("count below 2", 1.0),
        ("percent above 2", 50.0),
    ],
)
def test_each(text, expected):
    assert Statistic(text).check(Dimensionless) == ""
    assert Statistic(text).of(VALUES, Dimensionless) == pytest.approx(expected)


def test_a_threshold_has_a_unit():
    ten = math.radians(10)
    assert Statistic("count above 10 deg").of([ten - 1e-9, ten + 1e-9, 1.0], Radian) == 2.0
    wrong = Statistic("count above 10 deg").check(Meter)
    assert wrong == "'count above 10 deg': 'deg' is not a unit of m | mm | cm | km"
    assert "is not a number with a unit" in Statistic("count above ten").check(Radian)


@pytest.mark.parametrize("text", ["mean", "max", "count above 0", "p10"])
def test_one_nan_and_there_is_no_number(text):
    assert math.isnan(Statistic(text).of([1.0, math.nan], Dimensionless))


@pytest.mark.parametrize(
    ("text", "near"), [("medain", "median"), ("maximum", ""), ("count over 3", "count"), ("p", "")]
)
def test_unknown(text, near):
    wrong = Statistic(text).check(Radian)
    assert wrong.startswith(f"no statistic {text!r}")
    assert near in wrong
