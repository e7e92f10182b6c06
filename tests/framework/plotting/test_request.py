"""From names to panels."""

import numpy as np
import pytest
from recordings import random_block, record

import lodeflow as lf
from lodeflow.errors import RecordingError
from lodeflow.messages.vocabulary import EulerAngles, Mode, RawField
from lodeflow.plotting.request import Request
from lodeflow.recording.reader import Recording

STREAMS = {
    "/vehicle/imu": lf.Imu,
    "/imu": lf.Imu,
    "/compass/attitude": lf.Attitude,
    "/compass/euler": EulerAngles,
    "/fuser": lf.Attitude,
    "/heading": lf.Heading,
    "/mode": Mode,
    "/raw/mag": RawField,
}


def make(path, streams):
    return record(path, {t: random_block(k, np.arange(1, 9)) for t, k in streams.items()})


@pytest.fixture
def request_of(tmp_path):
    opened = []

    def make_request(*recordings, si=False, euler=False):
        paths = [make(tmp_path / f"{len(opened)}{i}.mcap", s) for i, s in enumerate(recordings)]
        opened.extend(Recording(path) for path in paths)
        return Request(opened[-len(paths) :], si=si, euler=euler)

    yield make_request
    for recording in opened:
        recording.close()


def shown(panels):
    return {
        panel.title: [
            f"{line.recording}:{line.stream}.{line.quantity.name}" for line in panel.lines
        ]
        for panel in panels
    }


def test_a_stream_a_field_a_component(request_of):
    request = request_of(STREAMS)
    assert shown(request.panels(["vehicle.imu"])) == {
        "angular_velocity": [f"0:vehicle.imu.angular_velocity.{axis}" for axis in "xyz"],
        "linear_acceleration": [f"0:vehicle.imu.linear_acceleration.{axis}" for axis in "xyz"],
    }
    assert shown(request.panels(["/vehicle/imu.angular_velocity"])) == {
        "angular_velocity": [f"0:vehicle.imu.angular_velocity.{axis}" for axis in "xyz"]
    }
    assert shown(request.panels(["vehicle.imu.angular_velocity.y"])) == {
        "angular_velocity.y": ["0:vehicle.imu.angular_velocity.y"]
    }
    assert not request.notes


def test_equal_fields_share_a_panel_and_vectors_of_two_streams_one_for_each_component(request_of):
    panels = request_of(STREAMS).panels(["heading", "fuser.heading", "compass.euler.heading"])
    assert shown(panels) == {
        "heading": ["0:heading.heading", "0:fuser.heading", "0:compass.euler.heading"]
    }
    panels = request_of(STREAMS).panels(["imu.angular_velocity", "vehicle.imu.angular_velocity"])
    assert shown(panels) == {
        f"angular_velocity.{axis}": [
            f"0:{s}.angular_velocity.{axis}" for s in ("imu", "vehicle.imu")
        ]
        for axis in "xyz"
    }


def test_recordings_lie_over_each_other_and_what_one_lacks_is_noted(request_of):
    request = request_of(STREAMS, {"/heading": lf.Heading}, {"/other": lf.Heading})
    assert shown(request.panels(["heading"])) == {
        "heading": ["0:heading.heading", "1:heading.heading"]
    }
    (note,) = request.notes
    assert note.endswith(": no 'heading'")


def test_the_longest_name_of_a_stream_wins(request_of):
    request = request_of({"/a": EulerAngles, "/a/heading": lf.Heading})
    assert shown(request.panels(["a.heading"])) == {"heading": ["0:a.heading.heading"]}
    assert shown(request.panels(["a.pitch"])) == {"pitch": ["0:a.pitch"]}


def test_quaternions_as_euler_angles(request_of):
    panels = request_of(STREAMS, euler=True).panels(["fuser"])
    assert shown(panels) == {name: [f"0:fuser.{name}"] for name in ("heading", "pitch", "roll")}


def test_the_overview_tells_what_matters(request_of):
    request = request_of(STREAMS)
    assert shown(request.overview()) == {
        "heading": ["0:compass.euler.heading", "0:fuser.heading", "0:heading.heading"],
        "pitch": ["0:compass.euler.pitch", "0:fuser.pitch"],
        "roll": ["0:compass.euler.roll", "0:fuser.roll"],
        "mode": ["0:mode.mode"],
        "angular_velocity": [f"0:vehicle.imu.angular_velocity.{axis}" for axis in "xyz"],
        "linear_acceleration": [f"0:vehicle.imu.linear_acceleration.{axis}" for axis in "xyz"],
    }
    assert request.notes == [
        "not shown: imu, compass.attitude, raw.mag (name what you want to see)"
    ]


def test_the_overview_shows_everything_where_nothing_is_known(request_of):
    assert list(shown(request_of({"/raw/mag": RawField}).overview())) == ["counts"]


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("fusr", "no stream 'fusr', did you mean 'fuser'?"),
        ("vehicle.imu.angular_velocty", "'vehicle.imu' has no 'angular_velocty', did you mean"),
        ("heading.pitch", r"'heading' has no 'pitch'.*it has: heading"),
        ("vehicl.imu.angular_velocity.x", "did you mean 'vehicle.imu.angular_velocity.x'"),
        ("imu.angular_velocity.q", "'imu' has no 'angular_velocity.q'"),
    ],
)
def test_a_wrong_name_is_told_with_what_was_meant(request_of, name, said):
    with pytest.raises(RecordingError, match=said):
        request_of(STREAMS).panels(["heading", name])
