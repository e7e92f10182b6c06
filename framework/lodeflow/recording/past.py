"""What befell a recorded run beside its data: changes while it ran, and gaps. Replay repeats it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

from lodeflow.errors import RecordingError, did_you_mean
from lodeflow.graph import Graph, GraphNode, Wire
from lodeflow.graph.changes import with_change
from lodeflow.graph.groups import RECORDER
from lodeflow.recording.events import CHANGE, GAP, EventKind, RecordedGap, in_range
from lodeflow.recording.recorder import Recorder, Taker
from lodeflow.runtime.gaps import without
from lodeflow.runtime.plan import Change, Plan

if TYPE_CHECKING:  # a run that is no replay need not know how to read
    from lodeflow.recording.reader import Recording


class RecordedChange(NamedTuple):
    """From `t` (ns) on, `node` is an instance of `use` with these parameters, as JSON."""

    t: int
    node: str
    use: str
    params: str


@dataclass(frozen=True)
class Past:
    """Changes and gaps of a run, in the order of their stamps.

    Attributes:
        changes: with the nodes as they became.
        gaps: stretches of streams that did not reach a group, or the recorder.
        homes: group of each node in the recorded run.
    """

    changes: tuple[tuple[RecordedChange, GraphNode], ...] = ()
    gaps: tuple[RecordedGap, ...] = ()
    homes: Mapping[str, str] | None = None

    def prepare(self, plan: Plan) -> None:
        """Let the nodes of a plan change, and miss, what they did."""
        for change, node in self.changes:
            if change.node in plan.nodes and not plan.nodes[change.node].spec.is_source:
                plan.nodes[change.node].changes.append(Change(change.t, node))
        homes = self.homes or {}
        for gap in self.gaps:
            for reader in plan.nodes.values():
                read = {str(wire) for wire in reader.wires.values()}
                if homes.get(reader.name) == gap.reader and gap.stream in read:
                    reader.gaps.setdefault(gap.stream, []).append((gap.begin, gap.end))

    def filtered(self, wire: Wire, take: Taker) -> Taker:
        """Return what lets the recorder miss what it missed."""
        spans = [
            (g.begin, g.end) for g in self.gaps if g.reader == RECORDER and g.stream == str(wire)
        ]
        return without(take, spans) if spans else take

    def write(self, recorder: Recorder) -> None:
        """Write it all into the recording of the replay."""
        for change, _ in self.changes:
            recorder.event(CHANGE, *change)
        for gap in self.gaps:
            recorder.event(GAP, in_range(gap.begin), *gap)


NOTHING = Past()


def read_past(recording: Recording, graph: Graph, overridden: Callable[[str], bool]) -> Past:
    """Return what a recording says of changes and gaps.

    Args:
        recording: the recording.
        graph: the graph to run, as it was at the start.
        overridden: whether a node was given other parameters, or another plugin, for the replay;
            its changes are not repeated then.

    Raises:
        RecordingError: a change names no node of the graph, or cannot be read.
        GraphError: a change does not check here.
    """
    changes = []
    for t, values in _events(recording, CHANGE):
        change = RecordedChange(t, *map(str, values))
        if change.node not in graph.nodes:
            near = did_you_mean(change.node, graph.nodes)
            raise RecordingError(
                f"{recording.path}: a change at t={t} names '{change.node}', which is no node of "
                f"graph '{graph.name}'{near}"
            )
        if overridden(change.node):
            continue
        graph = with_change(graph, change.node, change.use, change.params)
        changes.append((change, graph.nodes[change.node]))
    gaps = [RecordedGap.of(values) for _, values in _events(recording, GAP)]
    homes = {node: name for name, group in graph.processes.items() for node in group.nodes}
    return Past(tuple(changes), tuple(gaps), homes)


def _events(recording: Recording, kind: EventKind) -> list[tuple[int, list[Any]]]:
    """Return the events of a kind: stamp and members."""
    return [(t, kind.decode(data)) for t, data in recording.raw(kind.topic)]
