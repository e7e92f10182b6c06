"""What an onlooker makes of puts: decoded, or counted for what they are."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import lodeflow as lf
from lodeflow.errors import MessageError
from lodeflow.messages.cdr import StreamConstants, layout_of
from lodeflow.sync import END, NEVER
from lodeflow.transport import frame as frames
from lodeflow.transport.onlooker import Sighting
from lodeflow.transport.viewing import StreamView, decode

KEY = "lodeflow/g/n/out"
ENCODING = f"application/cdr;{lf.Heading.ros}"


def headings(*t: int) -> lf.Heading:
    return lf.Heading(np.array(t, dtype=np.int64), np.array(t, dtype=float) / 10)


def put(number: int, *t: int, encoding: str = ENCODING, key: str = KEY) -> Sighting:
    payload = layout_of(lf.Heading).encode_block(headings(*t)).tobytes()
    frame = frames.read(frames.head_of(number, t[0], t[-1] + 1, len(t), 0, 0, 0), payload)
    return Sighting(key, 0.0, encoding, payload, frame)


def test_puts_are_decoded_by_the_type_in_their_encoding() -> None:
    view = StreamView(KEY)
    assert view.see(put(4, 1, 2, 3))
    assert view.read(put(4, 1, 2, 3)) == headings(1, 2, 3)
    assert (view.type, view.puts, view.rows) == (lf.Heading.ros, 1, 3)


@pytest.mark.parametrize(
    ("numbers", "missed", "anew"),
    [
        ([0, 1, 2], 0, 0),
        ([70, 71, 72], 0, 0),
        ([3, 5, 6, 10], 4, 0),
        ([8, 9, 0, 1], 0, 1),
        ([8, 9, 0, 2], 1, 1),
        ([5, 5], 0, 1),
    ],
)
def test_gaps_count_from_the_first_put_that_came(
    numbers: list[int], missed: int, anew: int
) -> None:
    view = StreamView(KEY)
    for number in numbers:
        view.see(put(number, 1))
    assert (view.missed, view.begun_anew, view.puts) == (missed, anew, len(numbers))


def test_the_end_of_a_stream_is_no_message() -> None:
    view = StreamView(KEY)
    view.see(put(0, 1))
    end = frames.read(frames.head_of(1, NEVER, END, 0, 0, 0, 0), b"")
    assert not view.see(Sighting(KEY, 0.0, ENCODING, b"", end))
    assert view.ended
    assert view.rows == 1
    assert view.see(put(0, 1))
    assert not view.ended


def test_a_type_that_is_not_known_is_counted_and_not_read() -> None:
    view = StreamView(KEY)
    sighting = put(0, 1, 2, encoding="application/cdr;other_msgs/msg/Thing")
    assert view.see(sighting)
    assert view.read(sighting) is None
    assert (view.rows, view.undecodable) == (2, 0)


def test_a_payload_that_is_not_what_its_type_says_is_counted() -> None:
    view = StreamView(KEY)
    sighting = put(0, 1, 2, encoding=f"application/cdr;{lf.Imu.ros}")
    assert view.see(sighting)
    assert view.read(sighting) is None
    assert view.undecodable == 1


@given(
    attachment=st.binary(max_size=40),
    payload=st.binary(max_size=200),
    encoding=st.sampled_from([ENCODING, "zenoh/bytes", "", f"application/cdr;{lf.Imu.ros}"]),
)
def test_garbage_is_counted_and_harms_nothing(
    attachment: bytes, payload: bytes, encoding: str
) -> None:
    view = StreamView(KEY)
    view.see(put(6, 1))
    garbage = Sighting(KEY, 0.0, encoding, payload, frames.read(attachment, payload))
    if view.see(garbage):
        view.read(garbage)
    else:
        assert view.foreign == 1 or view.ended
        assert view.missed == 0
    assert view.see(put(7, 2))


def test_other_programs_need_no_attachment_on_keys_of_their_own() -> None:
    key = "robot/1/heading"
    constants = StreamConstants("a longer frame than ours")
    payload = layout_of(lf.Heading, constants).encode_block(headings(5)).tobytes()
    view = StreamView(key)
    sighting = Sighting(key, 0.0, ENCODING, payload, None)
    assert view.see(sighting)
    assert view.read(sighting) == headings(5)
    ours = StreamView(KEY)
    assert not ours.see(Sighting(KEY, 0.0, ENCODING, payload, None))
    assert ours.foreign == 1


@pytest.mark.parametrize("cut", [0, 1, 3, 10, 27])
def test_a_truncated_payload_is_refused(cut: int) -> None:
    payload = layout_of(lf.Heading).encode_block(headings(5)).tobytes()
    with pytest.raises(MessageError, match="Heading"):
        decode(lf.Heading, payload[:cut], 1)
