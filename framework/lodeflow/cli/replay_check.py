"""What `lodeflow replay --check` says."""

from __future__ import annotations

from pathlib import Path
from typing import Any, NamedTuple

from rich.text import Text

from lodeflow.cli.output import RESULT, STATUS, print_json, table
from lodeflow.graph import Wire, order
from lodeflow.recording.comparison import Comparison, StreamComparison
from lodeflow.recording.reader import Recording
from lodeflow.recording.recorder import topic
from lodeflow.recording.replay import Replay, is_complete, last_stamps
from lodeflow.supervisor.summary import Summary


class Checked(NamedTuple):
    """A replay, and how it compares.

    Attributes:
        path: the recording that was replayed.
        replay: how.
        summary: of the replay.
        compared: the recording (A) and the replay (B), the streams that are in both.
    """

    path: Path
    replay: Replay
    summary: Summary
    compared: Comparison

    def streams(self) -> dict[Wire, StreamComparison]:
        """Return the streams in the order of computation: the first that differs is the cause."""
        places = {name: place for place, name in enumerate(order(self.replay.graph.nodes)[0])}
        wires = [w for w in self.replay.recomputed if topic(w) in self.compared.streams]
        wires.sort(key=lambda wire: places[wire.node])
        return {wire: self.compared.streams[topic(wire)] for wire in wires}


def report_check(checked: Checked, *, as_json: bool) -> int:
    """Print whether each stream is the same, and where the first difference is; return the code."""
    streams = checked.streams()
    differing = [wire for wire, found in streams.items() if not found.same]
    notes = list(checked.compared.notes)
    if unknown := [wire for wire in checked.replay.recomputed if wire not in streams]:
        notes.append(f"not recorded, so not checked: {', '.join(map(str, unknown))}")
    with Recording(checked.path) as recording:
        if differing and not is_complete(recording):
            notes.append(_killed(checked))
    if as_json:
        print_json(_as_dict(checked, streams, differing, notes))
    else:
        rows = table("stream", ">recorded", ">computed", "")
        for wire, found in streams.items():
            rows.add_row(str(wire), *map(str, found.counts), found.verdict)
        RESULT.print(rows)
        RESULT.print()
        for line in (
            *(f"{wire}: {tell(streams[wire])}" for wire in differing),
            *notes,
            f"not the same: '{differing[0]}' is the first of {len(differing)} that differ"
            if differing
            else f"equal to the byte: {len(streams)} streams computed anew",
        ):
            RESULT.print(line, soft_wrap=True, markup=False)
    if checked.summary.error is not None:
        STATUS.print(Text(f"lodeflow: {checked.summary.error}", style="red"), soft_wrap=True)
    return 1 if differing or checked.summary.error is not None else 0


def tell(found: StreamComparison) -> str:
    """Return how a stream that was computed anew compares to the recorded one."""
    if found.problem or found.same or found.first is None:
        return found.verdict
    first, (recorded, computed) = found.first, found.lone
    if first.field:
        unit = f" {first.unit}" if first.unit else ""
        return (
            f"differs at t={first.t} ns (message {first.number}): {first.field} was recorded as "
            f"{first.a!r}{unit}, is computed as {first.b!r}{unit}"
        )
    if not found.unequal and first.number == found.shared and not (recorded and computed):
        if computed:
            return f"equal to the end of the recording, then {computed} more from t={first.t} ns"
        return f"equal to the end of the replay; {recorded} more are recorded from t={first.t} ns"
    where = "computed" if first.a is None else "recorded"
    return f"differs at t={first.t} ns (message {first.number}): only {where}"


def _killed(checked: Checked) -> str:
    """Return what is to be expected of a recording that was not closed by its run."""
    fed = checked.replay.fed
    ends = ", ".join(f"{w} t={t} ns" for w, t in last_stamps(checked.path, fed).items())
    return (
        f"{checked.path} was not ended by its run, which was killed or could not write: the last "
        "messages of each stream may be missing. What was fed ends at: "
        f"{ends or 'nowhere, it is empty'}"
    )


def _as_dict(
    checked: Checked,
    streams: dict[Wire, StreamComparison],
    differing: list[Wire],
    notes: list[str],
) -> dict[str, Any]:
    return {
        "same": not differing,
        "first": str(differing[0]) if differing else None,
        "streams": {
            str(wire): {"message": tell(found)} | found.as_dict() for wire, found in streams.items()
        },
        "notes": notes,
        "replay": checked.summary.as_dict(),
    }
