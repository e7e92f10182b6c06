"""CDR against rosbags in both directions, for every bundled type; and what is refused."""

from __future__ import annotations

import struct
from typing import Any, Literal

import numpy as np
import pytest
import ros_oracle as oracle
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap_ros2._dynamic import generate_dynamic

import lodeflow as lf
from lodeflow.errors import MessageError
from lodeflow.messages.cdr import (
    FIRST_STAMP,
    LAST_STAMP,
    PACKED_VALUES,
    StreamConstants,
    layout_of,
    read_constants,
)
from lodeflow.messages.message import Message
from lodeflow.messages.ros import schema_text

SETTINGS = settings(max_examples=40, deadline=None, derandomize=True, database=None)
each_type = pytest.mark.parametrize("kind", oracle.BUNDLED, ids=lambda kind: kind.__name__)


def test_the_bundled_types_are_all_here() -> None:
    assert {"Imu", "MagneticField", "Attitude", "AttitudeTruth", "Mode", "AttitudeScore"} <= {
        kind.__name__ for kind in oracle.BUNDLED
    }


@each_type
def test_rosbags_reads_what_we_write_and_we_read_what_it_writes(kind: type[Message]) -> None:
    @SETTINGS
    @given(oracle.samples(kind), oracle.constants(kind))
    def check(sample: Any, constants: StreamConstants) -> None:
        layout = layout_of(kind, constants)
        record = layout.encode_sample(sample)
        expected = oracle.flat(sample, constants)
        assert oracle.spelled(oracle.decode(kind.ros, record)) == oracle.spelled(expected)
        theirs = oracle.encode(kind.ros, expected)
        assert theirs == record
        assert layout.decode_sample(theirs) == sample
        assert oracle.spelled(oracle.flat(layout.decode_sample(theirs), constants)) == (
            oracle.spelled(expected)
        )
        assert repr(read_constants(kind, theirs)) == repr(constants)

    check()


@each_type
def test_blocks_and_samples_have_the_same_bytes(kind: type[Message]) -> None:
    @SETTINGS
    @given(oracle.blocks(kind), oracle.constants(kind))
    def check(block: Any, constants: StreamConstants) -> None:
        layout = layout_of(kind, constants)
        records = layout.encode_block(block)
        assert records.shape == (len(block), layout.size)
        rows = [layout.encode_sample(block.row(i)) for i in range(len(block))]
        assert [record.tobytes() for record in records] == rows
        decoded = layout.decode_block(records)
        decoded.validate()
        assert decoded == block
        assert layout.encode_block(decoded).tobytes() == records.tobytes()

    check()


@each_type
def test_the_mcap_package_decodes_by_our_schema(kind: type[Message]) -> None:
    decoder = generate_dynamic(kind.ros, schema_text(kind))[kind.ros]

    @settings(SETTINGS, max_examples=20)
    @given(oracle.samples(kind))
    def check(sample: Any) -> None:
        constants = StreamConstants.of(kind)
        found = decoder(layout_of(kind).encode_sample(sample))
        for path, value in oracle.flat(sample, constants).items():
            got = found
            for member in path.split("."):
                got = getattr(got, member)
            got = tuple(got) if isinstance(value, tuple) else got
            assert repr(got) == repr(value), path

    check()


def test_a_block_is_written_where_it_is_told_to() -> None:
    layout = layout_of(lf.Heading)
    block = lf.Heading(np.arange(3), np.array([0.5, 1.0, 1.5]))
    wide = np.full((3, layout.size + 20), 7, dtype=np.uint8)
    assert layout.encode_block(block, wide[:, 20:]) is not None
    assert wide[:, 20:].tobytes() == layout.encode_block(block).tobytes()
    assert (wide[:, :20] == 7).all()


def test_all_nan_patterns_become_one() -> None:
    odd = np.frombuffer(struct.pack("<4Q", 0xFFF8_0000_0000_0001, 0x7FF0_0000_0000_0001, 0, 0))
    odd = odd.view(np.float64).copy()
    layout = layout_of(lf.AttitudeTruth)
    plain = lf.AttitudeTruth(5, np.array([np.nan, np.nan, 0.0, 0.0]), 1)
    sample = lf.AttitudeTruth(5, odd, 1)
    assert np.isnan(odd[:2]).all()
    assert layout.encode_sample(sample) == layout.encode_sample(plain)
    assert layout.encode_block(sample.as_block()).tobytes() == layout.encode_sample(plain)


def test_scalars_may_be_numpy_scalars() -> None:
    layout = layout_of(lf.EulerAngles)
    plain = lf.EulerAngles(5, 1.5, float("nan"), -0.0)
    scalar = lf.EulerAngles(5, np.float64(1.5), np.float64("nan"), np.float64(-0.0))
    assert layout.encode_sample(scalar) == layout.encode_sample(plain)


def test_infinities_that_cancel_are_no_nan() -> None:
    layout = layout_of(lf.EulerAngles)
    sample = lf.EulerAngles(5, float("inf"), float("-inf"), 1.0)
    assert layout.decode_sample(layout.encode_sample(sample)) == sample


class Wide(lf.Message, ros="test_cdr_msgs/msg/Wide"):
    """Long arrays, which are not packed value by value, between fields that are."""

    first: lf.Array[lf.Dimensionless, Literal[PACKED_VALUES + 1]]  # type: ignore[valid-type]
    code: lf.UInt8
    second: lf.Array[lf.Dimensionless, Literal[500]]
    third: lf.Array[lf.Dimensionless, Literal[PACKED_VALUES]]  # type: ignore[valid-type]
    level: lf.Scalar[lf.Dimensionless]
    fourth: lf.Array[lf.Dimensionless, Literal[70]]


def wide(generator: np.random.Generator) -> Any:
    columns = [
        generator.normal(size=f.shape) if f.shape else generator.integers(0, 200).item()
        for f in Wide.fields
    ]
    return Wide(int(generator.integers(0, 10**18)), *columns).replace(level=0.5)


def test_long_arrays_have_the_same_bytes_in_samples_and_blocks() -> None:
    layout, generator = layout_of(Wide), np.random.default_rng(1)
    samples = [wide(generator) for _ in range(5)]
    records = layout.encode_block(Wide.stack(samples))
    assert [layout.encode_sample(sample) for sample in samples] == [r.tobytes() for r in records]
    for sample, record in zip(samples, records, strict=True):
        back: Any = layout.decode_sample(record.tobytes())
        assert back == sample
        back.validate()
        assert back.first.flags.writeable
        assert back.first.flags.aligned


def test_a_long_array_is_looked_at_like_any_other() -> None:
    layout, good = layout_of(Wide), wide(np.random.default_rng(1))
    odd = np.zeros(500)
    odd[7] = np.frombuffer(struct.pack("<Q", 0xFFF8_0000_0000_0001))[0]
    plain = odd.copy()
    plain[7] = np.nan
    assert odd.tobytes() != plain.tobytes()
    found = layout.encode_sample(good.replace(second=odd))
    assert found == layout.encode_sample(good.replace(second=plain))
    whole = good.replace(second=np.arange(500))  # integers become what the field holds
    assert layout.decode_sample(layout.encode_sample(whole)) == whole
    with pytest.raises(MessageError, match=r"^Wide\.second must be a C-contiguous"):
        layout.encode_sample(good.replace(second=np.zeros(499)))
    with pytest.raises(MessageError, match=r"^Wide does not fit its layout"):
        layout.encode_sample(good.replace(code=300))


def test_constants_that_are_equal_but_have_other_bytes_are_kept_apart() -> None:
    default = StreamConstants.of(lf.MagneticField)
    ((path, zeros),) = default.values
    negative = StreamConstants(default.frame_id, ((path, tuple(-z for z in zeros)),))
    assert negative == default
    records = {
        layout_of(lf.MagneticField, c).encode_sample(lf.MagneticField.of(0))
        for c in (default, negative)
    }
    assert len(records) == 2


def test_the_default_constants_of_an_imu_say_that_it_has_no_orientation() -> None:
    constants = dict(StreamConstants.of(lf.Imu).values)
    assert constants["orientation_covariance"] == (-1.0, *[0.0] * 8)
    assert [constants[f"orientation.{axis}"] for axis in "xyzw"] == [0, 0, 0, 1]
    assert StreamConstants.of(lf.Imu).frame_id == "body"


def test_a_field_may_be_called_as_a_member_of_the_stamp() -> None:
    class Odd(Message, ros="lodeflow_cdr_test/msg/Odd"):
        """Has fields that are named as parts of the header."""

        sec: lf.UInt32
        nanosec: lf.Scalar
        frame_id: lf.UInt8

    layout = layout_of(Odd)
    block = Odd(np.array([10**9 + 7]), np.array([4]), np.array([0.5]), np.array([9]))
    assert layout.decode_block(layout.encode_block(block)) == block
    assert layout.encode_sample(block.row(0)) == layout.encode_block(block).tobytes()


@pytest.mark.parametrize("t", [FIRST_STAMP - 1, LAST_STAMP + 1])
def test_a_stamp_beyond_ros_time_is_refused(t: int) -> None:
    layout = layout_of(lf.Heading)
    with pytest.raises(MessageError, match="Heading does not fit its layout"):
        layout.encode_sample(lf.Heading(t, 0.0))
    with pytest.raises(MessageError, match="Heading: a stamp is outside the range of ROS time"):
        layout.encode_block(lf.Heading(np.array([0, t]), np.zeros(2)))


@pytest.mark.parametrize("mode", [-1, 256])
def test_an_integer_out_of_range_is_refused(mode: int) -> None:
    layout = layout_of(lf.Mode)
    with pytest.raises(MessageError, match="Mode does not fit its layout"):
        layout.encode_sample(lf.Mode(0, mode))
    with pytest.raises(MessageError, match=r"Mode\.mode must be from 0 to 255"):
        layout.encode_block(lf.Mode(np.arange(2), np.array([0, mode])))


def test_a_float_for_an_integer_is_refused() -> None:
    with pytest.raises(MessageError, match="Mode does not fit its layout"):
        layout_of(lf.Mode).encode_sample(lf.Mode(0, 1.5))


def test_a_value_of_another_shape_is_refused() -> None:
    layout = layout_of(lf.MagneticField)
    with pytest.raises(MessageError, match="MagneticField does not fit its layout"):
        layout.encode_sample(lf.MagneticField(0, np.zeros(4)))
    with pytest.raises(MessageError, match=r"MagneticField\.magnetic_field must be a C-contiguous"):
        layout.encode_block(lf.MagneticField(np.arange(3), np.zeros((3, 1))))


@given(st.data())
@SETTINGS
def test_truncated_records_are_refused(data: Any) -> None:
    kind = data.draw(st.sampled_from(oracle.BUNDLED))
    layout = layout_of(kind)
    record = layout.encode_sample(data.draw(oracle.samples(kind)))
    cut = record[: data.draw(st.integers(0, len(record) - 1))]
    with pytest.raises(MessageError, match=kind.__name__):
        read_constants(kind, cut)
    with pytest.raises(MessageError, match=kind.__name__):
        layout.decode_sample(cut)


@given(st.binary(max_size=400), st.booleans())
@settings(SETTINGS, max_examples=300)
def test_foreign_bytes_are_refused_or_read_but_nothing_else(noise: bytes, headed: bool) -> None:
    record = b"\x00\x01\x00\x00" * headed + noise
    for kind in (lf.Imu, lf.Mode):
        try:
            constants = read_constants(kind, record)
        except MessageError:
            continue
        assert len(record) == layout_of(kind, constants).size


def test_texts_of_refused_records() -> None:
    layout = layout_of(lf.Heading)
    record = layout.encode_sample(lf.Heading(0, 1.0))
    big = b"\x00\x00" + record[2:]
    with pytest.raises(MessageError, match=r"^Heading: not plain little-endian CDR$"):
        read_constants(lf.Heading, big)
    with pytest.raises(MessageError, match=r"^Heading: not plain little-endian CDR$"):
        layout.decode_sample(big)
    with pytest.raises(MessageError, match=r"^Heading: 1 bytes too many$"):
        read_constants(lf.Heading, record + b"\0")
    with pytest.raises(MessageError, match=r"^Heading: truncated at heading$"):
        read_constants(lf.Heading, record[:-1])
    with pytest.raises(MessageError, match=r"^Heading: truncated at header.frame_id$"):
        read_constants(lf.Heading, record[:18])
    with pytest.raises(MessageError, match=r"^Heading: records of \(1, 35\) are not \(N, 36\) b"):
        layout.decode_sample(record[:-1])
    with pytest.raises(MessageError, match=r"are not \(N, 36\) bytes$"):
        layout.decode_block(np.frombuffer(record, dtype=np.uint8))
    with pytest.raises(MessageError, match=r"are not \(N, 36\) bytes$"):
        layout.decode_block(np.zeros((2, 36), dtype=np.int8))


def test_one_big_endian_record_among_many_is_found() -> None:
    layout = layout_of(lf.Heading)
    records = layout.encode_block(lf.Heading(np.arange(3), np.zeros(3)))
    records[1, 1] = 0
    with pytest.raises(MessageError, match="not plain little-endian CDR"):
        layout.decode_block(records)


def test_decoded_columns_do_not_depend_on_how_the_records_lie() -> None:
    layout = layout_of(lf.Imu)
    wide = np.zeros((6, layout.size + 3), dtype=np.uint8)
    block = lf.Imu(np.arange(6), np.ones((6, 3)), np.zeros((6, 3)))
    layout.encode_block(block, wide[:, 1:-2])
    decoded = layout.decode_block(wide[::2, 1:-2])
    decoded.validate()
    assert decoded == block[::2]
    assert all(column.flags.owndata for column in (decoded.t, *decoded.values()))


def test_a_type_whose_first_message_comes_from_elsewhere() -> None:
    class Unmade(lf.Message, ros="test_cdr_msgs/msg/Unmade"):
        field: lf.Vector3[lf.Tesla]
        count: lf.UInt32

    record = bytes.fromhex("0001000002000000010000000100000000000000")
    record += struct.pack("<3dI", 1.0, 2.0, 3.0, 7)
    sample = layout_of(Unmade).decode_sample(record)
    assert sample.t == 2_000_000_001
    assert sample == Unmade(2_000_000_001, np.array([1.0, 2.0, 3.0]), 7)
    assert sample.replace(count=8).values()[1] == 8


@pytest.mark.parametrize("kind", [lf.Imu, Wide], ids=lambda kind: kind.__name__)
def test_arrays_of_a_decoded_sample_are_as_those_of_any_other(kind: type[Message]) -> None:
    sample = layout_of(kind).decode_sample(layout_of(kind).encode_sample(kind.of(1)))
    sample.validate()
    for field in kind.fields:
        if field.shape:
            assert getattr(sample, field.name).flags.aligned
            assert getattr(sample, field.name).flags.writeable


@pytest.mark.parametrize(
    "broken", [None, [1.0, 2.0, 3.0], np.zeros((3, 1)), np.zeros(2), np.array(["a", "b", "c"])]
)
def test_what_is_no_vector_is_refused_as_a_message(broken: Any) -> None:
    with pytest.raises(MessageError, match="RawRate does not fit"):
        layout_of(lf.RawRate).encode_sample(lf.RawRate(1, broken))
