"""`lodeflow nodes`."""

from __future__ import annotations

import inspect
import re
from pathlib import Path
from typing import Any, get_args

import click
from pydantic import BaseModel

from lodeflow.cli.options import JSON
from lodeflow.cli.output import print_json
from lodeflow.messages.message import Message
from lodeflow.messages.units import Dimensionless
from lodeflow.node import Node, Source
from lodeflow.params import docs_of, models_of, unit_of
from lodeflow.registry import Registry, registry
from lodeflow.sync import describe


@click.command()
@click.argument("name", required=False)
@JSON
def command(name: str | None, as_json: bool) -> None:
    """List the installed plugins, or document one: ports, units, parameters, source.

    NAME may also be module:Class, for a plugin in a file that is not packaged.
    """
    known = registry()
    for package, why in known.broken.items():
        click.echo(f"package {package} is broken and left out: {why}", err=True)
    if name is not None:
        found = document(name, known.load(name))
        print_json(found) if as_json else click.echo(as_text(found))
        return
    rows = {entry: first_line(known, entry) for entry in sorted(known.nodes)}
    if as_json:
        print_json({n: {"summary": s, "package": known.nodes[n].package} for n, s in rows.items()})
        return
    width = max(map(len, rows), default=0)
    for entry, summary in rows.items():
        click.echo(f"{entry:{width}}  {summary}")


def first_line(known: Registry, name: str) -> str:
    """Return the first line of a plugin's docstring; why it cannot be loaded if it cannot."""
    try:
        return (inspect.getdoc(known.load(name)) or "").partition("\n")[0]
    except Exception as error:  # a broken package must not hide the others
        return f"(cannot be loaded: {error})"


def document(name: str, plugin: type[Node] | type[Source]) -> dict[str, Any]:
    """Return all that a plugin declares, as plain data."""
    spec = plugin.spec
    try:
        file = str(Path(inspect.getfile(plugin)))
    except (TypeError, OSError):
        file = "unknown"
    return {
        "name": name,
        "doc": inspect.getdoc(plugin) or "",
        "inputs": {port.name: _port(port.type, optional=port.optional) for port in spec.inputs},
        "sync": describe(spec.sync) if len(spec.inputs) > 1 else None,
        "outputs": {port.name: _port(port.type) for port in spec.outputs},
        "params": params_of(plugin.Params),
        "example": dict(plugin.example),
        "file": file,
    }


def _port(kind: type[Message], *, optional: bool = False) -> dict[str, Any]:
    fields = {
        field.name: {"unit": field.unit.symbol, "shape": list(field.shape)} for field in kind.fields
    }
    return {"type": kind.__name__, "ros": kind.ros, "fields": fields, "optional": optional}


def params_of(params: type[BaseModel]) -> dict[str, Any]:
    """Return all that is declared of parameters, as plain data."""
    return {
        key: {
            "type": _type_name(field.annotation),
            "unit": unit_of(field.metadata).symbol,
            "default": None if field.is_required() else _plain(field.default),
            "required": field.is_required(),
            "doc": docs_of(params).get(key, ""),
            "params": {
                k: v for group in models_of(field.annotation) for k, v in params_of(group).items()
            },
        }
        for key, field in params.model_fields.items()
    }


def _plain(value: Any) -> Any:
    if isinstance(value, BaseModel):
        return {key: _plain(item) for key, item in value}
    if isinstance(value, (list, tuple)):
        return [_plain(item) for item in value]
    return value.tolist() if hasattr(value, "tolist") else value


def _type_name(annotation: Any) -> str:
    if "ndarray" in str(annotation):
        return "array"
    if isinstance(annotation, type) and not get_args(annotation):
        return annotation.__name__
    return re.sub(r"\b(?:\w+\.)+(\w+)", r"\1", str(annotation))


def as_text(found: dict[str, Any]) -> str:
    """Return the documentation of a plugin for a terminal."""
    lines = [found["name"], "", found["doc"], ""]
    for side in ("inputs", "outputs"):
        if found[side]:
            lines.append(f"{side}:")
        for name, port in found[side].items():
            optional = " (optional)" if port["optional"] else ""
            lines.append(f"  {name}: {port['type']} [{port['ros']}]{optional}")
            for field, facts in port["fields"].items():
                shape = f" {tuple(facts['shape'])}" if facts["shape"] else ""
                unit = facts["unit"] or Dimensionless.symbol or "-"
                lines.append(f"    {field}{shape}: {unit}")
        if side == "inputs" and found["sync"]:
            lines.append(f"  inputs meet by: {found['sync']}")
    if found["params"]:
        lines.append("params:")
    lines += param_lines(found["params"], "  ")
    if found["example"]:
        lines.append("example:")
        lines += [f"  {key}: {value}" for key, value in found["example"].items()]
    lines += ["", f"file: {found['file']}"]
    return "\n".join(lines)


def param_lines(params: dict[str, Any], indent: str) -> list[str]:
    """Return parameters as lines for a terminal; see `params_of`."""
    lines = []
    for name, facts in params.items():
        value = "required" if facts["required"] else f"default {facts['default']}"
        unit = f" [{facts['unit']}]" if facts["unit"] else ""
        lines.append(f"{indent}{name}: {facts['type']}{unit}, {value}")
        lines += [f"{indent}  {line}" for line in facts["doc"].splitlines()]
        lines += param_lines(facts["params"], f"{indent}  ")
    return lines
