"""What a link lost: counted where it happened, and written into the recording."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass
from typing import NamedTuple

from lodeflow.graph.model import Wire


@dataclass
class LinkLosses:
    """Counters of what came, or did not come, over one link.

    Attributes:
        gaps: stretches of streams that did not arrive, after a crash of the sender.
        restarts: how often the sender began anew.
        repeated: messages that a restarted sender computed again, and that had arrived before.
        undecodable: frames that did not hold what they should.
        missed: messages that were not sent to a group which only watches, because it was behind.
    """

    gaps: int = 0
    restarts: int = 0
    repeated: int = 0
    undecodable: int = 0
    missed: int = 0

    @property
    def is_lossless(self) -> bool:
        """Whether everything arrived that was to."""
        return not (self.gaps or self.restarts or self.undecodable)

    def as_dict(self) -> dict[str, int]:
        """Return the counters as plain data."""
        return asdict(self)


class Gap(NamedTuple):
    """A stretch of a stream that did not arrive at a group.

    Attributes:
        wire: the stream.
        reader: the group that did not get it.
        sender: the group that owed it.
        since: first stamp that is missing, ns.
        until: first stamp that is there again, ns; END if none is.
    """

    wire: Wire
    reader: str
    sender: str
    since: int
    until: int

    def as_json(self) -> str:
        """Return the gap as a text for the recorder."""
        return json.dumps(
            {
                "gap": {
                    "stream": str(self.wire),
                    "reader": self.reader,
                    "sender": self.sender,
                    "from": self.since,
                    "to": self.until,
                }
            }
        )
