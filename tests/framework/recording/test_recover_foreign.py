"""Recover on files that others wrote, which lack what readers of columns need."""

import pytest
from mcap.reader import make_reader
from mcap.writer import CompressionType, IndexType
from recordings import HEADING, IMU, WANTED, columns, foreign, is_good, records

from lodeflow.errors import RecordingError
from lodeflow.recording.mcap.records import Op
from lodeflow.recording.recover import recover


@pytest.fixture
def path(tmp_path):
    return tmp_path / "run.mcap"


@pytest.fixture
def out(tmp_path):
    return tmp_path / "out.mcap"


@pytest.mark.parametrize("compression", list(CompressionType))
def test_a_good_file_of_the_mcap_package_is_whole(path, out, compression):
    foreign(path, compression=compression)
    assert recover(path, out).out is None


@pytest.mark.parametrize(
    "options",
    [
        {"use_chunking": False},
        {"index_types": IndexType.ALL & ~IndexType.MESSAGE},
        {"use_statistics": False},
        {"repeat_channels": False},
        {"repeat_schemas": False},
        {
            "use_chunking": False,
            "use_statistics": False,
            "repeat_channels": False,
            "repeat_schemas": False,
            "use_summary_offsets": False,
        },
        {"enable_crcs": False, "index_types": IndexType.NONE},
    ],
    ids=lambda options: "-".join(options),
)
def test_a_file_that_lacks_what_columns_need_is_made_readable(path, out, options):
    foreign(path, **options)
    with pytest.raises(RecordingError, match=r"; mend it with: lodeflow recover .*run\.mcap"):
        columns(path)
    found = recover(path, out)
    assert (found.damage, found.tail, found.lost) == ([], 0, {})
    assert columns(out) == {"/heading": HEADING, "/imu": IMU}
    is_good(out)
    with out.open("rb") as file:
        reader = make_reader(file, validate_crcs=True)
        assert reader.get_header().library == "someone"
        summary = reader.get_summary()
        assert {c.topic: c.metadata for c in summary.channels.values()} == {
            topic: {"qos": "µ"} for topic in WANTED
        }
        (attachment,) = reader.iter_attachments()
        assert (attachment.data, attachment.log_time, attachment.create_time) == (b"pixels", 4, 5)
        assert summary.attachment_indexes[0].create_time == 5
        notes = [m for m in reader.iter_metadata() if m.name == "note"]
        assert [m.metadata for m in notes] == [{"weather": "rain"}]


@pytest.mark.parametrize("compression", list(CompressionType))
def test_a_killed_file_with_its_definitions_inside_of_chunks(path, out, compression):
    foreign(path, compression=compression)
    data = path.read_bytes()
    ends = [end for op, _, end in records(data) if op == Op.CHUNK]
    path.write_bytes(data[: ends[8] + 10])
    found = recover(path, out)
    assert found.tail == 10
    kept = columns(out)["/heading"]
    assert kept == HEADING[: len(kept)]
    assert len(kept) == found.kept["/heading"] > 100
    is_good(out)
