"""What a comparison of two recordings has found."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any


@dataclass(frozen=True)
class Difference:
    """The first place where two streams differ.

    Attributes:
        number: of the message in its stream, counted from 0; in B's if A lacks the message.
        t: its stamp, ns.
        field: component that differs; "" where one of the two lacks the message.
        a: value in A; None if A lacks the message.
        b: value in B; None if B lacks the message.
        unit: of both values.
    """

    number: int
    t: int
    field: str
    a: Any
    b: Any
    unit: str = ""

    def __str__(self) -> str:
        place = f"message {self.number}, t={self.t} ns"
        if not self.field:
            return f"{place}: only in {'B' if self.a is None else 'A'}"
        unit = f" {self.unit}" if self.unit else ""
        return f"{place}: {self.field} is {self.a!r} in A, {self.b!r} in B{unit}"


@dataclass
class Largest:
    """How far a field of two streams is apart.

    Attributes:
        value: largest absolute difference over all components and shared messages.
        t: stamp of the message that has it, ns.
        unit: of the value.
        unknown: messages where only one of the two has a number, and the other NaN.
    """

    value: float
    t: int
    unit: str
    unknown: int = 0

    def __str__(self) -> str:
        text = f"{self.value:.6g} {self.unit}".rstrip() + f" at t={self.t} ns"
        return text + (f", NaN in only one in {self.unknown}" if self.unknown else "")


@dataclass
class StreamComparison:
    """Two streams of one topic.

    Attributes:
        topic: the topic.
        types: names of the types in A and B, "" where there is no such stream.
        counts: messages in A and B.
        problem: why the messages were not compared; "" if they were.
        paired: "stamp", or "number" where log times do not strictly increase.
        shared: messages that are in both.
        lone: messages that are only in A, and only in B.
        unequal: shared messages whose bytes differ.
        beyond: shared messages that differ by more than the tolerance.
        first: the first difference beyond the tolerance.
        largest: by field, where bytes differ and the type is known.
    """

    topic: str
    types: tuple[str, str]
    counts: tuple[int, int]
    problem: str = ""
    paired: str = "stamp"
    shared: int = 0
    lone: list[int] = field(default_factory=lambda: [0, 0])
    unequal: int = 0
    beyond: int = 0
    first: Difference | None = None
    largest: dict[str, Largest] = field(default_factory=dict)

    @property
    def same(self) -> bool:
        """Whether both hold the same messages, within the tolerance."""
        return not (self.problem or self.beyond or any(self.lone))

    @property
    def verdict(self) -> str:
        """The result in one or two words."""
        if self.problem:
            return self.problem
        if not self.same:
            return "differs"
        return "within tolerance" if self.unequal else "equal"

    def as_dict(self) -> dict[str, Any]:
        """Return plain data fit for JSON."""
        first = self.first
        return {
            "same": self.same,
            "verdict": self.verdict,
            "types": list(self.types),
            "counts": list(self.counts),
            "paired_by": self.paired,
            "shared": self.shared,
            "only_in": list(self.lone),
            "unequal": self.unequal,
            "beyond_tolerance": self.beyond,
            "first_difference": None
            if first is None
            else {
                "message": first.number,
                "t": first.t,
                "field": first.field or None,
                "a": _plain(first.a),
                "b": _plain(first.b),
                "unit": first.unit,
            },
            "largest_difference": {
                name: {
                    "value": _plain(found.value),
                    "unit": found.unit,
                    "t": found.t,
                    "nan_in_one": found.unknown,
                }
                for name, found in self.largest.items()
            },
        }


@dataclass
class Comparison:
    """Two recordings.

    Attributes:
        a: first file.
        b: second file.
        streams: by topic, in the order of A and then of B.
        notes: what may explain a difference, such as other CPU features.
    """

    a: Path
    b: Path
    streams: dict[str, StreamComparison] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)

    @property
    def same(self) -> bool:
        """Whether they are the same recording, within the tolerance."""
        return all(stream.same for stream in self.streams.values())

    def as_dict(self) -> dict[str, Any]:
        """Return plain data fit for JSON; null for what JSON has no number for."""
        return {
            "same": self.same,
            "a": str(self.a),
            "b": str(self.b),
            "streams": {topic: found.as_dict() for topic, found in self.streams.items()},
            "notes": self.notes,
        }


def _plain(value: Any) -> Any:
    return None if isinstance(value, float) and not math.isfinite(value) else value
