"""`lodeflow calibrate`."""

from __future__ import annotations

import importlib
import inspect
import sys
from pathlib import Path
from typing import Any

import click
import numpy as np

from lodeflow.calibration import Calibration, CalibrationTool, Quantity
from lodeflow.cli.message_types import declare_installed
from lodeflow.cli.nodes_command import param_lines, params_of
from lodeflow.cli.options import JSON
from lodeflow.cli.output import RESULT, STATUS, print_json
from lodeflow.errors import CalibrationError, NodeError
from lodeflow.registry import registry
from lodeflow.supervisor.calibrate import calibrate, load_tool


class Kinds(click.Group):
    """The kinds of calibration that installed packages bring, each a command of its own."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        return sorted(registry().calibrations)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command:
        try:
            return _command(cmd_name, load_tool(cmd_name))
        except NodeError as error:
            raise click.UsageError(str(error), ctx) from error

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        rows = []
        for kind in self.list_commands(ctx):
            try:
                rows.append((kind, (inspect.getdoc(load_tool(kind)) or "").partition("\n")[0]))
            except NodeError as error:  # a broken package must not hide the others
                rows.append((kind, f"(cannot be loaded: {error})"))
        if rows:
            with formatter.section("Kinds"):
                formatter.write_dl(rows)


@click.group(cls=Kinds)
def command() -> None:
    """Find the parameters of a calibrator from recordings.

    Each kind says with --help which streams it reads, what to record, and what may be set.
    """


def _command(kind: str, tool: type[CalibrationTool]) -> click.Command:
    @click.command(kind, help=inspect.getdoc(tool), epilog=_epilog(tool))
    @click.argument(
        "recordings",
        metavar="REC...",
        nargs=-1,
        required=True,
        type=click.Path(dir_okay=False, path_type=Path),
    )
    @click.option(
        "--to",
        required=True,
        metavar="FILE",
        type=click.Path(dir_okay=False, path_type=Path),
        help="Calibration file (YAML) to write.",
    )
    @click.option("--set", "sets", multiple=True, metavar="NAME=V", help="Set a parameter.")
    @click.option(
        "--stream",
        "streams",
        multiple=True,
        metavar="NAME=STREAM",
        help="Which stream to read, where several have the type; '' for none.",
    )
    @click.option(
        "--figure",
        metavar="PNG",
        type=click.Path(dir_okay=False, path_type=Path),
        help="Figure to draw, instead of one beside the file; '' for none.",
    )
    @JSON
    def run(
        recordings: tuple[Path, ...],
        to: Path,
        sets: tuple[str, ...],
        streams: tuple[str, ...],
        figure: Path | None,
        as_json: bool,
    ) -> None:
        declare_installed()
        done = calibrate(kind, recordings, sets=sets, streams=streams, command=sys.argv[1:])
        _write(to, done.text)
        drawn = _draw(done.found, to.with_suffix(".png") if figure is None else figure)
        if as_json:
            where = {"file": str(to), "figure": drawn and str(drawn)}
            print_json({**where, "results": done.results, "notes": list(done.found.notes)})
        else:
            _show(done.found, to, drawn)

    return run


def _epilog(tool: type[CalibrationTool]) -> str:
    """Return the streams and parameters of a tool for its help."""
    streams = [
        f"  {port.name}: {port.type.__name__}{' (optional)' if port.optional else ''}"
        for port in tool.streams
    ]
    lines = ["\b", "Streams:", *streams]  # a line of \b keeps those after it as they are
    if params := params_of(tool.Params):
        lines += ["", "\b", "Parameters:", *param_lines(params, "  ")]
    return "\n".join(lines)


def _write(path: Path, text: str) -> None:
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    except OSError as error:
        raise CalibrationError(f"{path} cannot be written: {error.strerror}") from error


def _draw(found: Calibration, path: Path) -> Path | None:
    """Save the figure if there is one, and matplotlib to draw it."""
    if found.draw is None or path == Path():
        return None
    try:
        figures: Any = importlib.import_module("matplotlib.figure")
    except ImportError:
        STATUS.print("no figure: it needs matplotlib, pip install 'lodeflow[plot]'", markup=False)
        return None
    figure = figures.Figure(figsize=(8, 5), layout="constrained")
    found.draw(figure)
    try:
        figure.savefig(path, dpi=110, metadata={"Software": None})
    except (OSError, ValueError) as error:
        raise CalibrationError(f"{path} cannot be drawn: {error}") from error
    return path


def _show(found: Calibration, to: Path, drawn: Path | None) -> None:
    rows = [row for quantity in found.quantities for row in _rows(quantity)]
    widths = [max((len(row[at]) for row in rows), default=0) for at in range(3)]
    for name, value, error, unit in rows:
        line = f"{name:{widths[0]}}  {value:{widths[1]}}  {error:{widths[2]}}  {unit}"
        RESULT.print(line.rstrip(), soft_wrap=True)
    RESULT.print()
    for note in found.notes:
        RESULT.print(f"note: {note}", soft_wrap=True)
    RESULT.print(f"wrote {to}" + (f", {drawn}" if drawn else ""), soft_wrap=True)
    if found.plugin:
        use = f"use it for a node of {found.plugin}: --set NODE.file={to}"
        RESULT.print(use, soft_wrap=True)


def _rows(quantity: Quantity) -> list[tuple[str, str, str, str]]:
    """Return a quantity as rows: one for a number, else one for each row of its last axis."""
    values = np.asarray(quantity.value)
    rows = np.atleast_2d(values.reshape(-1, values.shape[-1]) if values.ndim else values)
    errors: Any = [None] * len(rows)
    if quantity.error is not None:
        errors = np.asarray(quantity.error, dtype=float).reshape(rows.shape)
    return [
        (
            quantity.name if at == 0 else "",
            _figures(row, 6, 12),
            "" if errors[at] is None else "± " + _figures(errors[at], 2, 7),
            quantity.unit,
        )
        for at, row in enumerate(rows)
    ]


def _figures(row: Any, digits: int, width: int) -> str:
    texts = ["unknown" if value != value else f"{value:.{digits}g}" for value in row.tolist()]
    return " ".join(f"{text:>{width}}" for text in texts)
