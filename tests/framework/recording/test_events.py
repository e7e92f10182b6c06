"""Events of a run: stamps that a recording can hold."""

from __future__ import annotations

from lodeflow.messages.cdr import LAST_STAMP
from lodeflow.recording.events import in_range
from lodeflow.sync import END, NEVER


def test_a_gap_from_before_all_messages_can_be_written() -> None:
    """A sender that crashed before its first message: MCAP has no negative times."""
    assert in_range(NEVER) == 0
    assert in_range(END) == LAST_STAMP
    assert in_range(7) == 7
