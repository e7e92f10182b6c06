"""`lodeflow import`."""

from __future__ import annotations

import sys
from pathlib import Path

import click

from lodeflow.cli.report import report
from lodeflow.errors import NodeError, did_you_mean
from lodeflow.graph.model import Graph, GraphNode
from lodeflow.node import Source
from lodeflow.registry import load_object, registry
from lodeflow.supervisor.run import run


@click.command()
@click.argument("format", metavar="FORMAT")
@click.argument("file", type=click.Path(exists=True, path_type=Path))
@click.argument("recording", metavar="REC", type=click.Path(dir_okay=False, path_type=Path))
def command(format: str, file: Path, recording: Path) -> int:  # noqa: A002 (the word on the line)
    """Turn a file of sensor data into a recording with a stream per sensor.

    FORMAT is one that an installed plugin package knows.
    """
    formats = registry().importers
    if format not in formats:
        known = ", ".join(sorted(formats)) or "none"
        raise click.UsageError(
            f"no format {format!r}{did_you_mean(format, formats)} (installed: {known})"
        )
    source = load_object(formats[format].path)
    if not (isinstance(source, type) and issubclass(source, Source)):
        raise NodeError(f"importer {format!r}: {formats[format].path} is no Source")
    params = source.Params.model_validate({"file": str(file)})
    node = GraphNode(format, format, source, params)
    document = {
        "lodeflow": 1,
        "name": f"import-{format}",
        "nodes": {format: {"use": formats[format].path, "params": {"file": str(file)}}},
    }
    graph = Graph(f"import-{format}", {format: node}, document=document)
    summary = run(graph, record=str(recording), command=sys.argv[1:])
    if summary.error is not None and not any(
        count for counters in summary.counters.values() for count in counters.sent.values()
    ):
        # Nothing was in the file; a recording without data would stand in the way of the next try.
        recording.unlink(missing_ok=True)
        summary.recording = None
    return report(summary)
