"""JSON Schema of graph files, from the installed plugins, so that editors complete and check."""

from __future__ import annotations

import inspect
import re
from collections.abc import Mapping
from typing import Any, get_args

from pydantic import BaseModel
from pydantic.json_schema import GenerateJsonSchema

from lodeflow.errors import NodeError
from lodeflow.graph.check import FORMAT, RECORDED_TO
from lodeflow.graph.model import Loss, OnCrash, Restart
from lodeflow.graph.plugins import Plugin, doc_of, load_plugin, unit
from lodeflow.params import file_parameter, models_of
from lodeflow.registry import registry

Json = dict[str, Any]

DIALECT = "https://json-schema.org/draft/2020-12/schema"
_NAME = "^[a-z][a-z0-9_]*$"
_GROUP = "^[a-z][a-z0-9_-]*$"
_STREAM_NAME = r"^[a-z][a-z0-9_]*(\.[A-Za-z_][A-Za-z0-9_]*)?$"
_GROUP_NODES: Json = {"type": "array", "items": {"type": "string"}, "minItems": 1}
_ARG: Json = {"$ref": "#/$defs/arg"}
_STREAM: Json = {"$ref": "#/$defs/stream"}
_KEY: Json = {
    "type": "object",
    "description": "What any Zenoh program puts on a key, wildcards included.",
    "properties": {
        "key": {"type": "string", "minLength": 1},
        "type": {"type": "string"},
        "max_delay": {"type": ["number", "string"], "default": 0.1},
        "allow": {"type": "array", "items": {"enum": list(get_args(Loss))}},
    },
    "required": ["key"],
    "additionalProperties": False,
}
_BOUNDS = {"gt": "exclusiveMinimum", "ge": "minimum", "lt": "exclusiveMaximum", "le": "maximum"}
_ABOUT = ("description", "default")


def schema(plugins: Mapping[str, Plugin] | None = None) -> Json:
    """Return the JSON Schema (2020-12) of graph files.

    Args:
        plugins: classes by the name that `use` gives them; the installed ones if None. One that
            cannot be imported is listed, with the reason, and its parameters are left open.
    """
    found: Mapping[str, Plugin | NodeError] = _installed() if plugins is None else plugins
    known = {name: plugin for name, plugin in found.items() if not isinstance(plugin, NodeError)}
    choices = [{"const": name, "description": _about(plugin)} for name, plugin in found.items()]
    definitions: Json = {
        "arg": {
            "type": "string",
            "pattern": r"\$\{[a-z][a-z0-9_]*\}",
            "description": "A value from `args`, which --arg name=value changes.",
        },
        "stream": {
            "type": "string",
            "pattern": _STREAM_NAME + r"|\$\{",
            "description": "node.port, or node where it has one output.",
        },
        "node": {
            "type": "object",
            "properties": {
                "use": {
                    "description": "The plugin: its name, or module:Class for one not installed.",
                    "anyOf": [
                        *choices,
                        {"type": "string", "pattern": r"^(?!graph:)[\w.]+:\w+$"},
                        _ARG,
                    ],
                },
                "params": {"type": "object", "description": "Parameters of the plugin."},
                "inputs": {
                    "type": "object",
                    "description": "Which stream each input port gets.",
                    "additionalProperties": {"anyOf": [_STREAM, _KEY]},
                },
                "when": {
                    "type": "object",
                    "description": "Step only while the last value of a stream has such a name.",
                    "propertyNames": {"pattern": _STREAM_NAME},
                    "additionalProperties": {
                        "type": "array",
                        "items": {"type": "string"},
                        "minItems": 1,
                    },
                },
                "keys": {
                    "type": "object",
                    "description": "Zenoh keys of outputs, beside lodeflow/<graph>/<node>/<port>.",
                    "additionalProperties": {"type": "string"},
                },
                "allow": {
                    "description": "Losses of a source that do not fail the run.",
                    "type": "array",
                    "items": {"enum": list(get_args(Loss))},
                },
            },
            "required": ["use"],
            "additionalProperties": False,
            "allOf": [_for_plugin(name, plugin) for name, plugin in known.items()],
        },
    }
    for name, plugin in known.items():
        definitions |= _params(name, plugin)
    return {
        "$schema": DIALECT,
        "title": "lodeflow graph",
        "type": "object",
        "properties": {
            "lodeflow": {"const": FORMAT, "description": "Version of the file format."},
            "name": {
                "type": "string",
                "pattern": _GROUP + r"|\$\{",
                "description": "Name of the graph, part of its keys and file names.",
            },
            "args": {
                "type": "object",
                "description": "Values that ${name} stands for; --arg name=value changes them.",
                "propertyNames": {"pattern": _NAME},
            },
            "nodes": {
                "type": "object",
                "description": "The nodes by name.",
                "propertyNames": {"pattern": _NAME},
                "additionalProperties": {"$ref": "#/$defs/node"},
                "minProperties": 1,
            },
            "record": {
                "type": ["object", "null"],
                "description": "What is recorded by default.",
                "properties": {
                    "to": {"type": "string", "default": RECORDED_TO, "minLength": 1},
                    "streams": {
                        "anyOf": [{"const": "all"}, {"type": "array", "items": _STREAM}, _ARG],
                        "default": "all",
                    },
                },
                "additionalProperties": False,
            },
            "processes": {
                "type": "object",
                "description": "Nodes of each process; each node in one of them.",
                "propertyNames": {"pattern": _GROUP},
                "additionalProperties": {
                    "anyOf": [
                        _GROUP_NODES,
                        {
                            "type": "object",
                            "properties": {
                                "nodes": _GROUP_NODES,
                                "restart": {"enum": list(get_args(Restart)), "default": "never"},
                                "limit": {"type": "integer", "minimum": 0, "default": 5},
                                "on_crash": {"enum": list(get_args(OnCrash)), "default": "stop"},
                                "allow_gaps": {"type": "boolean", "default": False},
                                "latest": {"type": "boolean", "default": False},
                            },
                            "required": ["nodes"],
                            "additionalProperties": False,
                        },
                    ]
                },
            },
        },
        "required": ["lodeflow", "name", "nodes"],
        "additionalProperties": False,
        "$defs": definitions,
    }


def _installed() -> dict[str, Plugin | NodeError]:
    found: dict[str, Plugin | NodeError] = {}
    for name in sorted(registry().nodes):
        try:
            found[name] = load_plugin(name)
        except NodeError as error:
            found[name] = error
    return found


def _about(plugin: Plugin | NodeError) -> str:
    if isinstance(plugin, NodeError):
        return f"Cannot be used: {plugin}"
    return (inspect.getdoc(plugin) or "").partition("\n\n")[0].replace("\n", " ")


def _for_plugin(name: str, plugin: Plugin) -> Json:
    """Return the conditional part that holds where `use` is this plugin."""
    spec = plugin.spec
    properties: Json = {"params": {"$ref": f"#/$defs/{_key(name)}"}}
    required = []
    if any(field.is_required() for field in plugin.Params.model_fields.values()):
        required.append("params")
    if spec.is_source:
        properties |= {"inputs": {"maxProperties": 0}, "when": {"maxProperties": 0}}
    else:
        needed = [port.name for port in spec.inputs if not port.optional]
        properties["allow"] = False
        properties["inputs"] = {
            "properties": {
                port.name: {**_STREAM, "description": f"A stream of {port.type.__name__}."}
                for port in spec.inputs
            },
            "required": needed,
            "additionalProperties": False,
        }
        required += ["inputs"] if needed else []
    return {
        "if": {"properties": {"use": {"const": name}}, "required": ["use"]},
        "then": {"properties": properties, "required": required},
    }


class _Lenient(GenerateJsonSchema):
    """Leaves open what has no JSON form, where pydantic would refuse the whole model."""

    def handle_invalid_for_json_schema(self, schema: Any, error_info: str) -> Json:
        """Return the schema that allows everything."""
        return {}

    def emit_warning(self, kind: Any, detail: str) -> None:
        """Say nothing of a default that has no JSON form; the schema then names none."""


def _key(name: str) -> str:
    return re.sub(r"[^\w-]", "_", name) + ".params"


def _params(name: str, plugin: Plugin) -> Json:
    """Return the definitions that describe the parameters of a plugin."""
    made = plugin.Params.model_json_schema(
        ref_template=f"#/$defs/{_key(name)}.{{model}}", schema_generator=_Lenient
    )
    made.pop("description", None)
    if "required" in made and (file := file_parameter(plugin.Params)):
        made["anyOf"] = [{"required": made.pop("required")}, {"required": [file]}]
    inner = made.pop("$defs", {})
    _describe(plugin.Params, made)
    for model in _nested(plugin.Params):
        _describe(model, inner.get(model.__name__, {}))
    definitions = {_key(name): made, **{f"{_key(name)}.{key}": d for key, d in inner.items()}}
    return {key: _open(definition) for key, definition in definitions.items()}


def _nested(params: type[BaseModel]) -> list[type[BaseModel]]:
    """Return the models inside of parameters, and inside of those."""
    fields = params.model_fields.values()
    models = [model for field in fields for model in models_of(field.annotation)]
    return [found for model in models for found in (model, *_nested(model))]


def _describe(params: type[BaseModel], definition: Json) -> None:
    """Say what each parameter means, and its unit."""
    for name, described in definition.get("properties", {}).items():
        unit_of_it = unit(params.model_fields.get(name))
        parts = [doc_of(params, [name])]
        parts.append(f"[{unit_of_it.quantity()}]" if unit_of_it.symbol else "")
        if text := " ".join(part for part in parts if part):
            described["description"] = text


def _open(part: Json) -> Json:
    """Return a schema in which ${arg} may stand for each value of a mapping or list."""
    part = {_BOUNDS.get(key, key): value for key, value in part.items() if key != "title"}
    for key in ("properties", "patternProperties"):
        if key in part:
            part[key] = {name: _or_arg(_open(value)) for name, value in part[key].items()}
    for key in ("items", "additionalProperties"):
        if isinstance(part.get(key), dict):
            part[key] = _or_arg(_open(part[key]))
    if "prefixItems" in part:
        part["prefixItems"] = [_or_arg(_open(item)) for item in part["prefixItems"]]
    for key in ("anyOf", "oneOf", "allOf"):
        if key in part:
            part[key] = [_open(item) for item in part[key]]
    return part


def _or_arg(part: Json) -> Json:
    about = {key: part[key] for key in _ABOUT if key in part}
    rest = {key: value for key, value in part.items() if key not in about}
    return {**about, "anyOf": [rest, _ARG]} if rest else about
