"""One calibration: the streams of recordings, a tool, and the file that a node reads."""

from __future__ import annotations

import datetime
import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from lodeflow.calibration import Calibration, CalibrationTool, Quantity
from lodeflow.clock import wall_time
from lodeflow.errors import CalibrationError, NodeError, RecordingError, did_you_mean
from lodeflow.graph import dump_calibration, settings
from lodeflow.recording.columns import stream_of
from lodeflow.recording.provenance import versions
from lodeflow.recording.reader import Recording
from lodeflow.recording.whole import read_whole
from lodeflow.registry import load_object, registry


@dataclass(frozen=True)
class Calibrated:
    """What came of a calibration.

    Attributes:
        found: what the tool found.
        results: the quantities as plain data: {name: {value, unit, standard_error}}.
        text: the calibration file.
    """

    found: Calibration
    results: Mapping[str, Any]
    text: str


def load_tool(kind: str) -> type[CalibrationTool]:
    """Return the tool behind a kind of `lodeflow calibrate`, or behind "module:Class".

    Raises:
        NodeError: there is none of that name, or it cannot be used.
    """
    known = registry().calibrations
    if ":" not in kind and kind not in known:
        near = did_you_mean(kind, known) or f" (kinds: {', '.join(sorted(known)) or 'none'})"
        raise NodeError(f"no kind of calibration is called {kind!r}{near}")
    path = kind if ":" in kind else known[kind].path
    tool = load_object(path)
    if not (isinstance(tool, type) and issubclass(tool, CalibrationTool) and tool.streams):
        raise NodeError(f"{kind!r}: {path} is no CalibrationTool with a method calibrate")
    return tool


def calibrate(
    kind: str,
    recordings: Sequence[Path],
    *,
    sets: Sequence[str] = (),
    streams: Sequence[str] = (),
    command: Sequence[str] = (),
) -> Calibrated:
    """Run a calibration tool on recordings.

    Args:
        kind: name of the tool, or "module:Class".
        recordings: files that hold the streams it reads.
        sets: texts "name=value" for its parameters; the value is YAML.
        streams: texts "port=stream", where more than one stream has the type of a port.
        command: arguments of the command line, kept in the file.

    Raises:
        GraphError: with each parameter that does not fit.
        RecordingError: a recording cannot be read, or does not hold what is needed.
        CalibrationError: the data do not determine what is asked.
    """
    plugin = load_tool(kind)
    tool = plugin(settings(plugin, kind, sets), name=kind)
    chosen = dict(_pair(text) for text in streams)
    try:
        whole = read_whole(recordings, plugin.streams, chosen)
    except RecordingError as error:
        raise RecordingError(f"calibrate {kind}: {error}") from None
    tool.start()
    try:
        found = tool.calibrate(**whole.blocks)
    except CalibrationError as error:
        raise CalibrationError(f"calibrate {kind}: {error}") from error
    results = {quantity.name: _result(quantity) for quantity in found.quantities}
    text = dump_calibration(
        found.plugin,
        _plain(found.params),
        results,
        list(found.notes),
        {
            "kind": kind,
            "made": datetime.datetime.fromtimestamp(wall_time() / 1e9, tz=datetime.UTC).isoformat(),
            "command": list(command),
            "settings": json.loads(tool.params.model_dump_json()),
            "recordings": [_origin(*pair) for pair in zip(recordings, whole.used, strict=True)],
            "versions": versions([plugin.__module__.partition(".")[0]]),
        },
    )
    return Calibrated(found, results, text)


def _pair(text: str) -> tuple[str, str]:
    port, equals, stream = text.partition("=")
    if not port or not equals:
        raise RecordingError(f"--stream {text}: write --stream name=stream")
    return port.strip(), stream.strip()


def _origin(path: Path, used: Any) -> dict[str, Any]:
    """Return what is to be known of a recording that a calibration was made from."""
    with path.open("rb") as file:
        digest = hashlib.file_digest(file, "sha256").hexdigest()
    found = {
        "file": str(path),
        "sha256": digest,
        "streams": {name: stream_of(topic) for name, (topic, _) in used.items()},
        "messages": {name: count for name, (_, count) in used.items()},
    }
    with Recording(path) as recording:
        try:
            about = recording.metadata("lodeflow.provenance")
        except RecordingError:
            return found  # another recorder's file
    return found | {key: about[key] for key in ("graph", "started") if key in about}


def _result(quantity: Quantity) -> dict[str, Any]:
    found = {"value": _plain(quantity.value)}
    if quantity.unit:
        found["unit"] = quantity.unit
    if quantity.error is not None:
        found["standard_error"] = _plain(quantity.error)
    return found


def _plain(value: Any) -> Any:
    """Return arrays as lists, numpy numbers as Python's own, and NaN as null."""
    if isinstance(value, dict):
        return {key: _plain(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(item) for item in value]
    if isinstance(value, (np.ndarray, np.generic)):
        return _plain(value.tolist())
    return None if isinstance(value, float) and not np.isfinite(value) else value
