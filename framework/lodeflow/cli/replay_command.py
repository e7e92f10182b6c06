"""`lodeflow replay`."""

from __future__ import annotations

import json
import sys
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import click

from lodeflow.cli.logs import log_to_stderr
from lodeflow.cli.options import JSON, overrides
from lodeflow.cli.output import STATUS
from lodeflow.cli.replay_check import Checked, report_check
from lodeflow.cli.report import Progress, report
from lodeflow.errors import GraphError, RecordingError
from lodeflow.graph import Graph, Record, load_graph, load_graph_text
from lodeflow.recording.compare import compare
from lodeflow.recording.past import read_past
from lodeflow.recording.reader import Recording
from lodeflow.recording.recorder import topic
from lodeflow.recording.replay import Replay, replaying, without_effect
from lodeflow.supervisor.run import run
from lodeflow.supervisor.seen import Look
from lodeflow.supervisor.summary import Summary


def _speed(ctx: click.Context, param: click.Parameter, text: str) -> float | None:
    """Return event time per wall time; None for "max"."""
    if text == "max":
        return None
    try:
        speed = float(text)
    except ValueError:
        speed = 0.0
    if not 0 < speed < float("inf"):
        raise click.BadParameter(f"{text!r} is neither 'max' nor a number above 0")
    return speed


@click.command()
@click.argument("recording", metavar="REC", type=click.Path(dir_okay=False, path_type=Path))
@click.argument("graph", required=False, type=click.Path(dir_okay=False, path_type=Path))
@click.option(
    "--from",
    "start",
    multiple=True,
    metavar="NODE",
    help="Recompute only this node and what lies downstream; several times for several.",
)
@overrides
@click.option(
    "--speed",
    callback=_speed,
    default="max",
    metavar="max|NUMBER",
    help="Event time per wall time; 1 for real time. [default: max]",
)
@click.option("--record", metavar="PATH", help="Record to PATH, not to recordings/.")
@click.option("--no-record", is_flag=True, help="Record nothing.")
@click.option("--check", is_flag=True, help="Say whether the same came out, to the byte.")
@JSON
def command(
    recording: Path,
    graph: Path | None,
    start: tuple[str, ...],
    overrides: dict[str, Any],
    speed: float | None,
    record: str | None,
    no_record: bool,
    check: bool,
    as_json: bool,
) -> int:
    """Run a graph again on the streams of a recording, and record that.

    Sources play what was recorded of them, all other nodes are computed anew. GRAPH is the one
    in the recording if none is given.

    With --check, compare what was computed with what was recorded, and exit 1 if a byte differs;
    nothing is recorded then without --record.
    """
    if record is not None and no_record:
        raise click.UsageError("--record and --no-record exclude each other")
    no_record = no_record or (check and record is None)
    with Recording(recording) as source:
        loaded = _graph(source, graph, overrides)
        replay = replaying(loaded, source, start=start, complete=not no_record)
        about = _about(source, replay)
        past = read_past(source, loaded, _overridden(overrides).__contains__)
        checked = [wire for wire in replay.recomputed if topic(wire) in source.topics]
    _refuse_without_effect(replay, overrides)
    if check and not checked:
        raise click.UsageError(f"nothing to check: {recording} holds no stream that is computed")
    for note in (*loaded.notes, *replay.notes):
        STATUS.print(note, soft_wrap=True, markup=False)
    log_to_stderr()

    def perform(graph: Graph, record: str | None) -> Summary:
        with Progress() as progress:
            return run(
                graph,
                record=record,
                speed=speed,
                progress=progress,
                command=sys.argv[1:],
                about=about,
                look=Look(),
                past=past,
            )

    if not check:
        return report(perform(replay.graph, "" if no_record else record), as_json=as_json)
    with tempfile.TemporaryDirectory(prefix="lodeflow-") as folder:
        graph_to_run = replay.graph
        if record is None:
            record = str(Path(folder) / "replay.mcap")
            graph_to_run = replace(replay.graph, record=Record(record, tuple(checked)))
        summary = perform(graph_to_run, record)
        if summary.stopped or isinstance(summary.error, RecordingError):
            return report(summary, as_json=as_json)
        compared = compare(recording, record, streams=[topic(wire) for wire in checked])
    return report_check(Checked(recording, replay, summary, compared), as_json=as_json)


def _graph(source: Recording, path: Path | None, overrides: Mapping[str, Any]) -> Graph:
    if path is not None:
        return load_graph(path, **overrides)
    text = source.attachment("graph.yaml").decode("utf-8", "replace")
    return load_graph_text(text, filename=f"{source.path}: graph.yaml", **overrides)


def _about(source: Recording, replay: Replay) -> dict[str, str]:
    """Return what the provenance of a replay says of it."""
    return {
        "replay_of": str(source.path),
        "replay_fed": json.dumps([str(wire) for wire in replay.fed]),
    }


def _overridden(overrides: Mapping[str, Sequence[str]]) -> set[str]:
    """Return the nodes that were set or swapped; what befell them before is not repeated."""
    return {
        text.partition("=")[0].partition(".")[0].strip()
        for text in (*overrides["sets"], *overrides["swaps"])
    }


def _refuse_without_effect(replay: Replay, overrides: Mapping[str, Sequence[str]]) -> None:
    """Refuse to set or swap what is not computed.

    Raises:
        GraphError: with each such option.
    """
    options = [(f"--set {text}", text.partition(".")[0].strip()) for text in overrides["sets"]]
    options += [(f"--swap {text}", text.partition("=")[0].strip()) for text in overrides["swaps"]]
    problems = without_effect(replay, options)
    if problems:
        raise GraphError(problems)
