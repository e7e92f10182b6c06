"""Plugins as a graph file names them, and what their parameters are called and mean."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Annotated, Any, get_args, get_origin

from pydantic import BaseModel
from pydantic.fields import FieldInfo

from lodeflow.errors import NodeError
from lodeflow.messages.units import Dimensionless, Unit
from lodeflow.node import Node, Source
from lodeflow.params import unit_of
from lodeflow.registry import registry

Plugin = type[Node] | type[Source]


def load_plugin(use: str) -> Plugin:
    """Return the class that `use` names.

    Raises:
        NodeError: nothing of that name, or it cannot be imported, or it is no plugin.
    """
    if use.startswith("graph:"):
        raise NodeError("a graph inside a graph ('graph:...') is not possible yet; name a plugin")
    return registry().load(use)


def field_of(params: type[BaseModel], path: Iterable[str | int]) -> FieldInfo | None:
    """Return the innermost field on the path of a value, through nested models and lists."""
    found: FieldInfo | None = None
    models = [params]
    for name in path:
        fields = [field for m in models if (field := m.model_fields.get(str(name)))]
        if fields:
            found = fields[0]
            models = models_of(found.annotation)
    return found


def models_of(annotation: Any) -> list[type[BaseModel]]:
    """Return the nested models in an annotation such as `Inner | None` or `list[Inner]`."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return [annotation]
    return [model for inner in get_args(annotation) for model in models_of(inner)]


def names_of(params: type[BaseModel], above: Iterable[str | int]) -> list[str]:
    """Return the names that a mapping in the parameters may have."""
    field = field_of(params, above)
    models = [params] if field is None else models_of(field.annotation)
    return [name for model in models for name in model.model_fields]


def unit(field: FieldInfo | None) -> type[Unit]:
    """Return the unit of a parameter, also where it is optional or a list."""
    if field is None:
        return Dimensionless
    found = unit_of(field.metadata)
    pending = [field.annotation]
    while found is Dimensionless and pending:
        annotation = pending.pop()
        arguments = get_args(annotation)
        if get_origin(annotation) is Annotated:
            found = unit_of(list(arguments[1:]))
        pending.extend(arguments)
    return found
