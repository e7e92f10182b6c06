"""What is said of a run at its end."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from lodeflow.errors import LodeflowError
from lodeflow.graph.model import Wire
from lodeflow.messages.message import Message
from lodeflow.runtime.plan import Counters


@dataclass
class Summary:
    """What a run did.

    Attributes:
        graph: its name.
        counters: per node.
        scores: last score of each stream of scores, by stream name.
        recording: the file, if one was written.
        wall: seconds that the run took.
        span: event time reached from the first stamp on, in seconds.
        stopped: it was told to stop before its sources ended.
        lossless: no source lost a message that the graph does not allow to lose.
        error: what ended it early.
        links: what each link between processes lost, by the group that counted it and its peer.
        restarts: how often each process group was started again.
    """

    graph: str
    counters: dict[str, Counters] = field(default_factory=dict)
    scores: dict[str, Message] = field(default_factory=dict)
    recording: Path | None = None
    wall: float = 0.0
    span: float = 0.0
    stopped: bool = False
    lossless: bool = True
    error: LodeflowError | None = None
    links: dict[str, dict[str, dict[str, int]]] = field(default_factory=dict)
    restarts: dict[str, int] = field(default_factory=dict)

    @property
    def exit_code(self) -> int:
        """0 good, 1 failed or lost data, 130 stopped by Ctrl-C."""
        if self.error is not None or not self.lossless:
            return 1
        return 130 if self.stopped else 0

    def as_dict(self) -> dict[str, Any]:
        """Return the summary as plain data fit for JSON: scores in SI units, null for NaN."""
        return {
            "graph": self.graph,
            "streams": {
                str(Wire(node, port)): count
                for node, counters in self.counters.items()
                for port, count in counters.sent.items()
            },
            "nodes": {
                name: {
                    "stepped": c.stepped,
                    "unmatched": c.unmatched,
                    "gated": c.gated,
                    "lost": dict(c.lost),
                }
                for name, c in self.counters.items()
            },
            "scores": {
                name: {"t": score.t}
                | {
                    key: _plain(value)
                    for key, value in zip(score.field_names, score.values(), strict=True)
                }
                for name, score in self.scores.items()
            },
            "recording": None if self.recording is None else str(self.recording),
            "wall_seconds": self.wall,
            "event_seconds": self.span,
            "stopped": self.stopped,
            "lossless": self.lossless,
            "error": None if self.error is None else str(self.error),
            **({"links": self.links} if self.links else {}),
            **({"restarts": self.restarts} if self.restarts else {}),
        }


def _plain(value: Any) -> Any:
    """Return a field as numbers and lists, None for what JSON has no number for."""
    if isinstance(value, np.ndarray):
        return [_plain(item) for item in value.tolist()]
    if isinstance(value, list):
        return [_plain(item) for item in value]
    return value if math.isfinite(value) else None
