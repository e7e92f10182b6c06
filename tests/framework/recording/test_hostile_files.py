"""Files made to ask for more than there is: memory, time, or a way around in circles."""

import tracemalloc

import lz4.frame
import numpy as np
import pytest
import zstandard
from recordings import IMU, columns, write

from lodeflow.errors import LodeflowError, RecordingError
from lodeflow.graph import load_graph_text
from lodeflow.messages.cdr import layout_of
from lodeflow.messages.ros import schema_text
from lodeflow.messages.vocabulary import Imu
from lodeflow.recording.compare import compare
from lodeflow.recording.info import info
from lodeflow.recording.mcap import records as encode
from lodeflow.recording.mcap.records import INDEX_LAYOUT, MAGIC, Op, message_layout
from lodeflow.recording.reader import Recording
from lodeflow.recording.recover import recover
from lodeflow.recording.replay import is_complete, replaying

GIGABYTE = 1 << 30
ROOM = 32 << 20
"""Bytes that reading a small file may take: twice the largest chunk of one."""


class Crafted:
    """Writes a file record by record, and whatever summary one likes."""

    def __init__(self, path):
        self.path = path
        self.data = MAGIC + encode.header("ros2", "someone")
        self.groups = {
            Op.SCHEMA: [encode.schema(1, Imu.ros, "ros2msg", schema_text(Imu).encode())],
            Op.CHANNEL: [encode.channel(1, 1, "/imu", "cdr", {})],
            Op.STATISTICS: [],
            Op.CHUNK_INDEX: [],
            Op.ATTACHMENT_INDEX: [],
            Op.METADATA_INDEX: [],
        }
        self.count = 0
        for op in (Op.SCHEMA, Op.CHANNEL):
            self.data += self.groups[op][0]

    def chunk(self, size, compression, packed, entries, *, count=None, at=None, times=1):
        """Append a chunk with its index; `at` is where its summary says that the index is."""
        start = len(self.data)
        rows = np.array(entries, INDEX_LAYOUT)
        self.data += encode.chunk(0, 10**9, size, 0, compression, packed)
        index_at = len(self.data)
        self.data += encode.message_index(1, rows)
        self.count += len(rows) if count is None else count
        places = {1: index_at if at is None else at}
        length = len(self.data) - index_at
        entry = encode.chunk_index(
            0, 10**9, start, index_at - start, places, length, compression, len(packed), size
        )
        self.groups[Op.CHUNK_INDEX] += [entry] * times

    def metadata(self, name, entries):
        record = encode.metadata(name, entries)
        index = encode.metadata_index(len(self.data), len(record), name)
        self.groups[Op.METADATA_INDEX].append(index)
        self.data += record

    def attachment(self, name, data):
        record = encode.attachment(0, name, "", data)
        index = encode.attachment_index(len(self.data), len(record), 0, len(data), name, "")
        self.groups[Op.ATTACHMENT_INDEX].append(index)
        self.data += record

    def close(self):
        self.groups[Op.STATISTICS] = [encode.statistics(self.groups, 0, 10**9, {1: self.count})]
        self.data += encode.data_end(0)
        self.path.write_bytes(self.data + encode.tail(self.groups, len(self.data)))


@pytest.fixture
def path(tmp_path):
    return tmp_path / "in.mcap"


def message(t=5):
    """Return a message record of IMU."""
    record = layout_of(Imu).encode_block(IMU[:1].replace(t=np.array([t])))
    row = np.zeros(1, message_layout(record.shape[1]))
    row["op"], row["length"], row["channel"] = Op.MESSAGE, row.itemsize - 9, 1
    row["log_time"] = row["publish_time"] = t
    row["data"] = record
    return row.tobytes()


def refused(path, what, *arguments):
    """Call what must be refused, and return why; it may not take much memory."""
    tracemalloc.start()
    try:
        with pytest.raises(RecordingError) as error:
            what(path, *arguments)
        assert tracemalloc.get_traced_memory()[1] < 10 * path.stat().st_size + ROOM
    finally:
        tracemalloc.stop()
    assert str(error.value).startswith(f"{path}: ")
    return str(error.value)


def zeros(compression, size):
    """Return zeros, compressed without ever being there in full."""
    if compression == "lz4":
        pack = lz4.frame.LZ4FrameCompressor()
        step = bytes(1 << 24)
        begin = pack.begin()
        return b"".join([begin, *(pack.compress(step) for _ in range(size >> 24)), pack.flush()])
    pack = zstandard.ZstdCompressor().compressobj(size=size if compression == "zstd" else -1)
    steps = [pack.compress(bytes(1 << 24)) for _ in range(size >> 24)]
    return b"".join([*steps, pack.flush()])


@pytest.mark.parametrize("compression", ["zstd", "zstd without its size", "lz4"])
@pytest.mark.parametrize("declared", [GIGABYTE, 1 << 40, 2**64 - 1, 1000])
def test_a_chunk_that_stands_for_gigabytes_is_not_unpacked(path, compression, declared):
    file = Crafted(path)
    file.chunk(1000, "", message() + bytes(1000 - len(message())), [(5, 0)])
    bomb = zeros(compression, GIGABYTE)
    assert len(bomb) < GIGABYTE >> 7
    file.chunk(declared, compression.split()[0], bomb, [(6, 0)])
    file.close()
    assert info(path).streams["/imu"].count == 2
    why = "the chunk at byte "
    assert why in refused(path, columns)
    assert why in refused(path, compare, path)
    tracemalloc.start()
    found = recover(path)
    assert tracemalloc.get_traced_memory()[1] < 10 * path.stat().st_size + ROOM
    tracemalloc.stop()
    assert found.lost == {"/imu": 1}
    assert len(found.damage) == 2  # the bomb, and a chunk with zeros behind its message


def test_an_index_that_leads_to_one_message_many_times_is_refused(path):
    file = Crafted(path)
    file.chunk(len(message()), "", message(), [(5, 0)] * 100_000)
    file.close()
    assert "the message index is damaged" in refused(path, columns)
    assert "the message index is damaged" in refused(path, compare, path)
    assert recover(path).kept == {"/imu": 1}


def test_messages_that_lie_over_each_other_are_refused(path):
    inner = message(7)
    outer = bytearray(message(5))
    outer[40 : 40 + 31] = inner[:31]
    file = Crafted(path)
    file.chunk(len(outer) + 400, "", bytes(outer) + bytes(400), [(5, 0), (7, 40)])
    file.close()
    assert "the message index is damaged" in refused(path, columns)


def test_chunks_that_lie_over_each_other_are_refused(path):
    file = Crafted(path)
    file.chunk(len(message()), "", message(), [(5, 0)], times=1000, count=1000)
    file.close()
    for what in (columns, info):
        assert "its summary is damaged: the chunk at byte" in refused(path, what)
    assert recover(path).kept == {"/imu": 1}


@pytest.mark.parametrize("at", [0, 8, 2**63, 2**64 - 1])
def test_an_index_elsewhere_is_refused(path, at):
    file = Crafted(path)
    file.chunk(len(message()), "", message(), [(5, 0)], at=at)
    file.close()
    for what in (columns, info):
        assert "the message index of the chunk at byte" in refused(path, what)
    assert recover(path).kept == {"/imu": 1}


def test_a_summary_that_is_the_data_is_not_unpacked(path):
    file = Crafted(path)
    file.chunk(GIGABYTE, "zstd", zeros("zstd", GIGABYTE), [(5, 0)])
    file.close()
    data = bytearray(path.read_bytes())
    data[-28:-20] = (8).to_bytes(8, "little")  # the summary begins with the header
    data[-12:-8] = bytes(4)  # and has no CRC
    path.write_bytes(data)
    for what in (columns, info):
        refused(path, what)


@pytest.mark.parametrize("length", [2**31, 2**62, 2**64 - 1])
def test_a_record_longer_than_the_file_is_refused(path, length):
    write(path)
    data = path.read_bytes()
    at = data.index(b"lodeflow.provenance") - 13
    path.write_bytes(data[: at + 1] + length.to_bytes(8, "little") + data[at + 9 :])
    with Recording(path) as recording, pytest.raises(RecordingError, match="should be a metadata"):
        recording.metadata("lodeflow.provenance")
    assert recover(path).damage


DEEP = "[" * 100_000


def test_texts_of_any_depth_do_no_harm(path):
    write(path)
    file = Crafted(path)
    file.metadata("lodeflow.provenance", {"args": DEEP, "versions": DEEP})
    file.metadata("lodeflow.summary", {"summary": DEEP})
    file.metadata("lodeflow.recovery", {"report": DEEP})
    file.attachment("graph.yaml", DEEP.encode())
    file.close()
    found = info(path)
    assert (found.losses, found.recovery) == (None, None)
    assert compare(path, path).same
    with Recording(path) as recording:
        assert not is_complete(recording)
        with pytest.raises(LodeflowError):
            replaying(load_graph_text(recording.attachment("graph.yaml").decode()), recording)


def test_a_graph_that_grows_by_its_aliases_does_no_harm(path):
    lines = ["a0: &a0 [x, x, x, x, x, x, x, x, x]"]
    lines += [f"a{n}: &a{n} [{', '.join([f'*a{n - 1}'] * 9)}]" for n in range(1, 12)]
    text = "lodeflow: 1\nname: n\nnodes: {}\n" + "\n".join(lines) + "\n"
    with pytest.raises(LodeflowError):
        load_graph_text(text)
