"""`lodeflow echo`."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterator
from typing import Any

import click

from lodeflow.cli.looking_in import name_of, say, watching, where, write
from lodeflow.cli.output import shown_unit
from lodeflow.messages.fields import FieldSpec
from lodeflow.messages.message import Message
from lodeflow.supervisor.looking import Where
from lodeflow.transport.onlooker import Sighting
from lodeflow.transport.viewing import StreamView, type_of


@click.command()
@click.argument("name", metavar="[GRAPH/]NODE[.PORT]|KEY")
@click.option("-n", "--count", type=click.IntRange(min=1), help="End after so many messages.")
@click.option("--json", "as_json", is_flag=True, help="One JSON object per line, in SI units.")
@where
def command(name: str, count: int | None, as_json: bool, where: Where) -> int:
    """Print the messages of a stream of a running graph, one per line, as they come.

    A name without a port means all ports of the node. Angles are shown in degrees, in JSON in SI
    units. A Zenoh key expression, wildcards included, is taken as it is. Whoever reads slowly
    misses messages, which is said at the end; the run never waits.
    """
    left = math.inf if count is None else count
    with watching([name], where) as watched:
        try:
            while left > 0 and not watched.over:
                for stream, sighting in watched.take(1.0):
                    lines = list(_lines(stream, sighting, left, as_json=as_json))
                    left -= len(lines)
                    if not write("".join(lines)):
                        return 0
                    if left <= 0:
                        break
        finally:
            say(watched.notes())
        if left > 0:
            say([f"{name}: the run has ended"])
    return 1 if count is not None and left > 0 else 0


def _lines(stream: StreamView, sighting: Sighting, most: float, *, as_json: bool) -> Iterator[str]:
    """Yield a line for each message of a put, no more than so many."""
    before = stream.undecodable
    block = stream.read(sighting)
    if block is not None:
        rows = _json_rows if as_json else _text_rows
        yield from rows(name_of(stream.key), block[: int(min(most, len(block)))])
    elif stream.undecodable == before:
        yield _raw(name_of(stream.key), sighting, as_json=as_json)


def _raw(name: str, sighting: Sighting, *, as_json: bool) -> str:
    """Return the line of a put whose type is not known."""
    size, kind, frame = len(sighting.payload), type_of(sighting), sighting.frame
    if as_json:
        t = None if frame is None else frame.first
        return json.dumps({"stream": name, "t": t, "type": kind, "bytes": size}) + "\n"
    time = "" if frame is None else f"  {_seconds(frame.first)}"
    what = f" of {kind}, a type that is not known here" if kind else ""
    return f"{name}{time}  {size} bytes{what}\n"


def _text_rows(name: str, block: Message) -> Iterator[str]:
    columns = [_texts(block, field, value) for field, value in _fields(block)]
    for index, t in enumerate(block.t.tolist()):
        cells = "  ".join(column(index) for column in columns)
        yield f"{name}  {_seconds(t)}  {cells}\n"


def _json_rows(name: str, block: Message) -> Iterator[str]:
    columns = [(field, value.tolist()) for field, value in _fields(block)]
    for index, t in enumerate(block.t.tolist()):
        fields = {
            field.name: {"value": _plain(values[index]), "unit": field.unit.symbol}
            for field, values in columns
        }
        line = {"stream": name, "t": t, "type": block.ros, "fields": fields}
        yield json.dumps(line, ensure_ascii=False, allow_nan=False) + "\n"


def _fields(block: Message) -> Iterator[tuple[FieldSpec, Any]]:
    return zip(block.fields, block.values(), strict=True)


def _texts(block: Message, field: FieldSpec, value: Any) -> Callable[[int], str]:
    """Return what gives the text of a field in a row: "heading=90 deg"."""
    factor, symbol = shown_unit(field.unit)
    unit = f" {symbol}" if symbol else ""
    if field.integer:
        names = {v: f" ({n.lower()})" for n, v in block.constants.items() if field.ros == "uint8"}
        numbers = value.tolist()
        return lambda index: f"{field.name}={numbers[index]}{names.get(numbers[index], '')}{unit}"
    rows = (value * factor).reshape(len(block), -1).tolist()
    if not field.shape:
        return lambda index: f"{field.name}={rows[index][0]:.6g}{unit}"

    def text(index: int) -> str:
        return f"{field.name}=[{', '.join([f'{x:.6g}' for x in rows[index]])}]{unit}"

    return text


def _seconds(t: int) -> str:
    """Return a stamp in seconds, to the nanosecond."""
    whole, rest = divmod(abs(t), 1_000_000_000)
    return f"{'-' if t < 0 else ''}{whole}.{rest:09d}"


def _plain(value: Any) -> Any:
    """Return a field for JSON, which has no NaN."""
    if isinstance(value, list):
        return [_plain(item) for item in value]
    return value if math.isfinite(value) else None
