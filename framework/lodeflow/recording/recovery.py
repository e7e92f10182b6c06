"""What came of a damaged recording."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any


@dataclass(frozen=True)
class Damage:
    """Bytes that could not be kept.

    Attributes:
        start: where in the damaged file.
        size: how many.
        what: what they are, and what is wrong with them.
    """

    start: int
    size: int
    what: str


@dataclass
class Recovery:
    """What came of a file.

    Attributes:
        source: the damaged file, untouched.
        out: the new file; None if there was nothing to mend.
        kept: messages by topic.
        lost: messages by topic of which it is known that they were lost; there may be more.
        damage: what could not be kept in the middle of the file.
        until: last log time kept of each topic that has messages, ns.
        tail: bytes at its end that are no whole record.
        complete: whether all data was written before, so that of the end only the index is missing.
        begun: first log time, ns; None without messages.
        reached: last log time, ns; None without messages.
    """

    source: Path
    out: Path | None = None
    kept: dict[str, int] = field(default_factory=dict)
    lost: dict[str, int] = field(default_factory=dict)
    damage: list[Damage] = field(default_factory=list)
    until: dict[str, int] = field(default_factory=dict)
    tail: int = 0
    complete: bool = False
    begun: int | None = None
    reached: int | None = None

    def as_dict(self) -> dict[str, Any]:
        """Return plain data fit for JSON."""
        return {
            "source": str(self.source),
            "out": None if self.out is None else str(self.out),
            "kept": self.kept,
            "known_lost": self.lost,
            "damage": [vars(damage) for damage in self.damage],
            "until": self.until,
            "lost_bytes_at_end": self.tail,
            "only_index_missing": self.complete and not self.damage,
            "begun": self.begun,
            "reached": self.reached,
        }
