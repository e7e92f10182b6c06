"""Everything that lodeflow raises on purpose.

LodeflowError
├── MessageError        a message type is declared wrongly, or data does not fit its type
├── NodeError           a plugin class cannot be used: its name, file and the offending argument
├── GraphError          a graph file does not check; holds every problem found
├── RunError            a run could not go on
│   ├── NodeFailure     a plugin raised: node, stamp, inputs, and the exception
│   └── ContractError   a node broke a rule of event time
├── RecordingError      a recording cannot be written or read
└── CalibrationError    recorded data do not determine what a calibration asks for
"""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Sequence


class LodeflowError(Exception):
    """Root of all errors that lodeflow raises on purpose; `str()` is fit to show to a user."""


class MessageError(LodeflowError):
    """A message type is declared wrongly, or a value does not fit its declared shape or unit."""


class NodeError(LodeflowError):
    """A plugin class cannot be used; the text names the class, its file and the argument."""


class GraphError(LodeflowError):
    """A graph does not check.

    Attributes:
        problems: one printed text per mistake, each with its place.
    """

    def __init__(self, problems: Sequence[str]) -> None:
        super().__init__(tuple(problems))  # as it was called, so that it can be pickled
        self.problems = tuple(problems)

    def __str__(self) -> str:
        return "\n".join(self.problems)


class RunError(LodeflowError):
    """A run could not start or go on."""


class NodeFailure(RunError):
    """A plugin raised while it handled data; the original exception is `__cause__`."""


class ContractError(RunError):
    """A node broke a rule of event time; the text names the node and the rule."""


class RecordingError(LodeflowError):
    """A recording cannot be written or read; the text names the file and what to do."""


class CalibrationError(LodeflowError):
    """Data do not determine a calibration; the text says what is wrong, and what to record."""


def did_you_mean(word: str, known: Iterable[str]) -> str:
    """Return ", did you mean 'x'?" for the nearest known word, or "" where none is near."""
    by_folded = {name.casefold(): name for name in known}
    near = difflib.get_close_matches(word.casefold(), by_folded, n=1, cutoff=0.6)
    return f", did you mean '{by_folded[near[0]]}'?" if near else ""
