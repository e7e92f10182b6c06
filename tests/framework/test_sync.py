"""Sync declarations and sparse columns."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

import lodeflow as lf
from lodeflow.sync import END, NEVER, describe


def test_bounds_begin_below_and_end_above_every_stamp() -> None:
    assert np.int64(NEVER) == np.iinfo(np.int64).min
    assert np.int64(END) == np.iinfo(np.int64).max
    assert lf.Bound(5) == lf.Bound(5)


def test_declarations_cannot_be_changed() -> None:
    with pytest.raises(dataclasses.FrozenInstanceError):
        lf.Nearest("a", 5).within = 6
    with pytest.raises(dataclasses.FrozenInstanceError):
        lf.Bound(5).t = 6


def test_the_first_value_of_a_hold() -> None:
    mode = lf.Mode(0, 1)
    assert lf.Hold("a", initial={"b": mode}).first("b") is mode
    assert lf.Hold("a", initial={"b": mode}).first("a") is None
    assert lf.Hold("a").first("b") is None


def test_a_sparse_column() -> None:
    values = lf.Heading(np.array([3, 8]), np.array([0.5, 1.5]))
    column = lf.Sparse(values, np.array([-1, 0, -1, 1]), np.array([1, 3, 5, 8]))
    assert [column.row(i) for i in range(4)] == [None, values.row(0), None, values.row(1)]


@pytest.mark.parametrize(
    ("sync", "text"),
    [
        (None, "one input"),
        (lf.Exact(), "equal stamps"),
        (lf.Nearest("imu", 2_500_000), "nearest to each imu within 2.5 ms"),
        (lf.Hold("imu"), "last value at or before each imu"),
        (lf.Hold("imu", delay=True), "last value before each imu"),
        (lf.Each(), "every stamp"),
    ],
)
def test_describe(sync: object, text: str) -> None:
    assert describe(sync) == text
