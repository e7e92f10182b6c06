"""Recover: files cut off and damaged, against what the mcap package finds in them."""

import json
import struct

import pytest
from mcap.reader import make_reader
from recordings import HEADING, IMU, columns, is_good, of_package, records, write

from lodeflow.errors import RecordingError
from lodeflow.recording.mcap.records import MAGIC, PREFIX, Op
from lodeflow.recording.reader import Recording
from lodeflow.recording.recover import recover


@pytest.fixture
def path(tmp_path):
    return tmp_path / "run.mcap"


@pytest.fixture
def out(tmp_path):
    return tmp_path / "out.mcap"


@pytest.mark.parametrize("compression", ["zstd", "lz4", ""])
def test_a_file_cut_off_anywhere_keeps_all_that_is_whole(path, out, compression):
    complete = write(path, compression=compression).read_bytes()
    everything, whole = of_package(path), list(records(complete))
    chunks = [(start, end) for op, start, end in whole if op == Op.CHUNK]
    assert len(chunks) > 5
    header = whole[0][2]
    cuts = {header, *(place for _, start, end in whole for place in (start, end - 1))}
    for cut in sorted(cut for cut in {*cuts, *range(header, len(complete), 501)} if cut >= header):
        path.write_bytes(complete[:cut])
        out.unlink(missing_ok=True)
        found = recover(path, out)
        assert path.read_bytes() == complete[:cut]
        assert found.out == out
        assert (
            found.tail == cut - max(end for _, _, end in whole if end <= cut) or cut > whole[-1][2]
        )
        assert (found.damage, found.lost) == ([], {})
        kept = of_package(out)
        count = sum(end <= cut for _, end in chunks)
        assert {t: len(messages) for t, messages in kept.items()} == found.kept
        assert all(messages == everything[t][: len(messages)] for t, messages in kept.items())
        with out.open("rb") as file:
            assert len(make_reader(file).get_summary().chunk_indexes) == count
        if count == len(chunks):
            assert kept == everything
        with Recording(out) as recording:
            if cut >= whole[1][2]:
                assert recording.metadata("lodeflow.provenance") == {"graph": "test"}
            if cut >= whole[2][2]:
                assert recording.attachment("graph.yaml") == b"nodes: {}\n"
            said = json.loads(recording.metadata("lodeflow.recovery")["report"])
            assert said["lost_bytes_at_end"] == found.tail
        if found.kept:
            assert found.reached == max((m[-1][0] for m in kept.values() if m), default=None)


def test_the_mended_file_is_good_and_holds_the_same_chunks(path, out):
    data = write(path, closed=False).read_bytes()
    recover(path, out)
    is_good(out)
    assert columns(out) == {"/heading": HEADING, "/imu": IMU}
    mended = out.read_bytes()
    assert all(data[start:end] in mended for op, start, end in records(data) if op == Op.CHUNK)


def test_where_each_stream_ends_is_said(path, out):
    data = write(path, closed=False).read_bytes()
    ends = [end for op, _, end in records(data) if op == Op.CHUNK]
    path.write_bytes(data[: ends[len(ends) // 2] + 1])
    found = recover(path, out)
    kept = of_package(out)
    assert found.until == {topic: messages[-1][0] for topic, messages in kept.items()}
    assert found.begun == 0
    assert 0 < found.reached < 598


def test_a_whole_file_is_told_so_and_nothing_is_written(path, out):
    write(path)
    out.write_bytes(b"precious")
    for target in (None, out, path):
        found = recover(path, target)
        assert (found.out, found.kept) == (None, {"/heading": 300, "/imu": 100})
    assert out.read_bytes() == b"precious"
    assert sorted(path.parent.iterdir()) == [out, path]


def test_the_name_of_the_new_file(path, tmp_path):
    write(path, closed=False)
    assert recover(path).out == tmp_path / "run.recovered.mcap"
    other = tmp_path / "run.v1"
    path.rename(other)
    assert recover(other).out == tmp_path / "run.v1.recovered.mcap"


def test_an_existing_file_is_never_overwritten(path, out):
    write(path, closed=False)
    out.write_bytes(b"precious")
    for target in (out, path):
        before = target.read_bytes()
        with pytest.raises(RecordingError, match=r"\.mcap: exists; remove it or choose another"):
            recover(path, target)
        assert target.read_bytes() == before


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "is empty"),
        (b"t,x,y\n0,1,2\n", "is no MCAP file"),
        (b"\x89PNG\r\n\x1a\n" * 20, "is no MCAP file"),
        (MAGIC[:5], "ends within its header"),
        (MAGIC, "ends within its header"),
        (MAGIC + b"\x01\x11\0\0", "ends within its header"),
        (MAGIC + bytes(5000), "ends within its header"),
    ],
)
def test_files_without_anything_to_keep(path, out, content, message):
    path.write_bytes(content)
    with pytest.raises(RecordingError, match=rf"run\.mcap: {message}"):
        recover(path, out)
    assert not out.exists()


def test_no_file(tmp_path, out):
    with pytest.raises(RecordingError, match=r"nothing\.mcap: cannot be read: No such file"):
        recover(tmp_path / "nothing.mcap", out)
    with pytest.raises(RecordingError, match="cannot be read: Is a directory"):
        recover(tmp_path, out)


# Damage in the middle.


@pytest.mark.parametrize("closed", [True, False])
@pytest.mark.parametrize("compression", ["zstd", "lz4", ""])
def test_any_wrong_byte_costs_one_chunk_at_most(path, out, compression, closed):
    write(path, compression=compression)
    everything = of_package(path)
    write(path.with_name("other.mcap"), compression=compression, closed=closed)
    data = path.with_name("other.mcap").read_bytes()
    most = 3000 // 60
    for place in range(len(MAGIC), len(data), max(7, len(data) // 150)):
        path.write_bytes(data[:place] + bytes([data[place] ^ 0x41]) + data[place + 1 :])
        out.unlink(missing_ok=True)
        found = recover(path, out)
        kept = of_package(path if found.out is None else out)
        if not closed and kept.keys() != everything.keys():
            continue  # the byte is in a channel or schema, and nothing repeats it
        lost = 0
        for topic, messages in kept.items():
            assert set(messages) <= set(everything[topic])
            assert sorted(messages) == messages
            lost += len(everything[topic]) - len(messages)
        assert lost <= most
        assert bool(lost) <= bool(found.damage or found.tail)
        assert sum(found.lost.values()) <= lost


def test_a_damaged_chunk_is_lost_and_its_messages_are_counted(path, out):
    data = bytearray(write(path, closed=False).read_bytes())
    chunks = [(start, end) for op, start, end in records(data) if op == Op.CHUNK]
    start, end = chunks[2]
    data[(start + end) // 2] ^= 1
    path.write_bytes(data)
    found = recover(path, out)
    (damage,) = found.damage
    assert (damage.start, damage.size) == (start, end - start)
    assert damage.what.startswith("a chunk that ")
    assert found.tail == 0
    kept = of_package(out)
    for topic, count in {"/heading": 300, "/imu": 100}.items():
        assert len(kept[topic]) + found.lost.get(topic, 0) == count
    assert sum(found.lost.values()) > 10


def test_a_wrong_length_hides_no_more_than_its_own_record(path, out):
    write(path)
    everything = of_package(path)
    data = write(path.with_name("b.mcap"), closed=False).read_bytes()
    for op, start, _ in records(data):
        if op in (Op.CHUNK, Op.MESSAGE_INDEX):
            for wrong in (0, 3, 1 << 20, 1 << 63):
                head = PREFIX.pack(op, wrong)
                path.write_bytes(data[:start] + head + data[start + len(head) :])
                out.unlink(missing_ok=True)
                found = recover(path, out)
                lost = sum(map(len, everything.values())) - sum(found.kept.values())
                assert (lost > 0) == (op == Op.CHUNK)
                assert lost < 60


def test_messages_of_a_channel_that_is_lost_are_counted_and_left_out(path, out):
    data = bytearray(write(path, closed=False).read_bytes())
    start = next(start for op, start, _ in records(data) if op == Op.CHANNEL)
    data[start] = 0xFF
    path.write_bytes(data)
    found = recover(path, out)
    assert found.kept == {"/imu": 100}
    assert found.lost == {"channel 1": 300}
    assert columns(out) == {"/imu": IMU}
    is_good(out)


def test_what_is_lost_at_the_start_is_taken_from_the_summary(path, out):
    data = bytearray(write(path).read_bytes())
    starts = [start for op, start, _ in records(data) if op in (Op.SCHEMA, Op.CHANNEL)]
    for start in starts[:4]:
        data[start] = 0xFF
    path.write_bytes(data)
    found = recover(path, out)
    assert found.kept == {"/heading": 300, "/imu": 100}
    assert columns(out) == {"/heading": HEADING, "/imu": IMU}
    is_good(out)


@pytest.mark.parametrize("junk", [b"\0", b"junk" * 5000, MAGIC, "another"])
def test_what_is_behind_the_end_is_left_out(path, out, junk):
    data = write(path).read_bytes()
    if junk == "another":
        junk = write(path.with_name("b.mcap"), compression="").read_bytes()
    path.write_bytes(data + junk)
    found = recover(path, out)
    assert (found.tail, found.damage, found.lost) == (len(junk), [], {})
    assert columns(out) == {"/heading": HEADING, "/imu": IMU}
    is_good(out)


def test_zeros_in_the_middle_as_a_disk_leaves_them(path, out):
    data = bytearray(write(path).read_bytes())
    half = len(data) // 3
    data[half : half + 4096] = bytes(4096)
    path.write_bytes(data)
    found = recover(path, out)
    assert 0 < sum(found.kept.values()) < 400
    assert found.damage
    is_good(out)


def test_lz4_without_its_package_is_said_and_not_taken_for_damage(path, out, monkeypatch):
    write(path, compression="lz4", closed=False)
    monkeypatch.setitem(__import__("sys").modules, "lz4.frame", None)
    with pytest.raises(
        RecordingError, match=r"chunk at byte \d+ cannot be read here: it needs the"
    ):
        recover(path, out)
    assert not out.exists()


def test_a_chunk_whose_frame_is_wrong_though_its_data_is_right_is_packed_anew(path, out):
    data = bytearray(write(path, compression="lz4").read_bytes())
    everything = of_package(path)
    start = data.index(b"lz4") + 3 + 8
    assert data[start : start + 4] == b"\x04\x22\x4d\x18"
    end = next(end for op, _, end in records(bytes(data)) if op == Op.CHUNK)
    data[end - 4 : end] = b"\1\0\0\0"  # a block that is not there, for the mark of the end
    path.write_bytes(data)
    found = recover(path, out)
    assert (found.damage, found.lost, found.tail) == ([], {}, 0)
    assert of_package(out) == everything
    is_good(out)


def test_a_chunk_that_claims_to_be_huge_is_not_believed(path, out):
    data = bytearray(write(path, compression="zstd", closed=False).read_bytes())
    start = next(start for op, start, _ in records(data) if op == Op.CHUNK)
    struct.pack_into("<Q", data, start + PREFIX.size + 16, 1 << 29)
    path.write_bytes(data)
    assert len(recover(path, out).damage) == 1
