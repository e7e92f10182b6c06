"""`lodeflow export`."""

from __future__ import annotations

from pathlib import Path

import click

from lodeflow.cli.message_types import declare_installed
from lodeflow.cli.options import JSON
from lodeflow.cli.output import RESULT, STATUS, print_json
from lodeflow.recording.columns import stream_of
from lodeflow.recording.events import EVENT_TOPICS
from lodeflow.recording.export import export
from lodeflow.recording.reader import Recording


@click.command()
@click.argument("rec", metavar="REC", type=click.Path(dir_okay=False, path_type=Path))
@click.option("--to", "form", required=True, type=click.Choice(["csv", "parquet"]), help="Format.")
@click.argument("out", metavar="OUT", type=click.Path(path_type=Path))
@click.argument("streams", metavar="[STREAM]...", nargs=-1)
@JSON
def command(rec: Path, form: str, out: Path, streams: tuple[str, ...], as_json: bool) -> None:
    """Write streams of a recording into tables, a column per component with its unit.

    OUT is a folder that gets a file per stream; or a file (OUT.csv, OUT.parquet) for one STREAM.
    Without a STREAM, all of them; a STREAM is named as in the graph, or by its topic.
    """
    declare_installed()
    with Recording(rec) as recording:
        files, left_out = export(recording, form, out, streams)
    for topic, why in left_out.items():
        if topic not in EVENT_TOPICS:
            STATUS.print(f"left out: {why}", soft_wrap=True, markup=False)
    if as_json:
        print_json({stream_of(topic): str(path) for topic, path in files.items()})
        return
    for path in files.values():
        RESULT.print(str(path), soft_wrap=True, markup=False)
