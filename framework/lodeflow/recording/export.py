"""Export: the streams of a recording as tables, CSV or Parquet, a column per component."""

from __future__ import annotations

import csv
import importlib
import re
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lodeflow.errors import RecordingError, did_you_mean
from lodeflow.messages.message import Message
from lodeflow.recording.columns import components, stream_of, topic_of
from lodeflow.recording.reader import Recording

GROUP = 1 << 16
"""Least rows of a row group in Parquet; smaller ones make files large and slow."""

Write = Callable[[Sequence[NDArray[Any]]], None]
"""Takes the next rows of a table, as columns."""


def export(
    recording: Recording, form: str, out: Path, streams: Sequence[str] = ()
) -> tuple[dict[str, Path], dict[str, str]]:
    """Write streams into tables: `t_ns`, then a column per component, its unit in the header.

    One block at a time is in memory, for Parquet one row group.

    Args:
        recording: open for reading.
        form: "csv" or "parquet".
        out: folder, made if missing, with a file per stream, such as vehicle.imu.csv; or, for one
            stream and a name that ends with the form's suffix, the file.
        streams: names as in a graph, or topics; all that can be read if none are given.

    Returns:
        The file of each topic, and why topics that cannot be read were left out.

    Raises:
        RecordingError: a stream is unknown or cannot be read, a file exists or cannot be written,
            the recording is damaged, or the package for Parquet is missing.
    """
    openers = {"csv": _csv, "parquet": _parquet}
    if form not in openers:
        raise RecordingError(f"no format {form!r}{did_you_mean(form, openers)} (csv, parquet)")
    if form == "parquet":
        _pyarrow()
    topics = recording.topics
    wanted = list(dict.fromkeys(map(topic_of, streams))) or list(topics)
    for topic in wanted:
        if topic not in topics:
            raise RecordingError(
                f"{recording.path}: no stream '{stream_of(topic)}'"
                f"{did_you_mean(stream_of(topic), map(stream_of, topics))} "
                f"(streams: {', '.join(map(stream_of, topics)) or 'none'})"
            )
    kinds: dict[str, type[Message]] = {}
    left_out: dict[str, str] = {}
    for topic in wanted:
        try:
            kinds[topic] = recording.kind(topic)
        except RecordingError as error:
            if streams:
                raise
            left_out[topic] = str(error).removeprefix(f"{recording.path}: ")
    single = len(kinds) == 1 and bool(streams) and out.suffix == f".{form}"
    files = {topic: out if single else out / f"{_file_name(topic)}.{form}" for topic in kinds}
    for path in files.values():
        if path.exists():
            raise RecordingError(f"{path}: exists; remove it or choose another place")
    try:
        (out.parent if single else out).mkdir(parents=True, exist_ok=True)
        for topic, path in files.items():
            kind = kinds[topic]
            blocks = recording.stream(topic, kind)
            with openers[form](path, kind) as write:
                for block in blocks:
                    write(_columns(block))
    except OSError as error:
        raise RecordingError(
            f"{error.filename or out}: cannot be written: {error.strerror}"
        ) from error
    return files, left_out


def headers(kind: type[Message]) -> list[str]:
    """Return the names of a table's columns: "t_ns", "angular_velocity.x [rad/s]", ..."""
    names = ["t_ns"]
    for field in kind.fields:
        unit = f" [{field.unit.symbol}]" if field.unit.symbol else ""
        names += [component + unit for component in components(field)]
    return names


def _file_name(topic: str) -> str:
    return re.sub(r"[^\w.-]", "_", stream_of(topic))


def _columns(block: Message) -> list[NDArray[Any]]:
    found = [block.t]
    for value in block.values():
        found += list(value.reshape(len(block), -1).T)
    return found


@contextmanager
def _csv(path: Path, kind: type[Message]) -> Iterator[Write]:
    with path.open("x", encoding="utf-8", newline="") as file:
        rows = csv.writer(file, lineterminator="\n")
        rows.writerow(headers(kind))

        def write(columns: Sequence[NDArray[Any]]) -> None:
            # Python writes a float in the fewest digits that give it back.
            rows.writerows(zip(*[column.tolist() for column in columns], strict=True))

        yield write


@contextmanager
def _parquet(path: Path, kind: type[Message]) -> Iterator[Write]:
    pa, pq = _pyarrow()
    types = [pa.int64()]
    for field in kind.fields:
        types += [pa.int64() if field.integer else pa.float64()] * field.size
    schema = pa.schema(list(zip(headers(kind), types, strict=True)))
    waiting: list[Sequence[NDArray[Any]]] = []
    with path.open("xb") as file, pq.ParquetWriter(file, schema) as table:

        def flush() -> None:
            if waiting:
                joined = [np.concatenate(parts) for parts in zip(*waiting, strict=True)]
                table.write_table(pa.table(joined, schema=schema))
                waiting.clear()

        def write(columns: Sequence[NDArray[Any]]) -> None:
            waiting.append(columns)
            if sum(len(part[0]) for part in waiting) >= GROUP:
                flush()

        yield write
        flush()


def _pyarrow() -> tuple[Any, Any]:
    try:
        return importlib.import_module("pyarrow"), importlib.import_module("pyarrow.parquet")
    except ImportError as error:
        raise RecordingError(
            "Parquet needs the package pyarrow; install lodeflow with its extra: "
            "pip install 'lodeflow[parquet]'"
        ) from error
