"""Samples and blocks: construction, conversion, equality, and what is said of mistakes."""

from __future__ import annotations

import copy
import pickle
from typing import Any

import numpy as np
import pytest
import ros_oracle as oracle
from hypothesis import given, settings
from hypothesis import strategies as st

import lodeflow as lf
from lodeflow.errors import MessageError
from lodeflow.messages.message import Message

SETTINGS = settings(max_examples=40, deadline=None, derandomize=True, database=None)
each_type = pytest.mark.parametrize("kind", oracle.BUNDLED, ids=lambda kind: kind.__name__)


def field_block(n: int) -> Any:
    return lf.MagneticField(np.arange(n) * 10, np.arange(3.0 * n).reshape(n, 3))


def test_a_sample_and_a_block() -> None:
    sample = lf.MagneticField(7, np.ones(3))
    block = field_block(4)
    assert not sample.is_block
    assert block.is_block
    assert len(block) == 4
    assert bool(sample)
    assert bool(lf.Heading.empty())
    with pytest.raises(TypeError, match="a sample of MagneticField has no length; a block has"):
        len(sample)
    with pytest.raises(TypeError, match="a sample of MagneticField has no rows; a block has"):
        sample[0]


@each_type
@given(data=st.data())
@SETTINGS
def test_a_block_that_looks_well_formed_is(kind: type[Message], data: Any) -> None:
    block = data.draw(oracle.blocks(kind))
    assert block.is_well_formed()
    block.validate()


@pytest.mark.parametrize(
    "wrong",
    [
        lf.MagneticField(7, np.ones(3)),
        lf.MagneticField(np.arange(4), np.ones((3, 3))),
        lf.MagneticField(np.arange(4), np.ones((4, 2))),
        lf.MagneticField(np.arange(4), np.ones((4, 3), dtype=np.float32)),
        lf.MagneticField(np.arange(4), np.ones((4, 3), order="F")),
        lf.MagneticField(np.arange(4), np.ones((8, 3))[::2]),
        lf.MagneticField(np.arange(4), [[1.0] * 3] * 4),
        lf.MagneticField(np.arange(4), None),
        lf.MagneticField(np.arange(4, dtype=np.int32), np.ones((4, 3))),
        lf.MagneticField(np.arange(4.0), np.ones((4, 3))),
        lf.MagneticField(np.zeros((4, 1), dtype=np.int64), np.ones((4, 3))),
        lf.MagneticField(np.array(4), np.ones((4, 3))),
        lf.Heading(np.arange(4), np.ones((4, 1))),
        lf.Mode(np.arange(4), np.ones(4)),
    ],
    ids=lambda wrong: type(wrong).__name__,
)
def test_a_block_that_is_not_does_not_look_so(wrong: Message) -> None:
    assert not wrong.is_well_formed()
    if wrong.is_block:
        with pytest.raises(MessageError):
            wrong.validate()


def test_a_message_is_built_by_position_or_name() -> None:
    assert lf.EulerAngles(1, 2.0, 3.0, 4.0) == lf.EulerAngles(t=1, roll=4.0, pitch=3.0, heading=2.0)
    with pytest.raises(TypeError, match="missing 1 required positional argument: 'roll'"):
        lf.EulerAngles(1, 2.0, 3.0)


def test_attributes_cannot_be_assigned_or_deleted() -> None:
    sample = lf.Heading(7, 1.0)
    with pytest.raises(AttributeError, match=r"^Heading is immutable; use replace\(heading=...\)$"):
        sample.heading = 2.0
    with pytest.raises(AttributeError, match=r"^Heading is immutable; use replace\(wrong=...\)$"):
        sample.wrong = 2.0
    with pytest.raises(AttributeError, match=r"^Heading is immutable$"):
        del sample.heading
    assert not hasattr(sample, "__dict__")


def test_replace_gives_a_copy_with_other_values() -> None:
    sample = lf.EulerAngles(7, 1.0, 2.0, 3.0)
    assert sample.replace(t=8, pitch=5.0) == lf.EulerAngles(8, 1.0, 5.0, 3.0)
    assert sample == lf.EulerAngles(7, 1.0, 2.0, 3.0)
    with pytest.raises(MessageError) as found:
        sample.replace(pich=1.0)
    assert str(found.value) == "EulerAngles has no field 'pich', did you mean 'pitch'?"


@each_type
def test_rows_stack_concat_and_pickle_lose_nothing(kind: type[Message]) -> None:
    @SETTINGS
    @given(oracle.blocks(kind), st.integers(0, 5), st.integers(0, 5))
    def check(block: Any, i: int, j: int) -> None:
        block.validate()
        rows = [block.row(k) for k in range(len(block))]
        for row in rows:
            row.validate()
            assert row.as_block().row(0) == row
            row.as_block().validate()
        assert kind.stack(rows) == block
        kind.stack(rows).validate()
        first, last = sorted((i, j))
        parts = [block[:first], block[first:last], block[last:]]
        assert kind.concat(parts) == block
        for part in [*parts, block[::2], block[::-1]]:
            part.validate()
        assert [block[k] for k in range(len(block))] == rows
        assert block[np.arange(len(block))[::-1]] == block[::-1]
        assert pickle.loads(pickle.dumps(block)) == block
        assert [pickle.loads(pickle.dumps(row)) for row in rows] == rows
        assert copy.deepcopy(block) == block

    check()


@each_type
def test_empty_has_the_types_of_every_block(kind: type[Message]) -> None:
    empty = kind.empty()
    empty.validate()
    assert len(empty) == 0
    assert kind.stack([]) == empty
    assert kind.concat([]) == empty
    assert [c.dtype for c in empty.values()] == [field.dtype for field in kind.fields]


def test_a_sample_has_python_scalars() -> None:
    row = lf.AttitudeTruth(np.array([3]), np.zeros((1, 4)), np.array([1])).row(0)
    assert type(row.t) is int
    assert type(row.moving) is int
    assert type(lf.Heading(np.array([3]), np.zeros(1)).row(0).heading) is float


def test_a_mask_selects_rows() -> None:
    block = field_block(5)
    assert block[block.t >= 20] == block[2:]
    assert block[[4, 0]].t.tolist() == [40, 0]
    assert block[np.int64(1)] == block.row(1)
    assert block[-1].t == 40


def test_equality_asks_for_type_form_and_values() -> None:
    block = field_block(2)
    assert block == field_block(2)
    assert block != field_block(3)
    assert block[0] != block[:1]
    assert block[0] != block[0].replace(t=1)
    assert lf.Heading(0, 1.0) != lf.Heading(0, 2.0)
    assert lf.Heading(0, float("nan")) == lf.Heading(0, float("nan"))
    assert lf.RawField(0, np.ones(3)) != lf.RawForce(0, np.ones(3))
    assert (lf.Heading(0, 1.0) == "Heading") is False
    with pytest.raises(TypeError, match="unhashable"):
        hash(lf.Heading(0, 1.0))


def test_repr() -> None:
    assert repr(lf.Heading(5, 1.5)) == "Heading(t=5, heading=1.5)"
    assert repr(lf.RawField(5, np.ones(3))) == "RawField(t=5, counts=[1.0, 1.0, 1.0])"
    assert repr(field_block(3)) == "MagneticField[3 rows, t=0..20]"
    assert repr(lf.Heading.empty()) == "Heading[0 rows]"


def test_of_takes_numbers_and_lists() -> None:
    sample = lf.Imu.of(5, angular_velocity=[1, 2, 3])
    assert sample == lf.Imu(5, np.array([1.0, 2, 3]), np.zeros(3))
    assert lf.Mode.of(np.int64(5), mode=2) == lf.Mode(5, 2)
    assert type(lf.Mode.of(np.int64(5)).t) is int


def test_of_does_not_share_what_it_is_given() -> None:
    mine = np.ones(3)
    sample = lf.RawField.of(0, counts=mine)
    mine[:] = 7
    assert sample.counts.tolist() == [1, 1, 1]
    turned = np.ones((3, 2)).T[0]
    lf.RawField.of(0, counts=turned).validate()


@pytest.mark.parametrize(
    ("make", "text"),
    [
        (
            lambda: lf.EulerAngles.of(0, rol=1),
            "EulerAngles has no field 'rol', did you mean 'roll'?",
        ),
        (
            lambda: lf.Heading.of(0, heading="north"),
            "Heading.heading: 'north' is not float64 of shape ()",
        ),
        (
            lambda: lf.Heading.of(0, heading=None),
            "Heading.heading: None is not float64 of shape ()",
        ),
        (lambda: lf.Mode.of(0, mode=1.5), "Mode.mode: 1.5 is not int64 of shape ()"),
        (lambda: lf.Mode.of(0, mode=2**70), f"Mode.mode: {2**70} is not int64 of shape ()"),
        (
            lambda: lf.RawField.of(0, counts=[[1], [2, 3]]),
            "RawField.counts: [[1], [2, 3]] is not float64 of shape (3,)",
        ),
        (
            lambda: lf.RawField.of(0, counts=[1, 2]),
            "RawField.counts must be a C-contiguous float64 array of shape (3,), "
            "got float64 of shape (2,)",
        ),
        (
            lambda: lf.Heading.of(0, heading=[1, 2]),
            "Heading.heading must be a float, got float64 of shape (2,)",
        ),
        (lambda: lf.Mode.of(0, mode=256), "Mode.mode must be from 0 to 255, got 256 (int)"),
        (
            lambda: lf.Heading.of(0.01),
            "Heading.t must be an int in nanoseconds, or an int64 array for a block, "
            "got 0.01 (float)",
        ),
    ],
)
def test_of_says_what_does_not_fit(make: Any, text: str) -> None:
    with pytest.raises(MessageError) as found:
        make()
    assert str(found.value) == text


T = np.arange(2)


@pytest.mark.parametrize(
    ("message", "text"),
    [
        (
            lf.Heading(True, 1.0),
            "Heading.t must be an int in nanoseconds, or an int64 array for a block, "
            "got True (bool)",
        ),
        (
            lf.Heading(T.astype(float), np.zeros(2)),
            "Heading.t must be an int64 array of shape (N,), got float64 of shape (2,)",
        ),
        (
            lf.Heading(T.reshape(1, 2), np.zeros(2)),
            "Heading.t must be an int64 array of shape (N,), got int64 of shape (1, 2)",
        ),
        (
            lf.Heading(T, np.zeros((2, 1))),
            "Heading.heading must be a C-contiguous float64 array of shape (N,), "
            "got float64 of shape (2, 1)",
        ),
        (
            lf.RawField(T, np.zeros((3, 3))),
            "RawField.counts must be a C-contiguous float64 array of shape (N, 3), "
            "got float64 of shape (3, 3)",
        ),
        (
            lf.RawField(T, np.zeros((3, 2)).T),
            "RawField.counts must be a C-contiguous float64 array of shape (N, 3), "
            "got float64 of shape (2, 3)",
        ),
        (
            lf.RawField(0, np.zeros(3, dtype=np.float32)),
            "RawField.counts must be a C-contiguous float64 array of shape (3,), "
            "got float32 of shape (3,)",
        ),
        (
            lf.RawField(0, [1.0, 2.0, 3.0]),
            "RawField.counts must be a C-contiguous float64 array of shape (3,), "
            "got [1.0, 2.0, 3.0] (list)",
        ),
        (lf.Heading(0, 1), "Heading.heading must be a float, got 1 (int)"),
        (lf.Mode(0, 1.0), "Mode.mode must be an int, got 1.0 (float)"),
        (lf.Mode(0, True), "Mode.mode must be an int, got True (bool)"),
        (lf.Mode(0, -1), "Mode.mode must be from 0 to 255, got -1 (int)"),
        (
            lf.Mode(T, np.array([0, 300])),
            "Mode.mode must be from 0 to 255, got int64 of shape (2,)",
        ),
        (
            lf.AttitudeScore(0, *[0.0] * 6, 2**63, 0),
            f"AttitudeScore.samples must be from {-(2**63)} to {2**63 - 1}, got {2**63} (int)",
        ),
    ],
)
def test_validate_says_what_does_not_fit(message: Message, text: str) -> None:
    with pytest.raises(MessageError) as found:
        message.validate()
    assert str(found.value) == text


def test_validate_takes_numpy_scalars() -> None:
    lf.Heading(0, np.float64(1.0)).validate()
    lf.Mode(0, np.int64(1)).validate()


def test_stack_cuts_no_float_to_an_integer() -> None:
    with pytest.raises(MessageError) as found:
        lf.Mode.stack([lf.Mode(0, 1), lf.Mode(1, 1.5)])
    assert str(found.value) == "Mode.mode: not every sample has int64 of shape ()"
    with pytest.raises(MessageError) as found:
        lf.RawField.stack([lf.RawField(0, np.ones(3)), lf.RawField(1, np.ones(2))])
    assert str(found.value) == "RawField.counts: not every sample has float64 of shape (3,)"
    assert lf.Heading.stack([lf.Heading(0, 1), lf.Heading(1, 1.5)]).heading.tolist() == [1.0, 1.5]
