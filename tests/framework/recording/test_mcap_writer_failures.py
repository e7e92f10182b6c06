"""The writer when things go wrong: killed, interrupted, out of space, used wrongly."""

import io
import json
import os
import struct
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import zstandard
from mcap.exceptions import McapError
from mcap.reader import make_reader
from mcap.records import Message
from mcap.stream_reader import StreamReader

from lodeflow.errors import RecordingError
from lodeflow.recording.mcap import chunk as chunk_module
from lodeflow.recording.mcap import writer as writer_module
from lodeflow.recording.mcap.file import McapFile
from lodeflow.recording.mcap.records import MAGIC, Op
from lodeflow.recording.mcap.writer import McapWriter

STEP = 36  # bytes of a message of `numbered`


def numbered(count, first=0):
    """Return payloads of 5 bytes that all differ: each holds its own number."""
    records = np.zeros((count, 5), dtype=np.uint8)
    records[:, :4] = np.arange(first, first + count, dtype="<u4")[:, None].view(np.uint8)
    return records


def write(writer, channel, first, end):
    """Write messages `first` to `end`; the stamp of each is its number."""
    writer.write(channel, np.arange(first, end), numbered(end - first, first))


def messages(count):
    return [(number, row.tobytes()) for number, row in enumerate(numbered(count))]


def open_channel(writer):
    return writer.channel("/a", "lodeflow_msgs/msg/Test", "float64 x\n")


def ops(data):
    """Return the opcodes of the records; the last one must end where the data ends."""
    found, start = [], len(MAGIC)
    while start < len(data) and data[start:] != MAGIC:
        op, length = struct.unpack_from("<BQ", data, start)
        found.append(Op(op))
        start += 9 + length
    assert start in (len(data), len(data) - len(MAGIC))
    return found


def indexed(path):
    """Return the messages by way of the index, in the order of the file, CRCs checked."""
    with Path(path).open("rb") as file:
        reader = make_reader(file, validate_crcs=True)
        found = reader.iter_messages(log_time_order=False)
        return [(message.log_time, message.data) for _, _, message in found]


def recover(data):
    """Return what a stream reader gets out of a file that was cut off."""
    found = []
    stream = StreamReader(io.BytesIO(data), validate_crcs=True)
    try:
        for record in stream.records:
            if isinstance(record, Message):
                found += [(record.log_time, record.data)]
    except (McapError, zstandard.ZstdError, RuntimeError, struct.error, ValueError, OverflowError):
        pass  # lz4 raises RuntimeError; a wrong CRC is a ValueError
    return found


@pytest.fixture
def path(tmp_path):
    return tmp_path / "out.mcap"


@pytest.mark.parametrize("compression", ["zstd", "lz4", ""])
def test_a_file_cut_anywhere_gives_back_all_whole_chunks(path, compression):
    with McapWriter(path, compression=compression, chunk_bytes=300) as writer:
        writer.metadata("before", {"a": "b"})
        header_end = path.stat().st_size
        write(writer, open_channel(writer), 0, 40)
    with path.open("rb") as file:
        chunks = make_reader(file).get_summary().chunk_indexes
    ends = [chunk.chunk_start_offset + chunk.chunk_length for chunk in chunks]
    assert len(ends) == 5
    data = path.read_bytes()
    for cut in range(header_end, len(data)):
        whole = sum(end <= cut for end in ends)
        assert recover(data[:cut]) == messages(whole * (300 // STEP))


def test_what_was_flushed_is_on_disk_before_close(path):
    with McapWriter(path) as writer:
        writer.metadata("graph", {"text": "nodes"})
        writer.attachment("graph.yaml", "text/yaml", b"nodes")
        assert ops(path.read_bytes()) == [Op.HEADER, Op.METADATA, Op.ATTACHMENT]
        channel = open_channel(writer)
        write(writer, channel, 0, 2)
        assert recover(path.read_bytes()) == []
        writer.flush_chunk()
        assert recover(path.read_bytes()) == messages(2)
        size = path.stat().st_size
        writer.flush_chunk()
        assert path.stat().st_size == size
        write(writer, channel, 2, 3)
    assert indexed(path) == messages(3)


def test_ctrl_c_at_any_line_leaves_a_readable_file_without_loss(tmp_path):
    """Interrupt at each line of the writer in turn, then close, as a `with` block does."""
    files = {writer_module.__file__, chunk_module.__file__}

    def interrupted_at(line):
        count = 0

        def trace(frame, event, argument):
            nonlocal count
            if frame.f_code.co_filename not in files:
                return None
            if event == "line":
                count += 1
                if count == line:
                    sys.settrace(None)
                    raise KeyboardInterrupt
            return trace

        path, sent = tmp_path / f"{line}.mcap", 0
        writer = McapWriter(path, chunk_bytes=5 * STEP)
        channel = open_channel(writer)
        previous = sys.gettrace()
        sys.settrace(trace)
        try:
            for first in range(0, 12, 4):
                write(writer, channel, first, first + 4)
                sent = first + 4
            writer.flush_chunk()
        except KeyboardInterrupt:
            pass
        finally:
            sys.settrace(previous)
            writer.close()
        # Between the chunk on disk and the note that it is there, it may be written once more.
        found, data = list(dict.fromkeys(indexed(path))), path.read_bytes()
        assert found == messages(len(found))
        assert len(found) >= sent
        assert set(recover(data)) == set(found)
        assert ops(data)[-1] == Op.FOOTER
        return count >= line

    line = 1
    while interrupted_at(line):
        line += 1
    assert line > 100  # the trace saw the writer


DISK_FULL = """
import json, resource, signal, sys
import numpy as np
from lodeflow.errors import RecordingError
from lodeflow.recording.mcap.writer import McapWriter

signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
_, most = resource.getrlimit(resource.RLIMIT_FSIZE)


def run(path):
    try:
        writer = McapWriter(path, compression="", chunk_bytes=360)
    except RecordingError as error:
        return ["opening", str(error)]
    stage = "writing"
    try:
        channel = writer.channel("/a", "lodeflow_msgs/msg/Test", "float64 x\\n")
        for number in range(50):
            record = np.frombuffer(number.to_bytes(4, "little") + bytes(1), np.uint8)
            writer.write(channel, np.array([number]), record[None])
        stage = "closing"
        writer.close()
        return ["closed", ""]
    except RecordingError as error:
        writer.close()
        try:
            writer.flush_chunk()
        except RecordingError as again:
            return [stage, str(error), str(again)]


results = []
for limit in json.loads(sys.argv[2]):
    resource.setrlimit(resource.RLIMIT_FSIZE, (limit, most))
    results.append(run(f"{sys.argv[1]}/{limit}.mcap"))
resource.setrlimit(resource.RLIMIT_FSIZE, (most, most))
print(json.dumps(results))
"""


def disk_full(folder, limits):
    """Write 50 messages to a disk with room for each limit; return what the writer said."""
    done = subprocess.run(
        [sys.executable, "-c", DISK_FULL, folder, json.dumps(limits)],
        env={**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))},
        capture_output=True,
        text=True,
        timeout=60,
        check=True,
    )
    assert done.stderr == ""
    return json.loads(done.stdout)


def test_a_full_disk_is_one_clear_error_and_leaves_whole_records(tmp_path):
    pytest.importorskip("resource")
    room = 1 << 20
    assert disk_full(tmp_path, [room]) == [["closed", ""]]
    complete = (tmp_path / f"{room}.mcap").read_bytes()
    assert recover(complete) == messages(50)
    limits = [*range(0, len(complete), 7), len(complete) - 1]
    stages = {}
    for limit, (stage, error, *again) in zip(limits, disk_full(tmp_path, limits), strict=True):
        path = tmp_path / f"{limit}.mcap"
        assert f"{path}: cannot be written: File too large" in error
        closed = "closed and readable" in error
        assert closed is ("mend this file with 'lodeflow recover'" not in error)
        assert all("it stopped at an earlier error (File too large)" in text for text in again)
        left = path.read_bytes()
        assert len(left) <= limit
        if closed:
            with McapFile(path) as file:
                assert sum(file.counts.values()) == len(recover(left))
        else:
            assert complete.startswith(left)
        ops(left or MAGIC)
        stages.setdefault((stage, closed), set()).add(len(recover(left)))
    # A full chunk is written while the next ones fill, or when the recording is closed.
    assert stages["opening", False] == {0}
    assert set().union(*stages.values()) == {0, 10, 20, 30, 40, 50}
    assert any(closed for _, closed in stages)


def test_an_existing_file_is_kept(path):
    path.write_text("precious")
    with pytest.raises(RecordingError, match=r"out\.mcap: exists; remove it or choose another"):
        McapWriter(path)
    assert path.read_text() == "precious"


def test_a_folder_that_does_not_exist(tmp_path):
    with pytest.raises(RecordingError, match=r"No such file.*check that its folder exists"):
        McapWriter(tmp_path / "nowhere" / "out.mcap")


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"compression": "gzip"}, "compression must be 'zstd', 'lz4' or '', not 'gzip'"),
        ({"chunk_bytes": 0}, "chunk_bytes must be 1 to 16777216, not 0"),
        ({"chunk_bytes": 1 << 31}, "chunk_bytes must be 1 to 16777216"),
    ],
)
def test_wrong_options_create_no_file(path, options, message):
    with pytest.raises(RecordingError, match=message):
        McapWriter(path, **options)
    assert not path.exists()


def test_lz4_names_the_package_that_is_missing(path, monkeypatch):
    monkeypatch.setitem(sys.modules, "lz4.frame", None)
    with pytest.raises(RecordingError, match="needs the package lz4; install it or choose 'zstd'"):
        McapWriter(path, compression="lz4")
    McapWriter(path).close()


@pytest.mark.parametrize(
    ("t", "records", "message"),
    [
        (np.array([3, 2, -1]), numbered(3), "row 2: the stamp -1 ns is negative"),
        (np.arange(3.0), numbered(3), r"stamps must be int64 of shape \(N,\), not float64 \(3,\)"),
        (np.zeros((3, 1), np.int64), numbered(3), r"not int64 \(3, 1\)"),
        (np.arange(2), numbered(3), r"uint8 of shape \(2, size\), a row for each stamp, not uint8"),
        (np.arange(3), numbered(3).astype(int), r"not int64 \(3, 5\)"),
        (np.arange(3), numbered(3)[0, :3], r"not uint8 \(3,\)"),
    ],
)
def test_wrong_arrays_are_refused_and_nothing_of_them_is_written(path, t, records, message):
    with McapWriter(path) as writer:
        channel = open_channel(writer)
        write(writer, channel, 0, 2)
        with pytest.raises(RecordingError, match=message) as caught:
            writer.write(channel, t, records)
        assert str(path) in str(caught.value)
        writer.write(channel, np.empty(0, np.int64), numbered(0))
        write(writer, channel, 2, 4)
    assert indexed(path) == messages(4)


def test_an_unknown_channel_and_a_negative_attachment_time(path):
    with McapWriter(path) as writer:
        with pytest.raises(RecordingError, match=r"no channel 3; open it with channel\(\) first"):
            writer.write(3, np.arange(1), numbered(1))
        with pytest.raises(RecordingError, match="attachment 'x': the stamp -5 ns is negative"):
            writer.attachment("x", "", b"", t=-5)


def test_a_closed_recording_takes_no_more(path):
    with McapWriter(path) as writer:
        channel = open_channel(writer)
        write(writer, channel, 0, 1)
        writer.close()
        data = path.read_bytes()
        for call in (
            lambda: write(writer, channel, 1, 2),
            lambda: writer.metadata("a", {}),
            lambda: writer.attachment("a", "", b""),
            lambda: open_channel(writer),
            writer.flush_chunk,
        ):
            with pytest.raises(
                RecordingError, match=r"out\.mcap: takes no more data: it is closed"
            ):
                call()
    assert path.read_bytes() == data
    assert indexed(path) == messages(1)


def test_an_exception_in_the_block_still_closes_the_file(path):
    def fail():
        with McapWriter(path) as writer:
            write(writer, open_channel(writer), 0, 7)
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        fail()
    assert indexed(path) == messages(7)
