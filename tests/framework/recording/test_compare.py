"""Compare against the mcap package's view of the same files, and what it says of differences."""

import json
import math
import tempfile
import tracemalloc
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from recordings import of_package, random_block, record

from lodeflow.errors import MessageError, RecordingError
from lodeflow.messages.vocabulary import AttitudeTruth, Heading, Imu, MagneticField, Mode
from lodeflow.recording import compare as module
from lodeflow.recording.compare import compare

KINDS = [Imu, MagneticField, AttitudeTruth, Mode, Heading]


@pytest.fixture
def two(tmp_path):
    """Return the comparison of two recordings, given as blocks by topic."""

    def compared(a, b, *, options=None, **arguments):
        paths = [tmp_path / "a.mcap", tmp_path / "b.mcap"]
        for path, blocks in zip(paths, (a, b), strict=True):
            path.unlink(missing_ok=True)
            record(path, blocks, **(options or {}))
        return compare(*paths, **arguments)

    return compared


def changed(block, field, row, value):
    column = getattr(block, field).copy()
    column[row] = value
    return block.replace(**{field: column})


IMU = random_block(Imu, range(0, 4000, 10))


@settings(max_examples=60, deadline=None)
@given(
    kinds=st.lists(st.sampled_from(KINDS), min_size=1, max_size=4),
    seed=st.integers(0, 10**6),
    change=st.sampled_from(["none", "bit", "less", "more", "stamp"]),
    held=st.sampled_from([1, 3000, 1 << 24]),
)
def test_the_same_is_what_the_mcap_package_reads_alike(kinds, seed, change, held):
    random = np.random.default_rng(seed)
    blocks = {}
    for number, kind in enumerate(kinds):
        t = np.cumsum(random.integers(1, 20, random.integers(1, 40)))
        blocks[f"/{number}"] = random_block(kind, t, seed)
    other = dict(blocks)
    topic = f"/{random.integers(len(kinds))}"
    block, row = blocks[topic], int(random.integers(len(blocks[topic])))
    field = block.fields[0]
    if change == "bit":
        column = getattr(block, field.name).copy()
        column[row] = column[row] + 1 if field.integer else np.nextafter(column[row], 9)
        other[topic] = block.replace(**{field.name: column})
    elif change == "less":
        other[topic] = block[np.arange(len(block)) != row]
    elif change == "more":
        late = block[-1:].replace(t=block.t[-1:] + 7)
        other[topic] = type(block).concat([block, late])
    elif change == "stamp":
        t = block.t.copy()
        t[-1] += 1
        row, other[topic] = len(t) - 1, block.replace(t=t)
    with tempfile.TemporaryDirectory() as folder, pytest.MonkeyPatch.context() as patch:
        patch.setattr(module, "HELD", held)
        a = record(Path(folder, "a.mcap"), blocks, cuts=seed, chunk_bytes=700)
        b = record(Path(folder, "b.mcap"), other, cuts=seed + 1, chunk_bytes=1900)
        found = compare(a, b)
        alike = {name: of_package(a)[name] == of_package(b)[name] for name in blocks}
    assert {name: stream.same for name, stream in found.streams.items()} == alike
    assert found.same == (change == "none")
    if change != "none":
        first = found.streams[topic].first
        number = len(block) if change == "more" else row
        assert first.number == number
        assert bool(first.field) == (change == "bit")
        assert first.t == (block.t[-1] + 7 if change == "more" else block.t[row])


def test_chunks_compression_order_provenance_and_logs_do_not_count(tmp_path):
    blocks = {"/imu": IMU, "/mag": random_block(MagneticField, range(5, 4000, 10))}
    a = record(tmp_path / "a.mcap", blocks, provenance={"cpu_features": "A"}, chunk_bytes=5000)
    reverse = dict(reversed(blocks.items()))
    b = record(
        tmp_path / "b.mcap",
        {**reverse, "/rosout": random_block(Mode, range(3))},
        cuts=1,
        compression="lz4",
        chunk_bytes=7777,
    )
    found = compare(a, b)
    assert found.same
    assert not found.notes
    assert {topic: stream.verdict for topic, stream in found.streams.items()} == {
        "/imu": "equal",
        "/mag": "equal",
    }
    assert found.streams["/imu"].counts == (400, 400)
    assert found.streams["/imu"].shared == 400


def test_the_first_difference_and_the_largest(two):
    other = changed(IMU, "linear_acceleration", (7, 2), IMU.linear_acceleration[7, 2] + 0.5)
    other = changed(other, "linear_acceleration", (9, 0), IMU.linear_acceleration[9, 0] - 2)
    stream = two({"/imu": IMU}, {"/imu": other}).streams["/imu"]
    first = stream.first
    assert (first.number, first.t, first.field, first.unit) == (
        7,
        70,
        "linear_acceleration.z",
        "m/s²",
    )
    assert (first.a, first.b) == (
        IMU.linear_acceleration[7, 2],
        IMU.linear_acceleration[7, 2] + 0.5,
    )
    assert (stream.shared, stream.unequal, stream.beyond) == (400, 2, 2)
    largest = stream.largest["linear_acceleration"]
    assert largest.value == pytest.approx(2.0)
    assert (largest.t, largest.unit) == (90, "m/s²")
    assert stream.largest["angular_velocity"].value == 0
    assert "message 7, t=70 ns: linear_acceleration.z is" in str(first)


def test_messages_that_are_in_one_only(two):
    without = IMU[np.arange(400) % 100 != 50]
    later = IMU[200:]
    stream = two({"/imu": IMU}, {"/imu": without}).streams["/imu"]
    assert stream.lone == [4, 0]
    assert (stream.first.number, stream.first.t) == (50, 500)
    assert str(stream.first) == "message 50, t=500 ns: only in A"
    stream = two({"/imu": later}, {"/imu": IMU}).streams["/imu"]
    assert (stream.lone, stream.shared, stream.unequal) == ([0, 200], 200, 0)
    assert str(stream.first) == "message 0, t=0 ns: only in B"
    stream = two({"/imu": IMU[:0]}, {"/imu": IMU}).streams["/imu"]
    assert (stream.lone, stream.shared, stream.counts) == ([0, 400], 0, (0, 400))


def test_streams_that_are_in_one_only(two):
    found = two({"/imu": IMU, "/a": IMU}, {"/imu": IMU, "/b": IMU})
    assert {topic: stream.verdict for topic, stream in found.streams.items()} == {
        "/imu": "equal",
        "/a": "only in A",
        "/b": "only in B",
    }
    assert not found.same
    assert two({"/imu": IMU, "/a": IMU}, {"/imu": IMU, "/b": IMU}, streams=["/imu"]).same
    with pytest.raises(RecordingError, match=r"neither .* has a stream '/imo', did you mean '/imu"):
        two({"/imu": IMU}, {"/imu": IMU}, streams=["/imo"])


def test_a_tolerance_for_all_fields_and_for_one(two):
    other = changed(IMU, "angular_velocity", (3, 1), IMU.angular_velocity[3, 1] + 1e-6)
    pair = {"/imu": IMU}, {"/imu": other}
    assert not two(*pair).same
    assert not two(*pair, tolerance=0.5e-6).same
    found = two(*pair, tolerance=2e-6).streams["/imu"]
    assert (found.verdict, found.unequal, found.beyond, found.first) == (
        "within tolerance",
        1,
        0,
        None,
    )
    assert found.largest["angular_velocity"].value == pytest.approx(1e-6)
    for name in ("imu.angular_velocity", "/imu.angular_velocity"):
        assert two(*pair, tolerances={name: "1e-4 deg/s"}).same
        assert two(*pair, tolerances={name: 2e-6}).same
    assert not two(*pair, tolerances={"imu.linear_acceleration": 1.0}).same


@pytest.mark.parametrize(
    ("tolerances", "message"),
    [
        ({"imu.angular_velocit": 1}, r"no such float field .* did you mean 'imu.angular_velocity'"),
        ({"imo.angular_velocity": 1}, r"did you mean 'imu.angular_velocity'"),
        ({"imu.angular_velocity": "1 deg"}, r"tolerance imu.angular_velocity: 'deg' is not a unit"),
        ({"imu.angular_velocity": -1}, "-1 is below zero"),
        ({"imu.angular_velocity": math.nan}, "nan is below zero"),
    ],
)
def test_a_wrong_tolerance_is_refused(two, tolerances, message):
    with pytest.raises(MessageError, match=message):
        two({"/imu": IMU}, {"/imu": IMU}, tolerances=tolerances)


def test_a_tolerance_is_for_floats_alone(two):
    mode = random_block(Mode, range(9))
    other = changed(mode, "mode", 4, mode.mode[4] + 1)
    stream = two({"/mode": mode}, {"/mode": other}, tolerance=10).streams["/mode"]
    assert (stream.first.field, stream.first.number) == ("mode", 4)
    assert stream.first.b - stream.first.a == 1


def test_nan_equals_nan_and_no_number(two):
    truth = random_block(AttitudeTruth, range(20))
    gap = changed(truth, "quaternion", 5, math.nan)
    assert two({"/truth": gap}, {"/truth": gap}).same
    stream = two({"/truth": gap}, {"/truth": truth}, tolerance=1e9).streams["/truth"]
    assert (stream.beyond, stream.first.field, stream.first.number) == (1, "quaternion.x", 5)
    assert math.isnan(stream.first.a)
    assert stream.largest["quaternion"].unknown == 1
    both = changed(gap, "quaternion", (7, 3), gap.quaternion[7, 3] + 0.25)
    stream = two({"/truth": gap}, {"/truth": both}, tolerance=0.5).streams["/truth"]
    assert stream.same
    assert stream.largest["quaternion"].value == pytest.approx(0.25)


def test_the_sign_of_zero_is_a_bit_and_within_any_tolerance(two):
    zero = Heading(np.arange(3), np.zeros(3))
    pair = {"/h": zero}, {"/h": zero.replace(heading=np.array([0.0, -0.0, 0.0]))}
    assert two(*pair).streams["/h"].first.number == 1
    assert two(*pair, tolerance=0).same


def test_another_type_under_the_same_name(two):
    found = two({"/x": random_block(Heading, range(4))}, {"/x": random_block(Mode, range(4))})
    assert found.streams["/x"].verdict == "another type"
    assert found.streams["/x"].types == (Heading.ros, Mode.ros)


def test_everything_that_is_found_fits_into_json(two):
    truth = random_block(AttitudeTruth, range(20))
    gap = changed(truth, "quaternion", 5, math.nan)
    found = two({"/truth": gap, "/a": IMU}, {"/truth": truth, "/b": IMU}).as_dict()
    plain = json.loads(json.dumps(found, allow_nan=False))
    assert plain["same"] is False
    assert plain["streams"]["/truth"]["first_difference"]["a"] is None
    assert plain["streams"]["/a"]["verdict"] == "only in A"


def test_memory_does_not_grow_with_the_files(tmp_path, monkeypatch):
    """Even if one file has its streams one after the other, and the other in reverse."""
    monkeypatch.setattr(module, "HELD", 200_000)
    t = np.arange(40_000)
    blocks = {f"/{n}": Heading(t, np.full(len(t), float(n))) for n in range(6)}
    a = record(tmp_path / "a.mcap", blocks, chunk_bytes=50_000)
    b = record(tmp_path / "b.mcap", dict(reversed(blocks.items())), chunk_bytes=70_000)
    compare(a, b)
    tracemalloc.start()
    assert compare(a, b).same
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < 4_000_000  # the messages take 18 MB in either


def test_a_damaged_file_is_named(tmp_path):
    a = record(tmp_path / "a.mcap", {"/imu": IMU}, compression="")
    data = bytearray(a.read_bytes())
    data[data.index(b"body") + 60] ^= 1
    b = tmp_path / "b.mcap"
    b.write_bytes(data)
    with pytest.raises(RecordingError, match=r"b\.mcap: the chunk at byte \d+ is damaged: its CRC"):
        compare(a, b)
