"""Streams of recordings as whole columns: found by type, chosen by name, put one after another."""

from __future__ import annotations

import numpy as np
import pytest
from recordings import random_block, record

from lodeflow.errors import RecordingError
from lodeflow.messages.vocabulary import Heading, Imu
from lodeflow.node import InputPort
from lodeflow.recording.whole import GAP, read_whole

PORTS = (InputPort("heading", Heading, False), InputPort("imu", Imu, True))
T = np.arange(100, 400, 10)


def written(path, **streams):
    record(path, {f"/{name}": random_block(kind, t) for name, (kind, t) in streams.items()})
    return path


def test_the_only_stream_of_a_type_is_taken(tmp_path):
    path = written(tmp_path / "a.mcap", one=(Heading, T), two=(Imu, T + 3))
    found = read_whole([path], PORTS, {})
    assert found.blocks["heading"].t.tolist() == T.tolist()
    assert found.blocks["imu"].t.tolist() == (T + 3).tolist()
    assert found.used == [{"heading": ("/one", 30), "imu": ("/two", 30)}]


def test_an_optional_stream_may_be_absent_or_left_out(tmp_path):
    path = written(tmp_path / "a.mcap", one=(Heading, T))
    assert read_whole([path], PORTS, {}).blocks["imu"] is None
    both = written(tmp_path / "b.mcap", one=(Heading, T), two=(Imu, T))
    assert read_whole([both], PORTS, {"imu": ""}).blocks["imu"] is None


def test_one_of_several_is_chosen_by_name(tmp_path):
    path = written(tmp_path / "a.mcap", one=(Heading, T), two=(Heading, T + 1))
    with pytest.raises(RecordingError, match=r"2 streams .* --stream heading=one or --stream"):
        read_whole([path], PORTS, {})
    assert read_whole([path], PORTS, {"heading": "two"}).blocks["heading"].t[0] == 101
    with pytest.raises(RecordingError, match="no topic '/tow', did you mean '/two'"):
        read_whole([path], PORTS, {"heading": "tow"})


def test_recordings_follow_one_another(tmp_path):
    first = written(tmp_path / "a.mcap", one=(Heading, T), two=(Imu, T + 3))
    later = written(tmp_path / "b.mcap", one=(Heading, T + 1000), two=(Imu, T + 1003))
    found = read_whole([first, later], PORTS, {})
    assert found.blocks["heading"].t.tolist() == [*T, *(T + 1000)]
    found = read_whole([later, first], PORTS, {})
    shift = 1393 + GAP - 100
    assert found.blocks["heading"].t.tolist() == [*(T + 1000), *(T + shift)]
    assert found.blocks["imu"].t.tolist() == [*(T + 1003), *(T + 3 + shift)]


def test_recordings_of_other_streams_are_refused(tmp_path):
    both = written(tmp_path / "a.mcap", one=(Heading, T), two=(Imu, T))
    one = written(tmp_path / "b.mcap", one=(Heading, T))
    with pytest.raises(RecordingError, match=r"a.mcap has a stream for 'imu', and .*b.mcap has no"):
        read_whole([both, one], PORTS, {})


def test_what_is_not_there_is_told(tmp_path):
    path = written(tmp_path / "a.mcap", two=(Imu, T))
    with pytest.raises(RecordingError, match=r"no stream of Heading for 'heading' .*two"):
        read_whole([path], PORTS, {})
    with pytest.raises(RecordingError, match="reads no 'headin', did you mean 'heading'"):
        read_whole([path], PORTS, {"headin": "two"})
