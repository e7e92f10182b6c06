"""Compare two recordings: are they the same, and if not, where do they begin to differ?

The same means: each data stream has the same schema and the same sequence of (t, payload). The
order between streams, chunks, provenance, logs and wall times do not count.
"""

from __future__ import annotations

import json
import re
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path

from mcap import records as mcap

from lodeflow.errors import MessageError, RecordingError, did_you_mean
from lodeflow.messages.message import Message
from lodeflow.recording.columns import stream_of, topic_of
from lodeflow.recording.comparison import Comparison, StreamComparison
from lodeflow.recording.events import EVENT_TOPICS
from lodeflow.recording.fit import Channels, kind_of, translated
from lodeflow.recording.mcap.file import McapFile
from lodeflow.recording.mcap.raw import parts, topics
from lodeflow.recording.pairing import NotIncreasingError, Pairing

HELD = 1 << 24
"""Bytes that may wait for their partners before a stream is put off to a pass of its own."""


def compare(
    a: str | Path,
    b: str | Path,
    *,
    tolerance: float | None = None,
    tolerances: Mapping[str, float | str] | None = None,
    streams: Collection[str] | None = None,
) -> Comparison:
    """Compare two recordings, block by block; what waits for its partner is bounded.

    Messages of equal stamps are partners. Types that lodeflow knows are compared by field, others
    by their bytes.

    Args:
        a: first file.
        b: second file.
        tolerance: accept differences up to this in each float field, in the field's unit; None
            accepts no difference in any bit.
        tolerances: the same for single fields, {"stream.field": 1e-6 or "0.1 deg"}; the stream
            is named as in a graph or by its topic.
        streams: topics to compare; None for all but the logs.

    Raises:
        RecordingError: a file cannot be read or is damaged, or a stream is in neither.
        MessageError: a tolerance names no float field, or is no number of its unit.
    """
    with McapFile(Path(a)) as file_a, McapFile(Path(b)) as file_b:
        files = (file_a, file_b)
        found = [topics(file) for file in files]
        names = dict.fromkeys([*found[0], *found[1]])
        if streams is None:
            for event in EVENT_TOPICS:
                names.pop(event, None)
        else:
            for topic in streams:
                if topic not in names:
                    raise RecordingError(
                        f"neither {a} nor {b} has a stream '{topic}'{did_you_mean(topic, names)} "
                        f"(streams: {', '.join(names) or 'none'})"
                    )
            names = {topic: None for topic in names if topic in streams}
        result = Comparison(Path(a), Path(b))
        kinds: dict[str, type[Message] | None] = {}
        for topic in names:
            channels = [sides.get(topic, []) for sides in found]
            stream = _stream(topic, files, channels)
            result.streams[topic] = stream
            if not stream.problem:
                kinds[topic] = _kind(files[0], channels[0])
        accepted = _tolerances(kinds, tolerance, tolerances or {})
        ids = [
            {topic: [channel.id for channel in side[topic]] for topic in kinds} for side in found
        ]

        def pairing(topic: str, *, by_number: bool = False) -> Pairing:
            found = result.streams[topic]
            fresh = StreamComparison(topic, found.types, found.counts)
            result.streams[topic] = fresh
            return Pairing(fresh, kinds[topic], accepted[topic], by_number=by_number)

        put_off = _walk(files, ids, {topic: pairing(topic) for topic in kinds})
        while put_off:
            topic, by_number = put_off.popitem()
            alone = {topic: pairing(topic, by_number=by_number)}
            put_off |= _walk(files, [{topic: side[topic]} for side in ids], alone)
        if not result.same:
            result.notes = _notes(files)
    return result


def _walk(
    files: Sequence[McapFile],
    ids: Sequence[Mapping[str, Sequence[int]]],
    pairings: dict[str, Pairing],
) -> dict[str, bool]:
    """Go through both files once, side by side.

    Returns:
        The topics to be compared alone, and whether by number: in one pass too much of them
        waited, or their log times do not increase.
    """
    put_off: dict[str, bool] = {}
    chunks = [parts(file, wanted) for file, wanted in zip(files, ids, strict=True)]
    ended = [False, False]
    while pairings and not all(ended):
        held = [sum(pairing.held(side) for pairing in pairings.values()) for side in (0, 1)]
        side = int(ended[0] or (held[0] > held[1] and not ended[1]))
        chunk = next(chunks[side], None)
        if chunk is None:
            ended[side] = True
            for pairing in pairings.values():
                pairing.end(side)
            continue
        for topic, part in chunk.items():
            if topic not in pairings:
                continue
            pairing = pairings[topic]
            try:
                if pairing.wants(side):
                    pairing.put(side, part.rows(files[side], topic))
                else:
                    pairing.skip(side, part.entries["log_time"])
            except NotIncreasingError:
                put_off[topic] = True
                del pairings[topic]
        while len(pairings) > 1 and sum(p.held(0) + p.held(1) for p in pairings.values()) > HELD:
            most = max(
                pairings, key=lambda topic: pairings[topic].held(0) + pairings[topic].held(1)
            )
            put_off[most] = False
            del pairings[most]
    return put_off


def _stream(
    topic: str, files: Sequence[McapFile], channels: Sequence[Channels]
) -> StreamComparison:
    """Return what is known of a stream before its messages are read."""
    types, counts, schemas = [], [], []
    for file, side in zip(files, channels, strict=True):
        known = [file.schemas.get(channel.schema_id) for channel in side]
        types.append(" | ".join(dict.fromkeys(schema.name for schema in known if schema)))
        counts.append(sum(file.counts.get(channel.id, 0) for channel in side))
        schemas.append({_meaning(c, schema) for c, schema in zip(side, known, strict=True)})
    problem = ""
    if not channels[1]:
        problem = "only in A"
    elif not channels[0]:
        problem = "only in B"
    elif types[0] != types[1]:
        problem = "another type"
    elif schemas[0] != schemas[1]:
        problem = "another definition"
    return StreamComparison(topic, (types[0], types[1]), (counts[0], counts[1]), problem)


def _meaning(channel: mcap.Channel, schema: mcap.Schema | None) -> tuple[str, ...]:
    """Return what decides how messages are read; comments in a ROS 2 definition do not."""
    if schema is None:
        return (channel.message_encoding,)
    text = schema.data.decode("utf-8", "surrogateescape")
    if schema.encoding == "ros2msg":
        lines = (" ".join(line.split()) for line in re.sub("#.*", "", text).splitlines())
        text = "\n".join(filter(None, lines))
    return channel.message_encoding, schema.name, schema.encoding, text


def _kind(file: McapFile, channels: Channels) -> type[Message] | None:
    """Return the type that lodeflow has for the messages of a topic, if it has just that."""
    try:
        kind = kind_of(file, channels)
    except MessageError:
        return None
    return None if translated(file, channels, kind) else kind


def _tolerances(
    kinds: Mapping[str, type[Message] | None],
    general: float | None,
    single: Mapping[str, float | str],
) -> dict[str, dict[str, float]]:
    """Return the tolerance of each field of each topic that has one."""
    found: dict[str, dict[str, float]] = {}
    for topic, kind in kinds.items():
        fields = () if kind is None else kind.fields
        found[topic] = {
            field.name: general for field in fields if general is not None and not field.integer
        }
    known = {
        f"{stream_of(topic)}.{field.name}": (topic, field)
        for topic, kind in kinds.items()
        for field in (kind.fields if kind else ())
        if not field.integer
    }
    for name, value in single.items():
        stream, _, last = name.rpartition(".")
        key = f"{stream_of(topic_of(stream))}.{last}"
        if key not in known:
            raise MessageError(
                f"tolerance {name}: no such float field of a stream in both recordings"
                f"{did_you_mean(key, known)} (there is: {', '.join(known) or 'none'})"
            )
        topic, field = known[key]
        try:
            number = field.unit.parse(value) if isinstance(value, str) else value
        except MessageError as error:
            raise MessageError(f"tolerance {name}: {error}") from None
        found[topic][field.name] = number
    for topic, fields_of in found.items():
        for name, number in fields_of.items():
            if not number >= 0:
                raise MessageError(f"tolerance {stream_of(topic)}.{name}: {number} is below zero")
    return found


def _notes(files: Sequence[McapFile]) -> list[str]:
    """Return what differs between the two hosts and may explain other bits."""
    found = []
    for file in files:
        try:
            found.append(file.read_metadata("lodeflow.provenance"))
        except RecordingError:
            return []
    notes = []
    features = [set(side.get("cpu_features", "").split()) for side in found]
    if features[0] != features[1]:
        only = [" ".join(sorted(features[n] - features[1 - n])) or "none" for n in (0, 1)]
        notes.append(
            f"the CPU features differ (only A: {only[0]}; only B: {only[1]}): numpy's sin, exp and "
            "the like may differ in the last bit between them"
        )
    versions = [_versions(side) for side in found]
    changed = [
        f"{name} {versions[0].get(name, 'none')} / {versions[1].get(name, 'none')}"
        for name in sorted({*versions[0], *versions[1]})
        if versions[0].get(name) != versions[1].get(name)
    ]
    if changed:
        notes.append(f"versions differ: {', '.join(changed)}")
    return notes


def _versions(provenance: Mapping[str, str]) -> dict[str, str]:
    try:
        found = json.loads(provenance.get("versions", "{}"))
    except (ValueError, RecursionError):
        return {}
    return found if isinstance(found, dict) else {}
