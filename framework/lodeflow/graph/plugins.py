"""Plugins as a graph file names them, and what their parameters are called and mean."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Annotated, get_args, get_origin

from pydantic import BaseModel
from pydantic.fields import FieldInfo

from lodeflow.errors import NodeError
from lodeflow.messages.units import Dimensionless, Unit
from lodeflow.node import Node, Source
from lodeflow.params import docs_of, models_of, unit_of
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
    found = None
    for model, name in _steps(params, path):
        found = model.model_fields[name]
    return found


def doc_of(params: type[BaseModel], path: Iterable[str | int]) -> str:
    """Return what is said of the innermost field on the path of a value; "" for nothing."""
    found = ""
    for model, name in _steps(params, path):
        found = docs_of(model).get(name, "")
    return found


def _steps(
    params: type[BaseModel], path: Iterable[str | int]
) -> Iterator[tuple[type[BaseModel], str]]:
    """Yield the models and fields on the path of a value."""
    models = [params]
    for name in path:
        having = [model for model in models if str(name) in model.model_fields]
        if having:
            yield having[0], str(name)
            models = models_of(having[0].model_fields[str(name)].annotation)


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
