"""What is read for a figure, and what is drawn of it."""

import numpy as np
import pytest
from recordings import record

import lodeflow as lf
from lodeflow.errors import RecordingError
from lodeflow.messages.vocabulary import Mode
from lodeflow.plotting import figure
from lodeflow.plotting.read import read
from lodeflow.plotting.request import Request
from lodeflow.recording.reader import Recording

SECOND = 1_000_000_000
DAY = 86400 * SECOND


def headings(start=0, count=100):
    t = start + np.arange(count) * SECOND // 10
    return lf.Heading(t, np.mod(np.arange(count) * 0.1, 2 * np.pi))


def modes(start=0):
    return Mode(start + np.arange(4) * 2 * SECOND, np.array([1, 1, 2, 1]))


def drawn(paths, names, start=None, end=None):
    recordings = [Recording(path) for path in paths]
    try:
        request = Request(recordings, si=False, euler=False)
        panels = request.panels(names)
        found = read(recordings, panels, start, end)
    finally:
        for recording in recordings:
            recording.close()
    return figure.draw(panels, found, [path.stem for path in paths]), found


def texts(on):
    return [text.get_text() for text in on.get_texts()]


def test_a_line_in_degrees_that_ends_where_the_angle_wraps(tmp_path):
    path = record(tmp_path / "a.mcap", {"/heading": headings()})
    made, _ = drawn([path], ["heading"])
    (axis,) = made.axes
    (line,) = axis.lines
    t, values = line.get_data()
    assert np.isnan(values).sum() == 1
    assert np.nanmax(np.abs(np.diff(values))) < 10
    assert np.allclose(values[np.isfinite(values)], np.degrees(headings().heading))
    assert (t[0], t[-1]) == (0.0, 9.9)
    assert axis.get_title(loc="left") == "heading"
    assert axis.get_ylabel() == "°"
    assert axis.get_xlabel() == "time (s)"
    assert axis.yaxis.get_major_locator()().tolist()[1] % 45 == 0


def test_a_mode_is_shaded_behind_every_panel_and_named(tmp_path):
    path = record(tmp_path / "a.mcap", {"/heading": headings(), "/mode": modes()})
    made, found = drawn([path], ["heading", "mode"])
    (axis,) = made.axes
    spans = {
        tuple(extent.intervalx.tolist())
        for shade in axis.collections
        for extent in (piece.get_extents() for piece in shade.get_paths())
    }
    assert spans == {(0.0, 4.0), (4.0, 6.0), (6.0, found.end / SECOND)}
    (legend,) = made.legends
    assert texts(legend) == ["compass", "gyro"]


def test_a_mode_holds_on_from_before_the_left_edge(tmp_path):
    path = record(tmp_path / "a.mcap", {"/heading": headings(), "/mode": modes()})
    made, _ = drawn([path], ["heading", "mode"], 4.5, 5.5)
    assert made.axes[0].get_xlim() == (4.5, 5.5)
    assert texts(made.legends[0]) == ["compass", "gyro"]
    (line,) = made.axes[0].lines
    assert line.get_xdata().tolist() == pytest.approx(np.arange(4.5, 5.45, 0.1).tolist())


def test_modes_of_several_recordings_have_strips_of_their_own(tmp_path):
    streams = {"/heading": headings(), "/mode": modes()}
    paths = [record(tmp_path / f"{name}.mcap", streams) for name in "ab"]
    made, _ = drawn(paths, ["heading", "mode"])
    assert [axis.get_title(loc="left") for axis in made.axes] == ["heading", "mode", "mode"]
    assert texts(made.axes[0].get_legend()) == ["heading · a", "heading · b"]
    assert len({line.get_color() for line in made.axes[0].lines}) == 2


@pytest.mark.parametrize(
    ("second", "starts", "label"),
    [
        (SECOND, (0.0, 1.0), "time (s)"),
        (DAY, (0.0, 0.0), "time since the start of each recording (s)"),
    ],
)
def test_recordings_of_other_days_lie_over_each_other(tmp_path, second, starts, label):
    paths = [
        record(tmp_path / f"{start}.mcap", {"/heading": headings(start)}) for start in (0, second)
    ]
    made, _ = drawn(paths, ["heading"])
    assert tuple(line.get_xdata()[0] for line in made.axes[0].lines) == starts
    assert made.axes[0].get_xlabel() == label


def test_stamps_of_a_clock_are_told_by_its_date(tmp_path):
    path = record(tmp_path / "a.mcap", {"/heading": headings(1_700_000_000 * SECOND)})
    made, _ = drawn([path], ["heading"])
    assert made.axes[0].get_xlabel() == "time since 2023-11-14 22:13:20 UTC (s)"
    assert made.axes[0].lines[0].get_xdata()[0] == 0


def test_long_recordings_count_in_hours(tmp_path):
    t = np.arange(0, 5 * 3600 * SECOND, 60 * SECOND)
    path = record(tmp_path / "a.mcap", {"/heading": lf.Heading(t, np.zeros(len(t)))})
    made, _ = drawn([path], ["heading"])
    assert made.axes[0].get_xlabel() == "time (h)"
    assert made.axes[0].lines[0].get_xdata()[-1] == pytest.approx(5 - 1 / 60)


def test_colours_of_components_and_a_legend(tmp_path):
    t = np.arange(100) * SECOND
    imu = lf.Imu(t, np.ones((100, 3)), np.zeros((100, 3)))
    made, _ = drawn([record(tmp_path / "a.mcap", {"/imu": imu})], ["imu"])
    assert [texts(axis.get_legend()) for axis in made.axes] == [["x", "y", "z"]] * 2
    assert [axis.get_ylabel() for axis in made.axes] == ["°/s", "m/s²"]


def test_what_is_not_there_is_told(tmp_path):
    path = record(tmp_path / "a.mcap", {"/heading": headings()})
    with pytest.raises(RecordingError, match=r"from 20 to 30 s; there are 9\.9 s of data"):
        drawn([path], ["heading"], 20.0, 30.0)
    empty = record(tmp_path / "b.mcap", {"/heading": headings(count=0)})
    with pytest.raises(RecordingError, match=r"b\.mcap: nothing to draw, it has no messages"):
        drawn([empty], ["heading"])


def test_all_formats_are_written_with_the_same_bytes_each_time(tmp_path):
    path = record(tmp_path / "a.mcap", {"/heading": headings(), "/mode": modes()})
    for name, magic in (("a.png", b"\x89PNG"), ("a.svg", b"<?xml"), ("new/a.pdf", b"%PDF")):
        written = []
        for _ in range(2):
            made, _ = drawn([path], ["heading", "mode"])
            figure.write(made, tmp_path / name)
            written.append((tmp_path / name).read_bytes())
        assert written[0].startswith(magic)
        assert written[0] == written[1]


@pytest.mark.parametrize(
    ("name", "said"), [("a.pgn", "did you mean 'png'"), ("a", "a name without suffix")]
)
def test_an_unknown_format_is_told(name, said, tmp_path):
    with pytest.raises(RecordingError, match=said):
        figure.format_of(tmp_path / name)
