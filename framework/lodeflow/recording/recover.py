"""Recover: mend a recording that was killed, cut off or damaged, into a new file."""

from __future__ import annotations

import json
import zlib
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, BinaryIO, TypeVar

import numpy as np
from mcap import records as mcap
from mcap.data_stream import ReadDataStream
from numpy.typing import NDArray

from lodeflow.errors import RecordingError
from lodeflow.recording.mcap.file import McapFile
from lodeflow.recording.mcap.records import INDEX_LAYOUT, MAGIC, Op
from lodeflow.recording.mcap.rewriter import McapRewriter
from lodeflow.recording.mcap.scan import Item, Scan
from lodeflow.recording.mcap.summary import DEFECTS, parsed
from lodeflow.recording.mcap.unpack import UnpackError, largest_chunk, unpack
from lodeflow.recording.mcap.walk import equal, filtered, tiles, walked
from lodeflow.recording.recovery import Damage, Recovery

R = TypeVar("R")

LOOSE = 1 << 20
"""Bytes of messages outside of chunks that are put into one."""


def recover(source: str | Path, out: str | Path | None = None) -> Recovery:
    """Write what is whole in a damaged recording to a new file.

    Whole are chunks whose CRC holds, attachments likewise, metadata, schemas and channels. Index,
    statistics and summary are made anew, so that messages without an index can be read too. One
    chunk at a time is in memory. The report is kept in the new file, as "lodeflow.recovery".

    Args:
        source: the damaged file; it stays as it is.
        out: the new file; None for NAME.recovered.mcap beside it.

    Raises:
        RecordingError: `source` cannot be read, is no MCAP file or has nothing to keep; `out`
            exists or cannot be written.
    """
    source = Path(source)
    if out is None:
        out = source.with_name(source.name.removesuffix(".mcap") + ".recovered.mcap")
    out = Path(out)
    try:
        with source.open("rb") as file:
            _check_magic(source, file)
            return _recover(source, file, out)
    except OSError as error:
        raise RecordingError(f"{source}: cannot be read: {error.strerror}") from error


def _check_magic(source: Path, file: BinaryIO) -> None:
    magic = file.read(len(MAGIC))
    if not magic:
        raise RecordingError(f"{source}: is empty")
    if magic != MAGIC[: len(magic)]:
        raise RecordingError(f"{source}: is no MCAP file")


def _recover(source: Path, file: BinaryIO, out: Path) -> Recovery:
    scan = Scan(file)
    known = _Definitions()
    with suppress(RecordingError), McapFile(source) as whole:
        # A summary has a CRC, the records that it repeats have none.
        known.schemas.update(whole.schemas)
        known.channels.update({channel.id: channel for channel in whole.channels})
        tried = _Copy(source, scan, known, McapRewriter(None))
        if tried.run() and tried.same_as(whole):
            return tried.report
        known = _Definitions(whole.schemas, {channel.id: channel for channel in whole.channels})
    for item in scan:
        if item.op in (Op.SCHEMA, Op.CHANNEL):
            known.take(item.op, scan.body(item))
    writer = McapRewriter(out)
    try:
        copy = _Copy(source, scan, known, writer)
        copy.run()
        if not copy.begun:
            raise RecordingError(f"{source}: ends within its header; there is nothing to keep")
        copy.report.out = out
        writer.metadata("lodeflow.recovery", {"report": json.dumps(copy.report.as_dict())})
        writer.close()
    except BaseException:
        writer.discard()
        raise
    return copy.report


@dataclass
class _Definitions:
    """Schemas and channels by their ids; the first of an id counts."""

    schemas: dict[int, mcap.Schema] = field(default_factory=dict)
    channels: dict[int, mcap.Channel] = field(default_factory=dict)

    def take(self, op: int | None, body: bytes) -> int | None:
        """Take a record; return its id, None if it is damaged."""
        if op == Op.SCHEMA:
            schema = _parsed(mcap.Schema.read, body)
            if schema is None or not schema.id:
                return None
            return self.schemas.setdefault(schema.id, schema).id
        channel = _parsed(mcap.Channel.read, body)
        return None if channel is None else self.channels.setdefault(channel.id, channel).id

    def complete(self, channel: int) -> bool:
        """Whether a channel is known, and its schema if it has one."""
        found = self.channels.get(channel)
        return found is not None and (not found.schema_id or found.schema_id in self.schemas)

    def topic(self, channel: int) -> str:
        """Return the topic of a channel."""
        found = self.channels.get(channel)
        return f"channel {channel}" if found is None else found.topic


class _Copy:
    """One way through a file, keeping what is whole."""

    def __init__(self, source: Path, scan: Scan, known: _Definitions, writer: McapRewriter) -> None:
        self.report = Recovery(source)
        self.begun = False
        self._scan = scan
        self._known = known
        self._writer = writer
        self._chunk: Item | None = None
        self._indexes: list[Item] = []
        self._loose: list[bytes] = []
        self._loose_size = 0
        self._good = True
        self._counts = [0, 0, 0]  # chunks, attachments, metadata

    def run(self) -> bool:
        """Go through the file; return whether all of it was good."""
        for item in self._scan:
            if item.op == Op.MESSAGE_INDEX:
                if self._chunk is not None:
                    self._indexes.append(item)
                continue
            self._end_chunk()
            if item.op == Op.MESSAGE:
                self._good = False  # readers of an index do not find it
                self._begin()
                self._loose.append(self._scan.read(item.start, item.end - item.start))
                self._loose_size += len(self._loose[-1])
                if self._loose_size >= LOOSE:
                    self._end_loose()
                continue
            self._end_loose()
            self._take(item)
        self._end_chunk()
        self._end_loose()
        report, writer = self.report, self._writer
        for channel, count in writer.counts.items():
            topic = self._known.topic(channel)
            report.kept[topic] = report.kept.get(topic, 0) + count
            if count:
                until = writer.until[channel]
                report.until[topic] = max(until, report.until.get(topic, until))
        if report.until:
            report.begun, report.reached = writer.first, writer.last
        return self._good

    def same_as(self, whole: McapFile) -> bool:
        """Whether the summary of a file says the same as what was found in it."""
        places = [len(whole.chunks), len(whole.attachments), len(whole.metadata)]
        counts = {channel: count for channel, count in whole.counts.items() if count}
        found = {channel: count for channel, count in self._writer.counts.items() if count}
        return places == self._counts and counts == found

    def _begin(self, profile: str = "ros2", library: str = "lodeflow") -> None:
        if not self.begun:
            self.begun = True
            self._writer.header(profile, library)

    def _take(self, item: Item) -> None:
        match item.op:
            case None:
                self._good = False
                if item.end == self._scan.size:
                    self.report.tail = item.end - item.start
                else:
                    self._lose(item, "no record that is whole")
            case Op.HEADER:
                header = _parsed(mcap.Header.read, self._scan.body(item))
                self._begin(*(() if header is None else (header.profile, header.library)))
            case Op.SCHEMA | Op.CHANNEL:
                self._begin()
                found = self._known.take(item.op, self._scan.body(item))
                if found is None:
                    self._lose(item, f"a {item.op.name.lower()}, damaged")
                elif item.op == Op.CHANNEL:
                    self._define(found)
            case Op.CHUNK:
                self._begin()
                self._chunk, self._indexes = item, []
            case Op.DATA_END:
                self.report.complete = True
            case Op.ATTACHMENT:
                self._begin()
                self._attachment(item)
            case Op.METADATA:
                self._begin()
                metadata = _parsed(mcap.Metadata.read, self._scan.body(item))
                if metadata is None:
                    self._lose(item, "metadata, damaged")
                else:
                    self._counts[2] += 1
                    self._writer.metadata(metadata.name, metadata.metadata)

    def _define(self, channel: int, *, in_chunk: bool = False) -> None:
        """Write a channel with its schema, if it is complete."""
        if self._known.complete(channel):
            found = self._known.channels[channel]
            if found.schema_id:
                self._writer.schema(self._known.schemas[found.schema_id])
            self._writer.channel(found, in_chunk=in_chunk)

    def _attachment(self, item: Item) -> None:
        body = self._scan.body(item)
        found = _parsed(mcap.Attachment.read, body)
        crc = int.from_bytes(body[-4:], "little")
        if found is None or crc not in (0, zlib.crc32(memoryview(body)[:-4])):
            self._lose(item, "an attachment whose CRC differs")
        else:
            self._counts[1] += 1
            self._writer.attachment(body, found)

    def _end_loose(self) -> None:
        if self._loose:
            raw = b"".join(self._loose)
            self._loose, self._loose_size = [], 0
            found = walked(raw)
            if found is not None:
                self._keep(raw, found.indexes)

    def _end_chunk(self) -> None:
        item, indexes = self._chunk, self._indexes
        if item is None:
            return
        self._chunk = None
        parsed = [(index, self._scan.body(index)) for index in indexes]
        entries = [
            (int.from_bytes(body[:2], "little"), np.frombuffer(body, INDEX_LAYOUT, offset=6))
            for _, body in parsed
            if (len(body) - 6) % INDEX_LAYOUT.itemsize == 0
        ]
        try:
            chunk = unpack(self._scan.body(item), largest_chunk(self._scan.size))
        except UnpackError as error:
            if not error.damaged:
                raise RecordingError(
                    f"{self.report.source}: the chunk at byte {item.start} {error}"
                ) from error
            self._lose(item, f"a chunk that {error}")
            for channel, rows in entries:
                self._count_lost(channel, len(rows))
            return
        self._counts[0] += 1
        self._good = self._good and chunk.tidy
        packed = (chunk.compression, chunk.packed) if chunk.tidy else None
        if tiles(chunk.raw, entries):
            self._keep(chunk.raw, {id_: rows for id_, rows in entries if len(rows)}, packed)
            return
        found = walked(chunk.raw)
        if found is None:
            self._lose(item, "a chunk whose records do not follow each other")
            return
        self._good = self._good and equal(found.indexes, entries)
        ids = [(op, self._known.take(op, body)) for op, body in found.definitions]
        if all(self._known.complete(id_) for id_ in found.indexes):
            for op, id_ in ids:
                if op == Op.SCHEMA and id_ is not None:
                    self._writer.schema(self._known.schemas[id_], in_chunk=True)
                elif id_ is not None:
                    self._define(id_, in_chunk=True)
        self._keep(chunk.raw, found.indexes, packed)

    def _keep(
        self,
        raw: bytes,
        indexes: dict[int, NDArray[Any]],
        packed: tuple[str, memoryview] | None = None,
    ) -> None:
        """Write a chunk; without the messages of channels that are lost."""
        good = {id_: rows for id_, rows in indexes.items() if self._known.complete(id_)}
        for channel in good:
            self._define(channel)
        if len(good) < len(indexes):
            self._good = False
            for channel in indexes.keys() - good.keys():
                self._count_lost(channel, len(indexes[channel]))
            if not good:
                return
            raw, good = filtered(raw, good)
            packed = None
        self._writer.chunk(raw, good, packed)

    def _lose(self, item: Item, what: str) -> None:
        self._good = False
        self.report.damage.append(Damage(item.start, item.end - item.start, what))

    def _count_lost(self, channel: int, count: int) -> None:
        topic = self._known.topic(channel)
        self.report.lost[topic] = self.report.lost.get(topic, 0) + count


def _parsed(read: Callable[[ReadDataStream], R], body: bytes) -> R | None:
    try:
        return parsed(read, body)
    except DEFECTS:
        return None
