"""From names to lines: which quantities of which streams are to be drawn, and in which panels."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

from lodeflow.errors import RecordingError, did_you_mean
from lodeflow.messages import vocabulary as bundled
from lodeflow.messages.message import Message, by_ros_name
from lodeflow.plotting.quantities import EULER, Quantity, quantities
from lodeflow.recording.columns import stream_of, topic_of
from lodeflow.recording.events import EVENT_TOPICS
from lodeflow.recording.reader import Recording

MOST_PANELS = 8
"""Panels of an overview; more are too small to read."""


@dataclass(frozen=True, eq=False)
class Line:
    """One quantity of one stream of one recording.

    Attributes:
        recording: place in the list of recordings.
        topic: the stream.
        kind: its type.
        quantity: what of it.
    """

    recording: int
    topic: str
    kind: type[Message]
    quantity: Quantity

    @property
    def stream(self) -> str:
        """Name of the stream as in a graph."""
        return stream_of(self.topic)


@dataclass(frozen=True)
class Panel:
    """Lines that are drawn together: one field, in one unit.

    Attributes:
        title: the field.
        unit: symbol of the unit.
        lines: what is drawn.
    """

    title: str
    unit: str
    lines: tuple[Line, ...]

    @property
    def is_mode(self) -> bool:
        """Whether it holds modes, which are drawn as spans."""
        return bool(self.lines[0].quantity.modes)


class Request:
    """Finds what is asked for in some recordings.

    Args:
        recordings: open for reading.
        si: show SI units.
        euler: show the Euler angles of a quaternion in the place of its components.
    """

    def __init__(self, recordings: Sequence[Recording], *, si: bool, euler: bool) -> None:
        self.recordings = recordings
        self.si = si
        self.euler = euler
        self.notes: list[str] = []

    def panels(self, names: Sequence[str]) -> list[Panel]:
        """Return what to draw for some names, each STREAM, STREAM.FIELD or STREAM.FIELD.COMPONENT.

        Quantities of one field and unit share a panel; a panel for each component if several
        streams or recordings share it. A name that only some of the recordings have is noted.

        Raises:
            RecordingError: no recording has a name, or its type is unknown.
        """
        lines: dict[tuple[int, str, str], Line] = {}
        for name in dict.fromkeys(names):
            found = {i: list(self._lines(i, name)) for i in range(len(self.recordings))}
            if not any(found.values()):
                raise self._unknown(name)
            for index, some in found.items():
                if not some:
                    self.notes.append(f"{self.recordings[index].path}: no '{name}'")
                lines |= {(index, line.topic, line.quantity.name): line for line in some}
        return _grouped(list(lines.values()))

    def overview(self) -> list[Panel]:
        """Return what tells most of recordings that are not known yet.

        Heading, pitch and roll of all nodes that have them, then modes and sensors (of each
        quantity the stream that is recorded first), and, where nothing of that is there,
        everything.

        Raises:
            RecordingError: there is nothing to draw.
        """
        lines = [line for i in range(len(self.recordings)) for line in self._all(i)]
        chosen: list[Line] = []
        for name in EULER:
            by_node: dict[tuple[int, str], Line] = {}
            for line in lines:
                if line.quantity.field == name:
                    node = line.recording, line.stream.partition(".")[0]
                    if node not in by_node or name in line.kind.field_names:
                        by_node[node] = line  # what a node sends goes before what is derived
            chosen += by_node.values()
        chosen += [line for line in lines if line.quantity.modes]
        for index in range(len(self.recordings)):
            there = [line for line in lines if line.recording == index]
            for kinds in _SENSORS:
                topic = next((e.topic for kind in kinds for e in there if e.kind is kind), None)
                chosen += [line for line in there if line.topic == topic and line not in chosen]
        panels = _grouped(chosen or lines)
        if not panels:
            where = ", ".join(str(recording.path) for recording in self.recordings)
            raise RecordingError(f"{where}: nothing to draw, no stream has two messages")
        shown = {line.topic for panel in panels[:MOST_PANELS] for line in panel.lines}
        rest = dict.fromkeys(line.stream for line in lines if line.topic not in shown)
        if rest:
            self.notes.append(f"not shown: {', '.join(rest)} (name what you want to see)")
        return panels[:MOST_PANELS]

    def _all(self, index: int) -> Iterator[Line]:
        for topic, found in self.recordings[index].topics.items():
            kind = by_ros_name.get(found.type)
            if kind is not None and found.messages > 1 and topic not in EVENT_TOPICS:
                for quantity in quantities(kind, si=self.si):
                    yield Line(index, topic, kind, quantity)

    def _lines(self, index: int, name: str) -> Iterator[Line]:
        """Yield what a name means in a recording; nothing if it means nothing there."""
        recording = self.recordings[index]
        parts = name.split(".")
        for cut in range(len(parts), 0, -1):  # the longest name of a stream wins
            topic, rest = topic_of(".".join(parts[:cut])), ".".join(parts[cut:])
            if topic not in recording.topics:
                continue
            ros = recording.topics[topic].type
            if ros not in by_ros_name:
                raise RecordingError(
                    f"{recording.path}: '{stream_of(topic)}' holds "
                    f"{ros or 'messages without a type'}, which lodeflow does not know"
                )
            kind = by_ros_name[ros]
            known = quantities(kind, si=self.si)
            chosen = _named(known, rest) if rest else self._whole(kind, known)
            if chosen:
                yield from (Line(index, topic, kind, quantity) for quantity in chosen)
                return

    def _whole(self, kind: type[Message], known: list[Quantity]) -> list[Quantity]:
        """Return what is drawn of a stream that is named alone."""
        own = [q for q in known if q.field in kind.field_names]
        derived = [q for q in known if q.field not in kind.field_names]
        if not (self.euler and derived):
            return own
        turned = {f.name for f in kind.fields if f.ros == "geometry_msgs/Quaternion"}
        return derived + [q for q in own if q.field not in turned]

    def _unknown(self, name: str) -> RecordingError:
        for recording in self.recordings:  # is it the field that is wrong?
            for topic, found in recording.topics.items():
                prefix = next(
                    (p for p in (stream_of(topic), topic) if name.startswith(f"{p}.")), None
                )
                if prefix is not None and found.type in by_ros_name:
                    known = list(_names(quantities(by_ros_name[found.type])))
                    rest = name.removeprefix(f"{prefix}.")
                    return RecordingError(
                        f"{recording.path}: '{stream_of(topic)}' has no '{rest}'"
                        f"{did_you_mean(rest, known)} (it has: {', '.join(known)})"
                    )
        streams = [stream_of(t) for recording in self.recordings for t in recording.topics]
        near = did_you_mean(name, streams) or did_you_mean(name, self._full_names())
        return RecordingError(
            f"{self.recordings[0].path}: no stream '{name}'{near} "
            f"(streams: {', '.join(dict.fromkeys(streams)) or 'none'})"
        )

    def _full_names(self) -> list[str]:
        return [
            f"{line.stream}.{name}"
            for index in range(len(self.recordings))
            for line in self._all(index)
            for name in _names([line.quantity])
        ]


_SENSORS: tuple[tuple[type[Message], ...], ...] = (
    (bundled.Imu, bundled.AngularRate),
    (bundled.Imu, bundled.SpecificForce),
    (bundled.MagneticField,),
)
"""Types of which an overview shows a stream; the first that there is."""


def _names(known: Sequence[Quantity]) -> dict[str, None]:
    """Return all that may stand behind the name of a stream."""
    return dict.fromkeys(name for quantity in known for name in (quantity.field, quantity.name))


def _named(known: Sequence[Quantity], name: str) -> list[Quantity]:
    return [quantity for quantity in known if name in (quantity.field, quantity.name)]


def _grouped(lines: Sequence[Line]) -> list[Panel]:
    groups: dict[tuple[str, str, bool], list[Line]] = {}
    for line in lines:
        quantity = line.quantity
        key = (quantity.field, quantity.unit, bool(quantity.modes))
        groups.setdefault(key, []).append(line)
    panels = []
    for (field, unit, _), some in groups.items():
        sources = {(line.recording, line.topic) for line in some}
        names = dict.fromkeys(line.quantity.name for line in some)
        if len(sources) == 1 or len(names) == 1:
            panels.append(Panel(next(iter(names)) if len(names) == 1 else field, unit, tuple(some)))
            continue
        panels += [
            Panel(name, unit, tuple(line for line in some if line.quantity.name == name))
            for name in names
        ]
    return panels


def sources(panels: Sequence[Panel]) -> Mapping[tuple[int, str], int]:
    """Return a number for each stream of each recording, in the order of the panels."""
    found = dict.fromkeys(
        (line.recording, line.topic)
        for panel in panels
        if not panel.is_mode
        for line in panel.lines
    )
    return {source: number for number, source in enumerate(found)}
