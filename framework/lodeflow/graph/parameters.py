"""Parameters of a node: what pydantic finds wrong with them, in our words and at its place."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from pydantic import ValidationError

from lodeflow.errors import MessageError, did_you_mean
from lodeflow.graph.layers import merge, read_setting
from lodeflow.graph.plugins import doc_of, field_of, names_of, unit
from lodeflow.graph.problems import Origin, Place, Problems, join, show
from lodeflow.graph.tree import Tree
from lodeflow.messages.units import Dimensionless, Unit
from lodeflow.node import Configured
from lodeflow.params import Params

Loc = tuple[str | int, ...]

_SHOULD: dict[str, str] = {
    "int_type": "should be an integer",
    "int_from_float": "should be an integer",
    "int_parsing": "should be an integer",
    "bool_type": "should be true or false",
    "bool_parsing": "should be true or false",
    "string_type": "should be a text",
    "path_type": "should be a path",
    "greater_than": "should be greater than {gt}",
    "greater_than_equal": "should be at least {ge}",
    "less_than": "should be less than {lt}",
    "less_than_equal": "should be at most {le}",
    "multiple_of": "should be a multiple of {multiple_of}",
    "finite_number": "should be a finite number",
    "literal_error": "should be {expected}",
    "enum": "should be {expected}",
    "none_required": "should be null",
    "dict_type": "should be a mapping",
    "model_type": "should be a mapping",
    "model_attributes_type": "should be a mapping",
    "dataclass_type": "should be a mapping",
    "string_too_short": "should have at least {min_length} characters",
    "string_too_long": "should have at most {max_length} characters",
    "string_pattern_mismatch": "should match {pattern}",
}
_BOUNDS = ("greater_than", "greater_than_equal", "less_than", "less_than_equal")
_LISTS = ("list_type", "tuple_type", "set_type", "frozen_set_type", "iterable_type")


def read_params(
    plugin: type[Configured],
    use: str,
    tree: Tree | None,
    path: str,
    owner: Place,
    problems: Problems,
) -> Params | None:
    """Return the checked parameters of a node, or None after adding every problem with them.

    Values mean what they say in YAML: '5' in quotes is no number, and 1 is not true.

    Args:
        plugin: class of the node.
        use: its name in the graph.
        tree: the mapping of parameters; None for none.
        path: of the mapping.
        owner: place for what is missing when there is no mapping.
        problems: where problems are added.
    """
    given = Tree({}, owner) if tree is None or tree.value is None else tree
    if not isinstance(given.value, dict):
        given.refuse(problems, path, f"should be a mapping of names, got {show(given.plain())}")
        return None
    params, found = _validate(plugin, given, path, problems)
    if not found:
        return params
    _report(plugin, use, given, path, found, problems)
    return None


def settings(plugin: type[Configured], use: str, options: Sequence[str]) -> Params:
    """Return the parameters that options set, of something that stands in no graph.

    Args:
        plugin: the class.
        use: how to name it.
        options: texts "name=value"; the value is YAML.

    Raises:
        GraphError: with each option that does not fit.
    """
    problems = Problems()
    origin = Origin("--set")
    tree = Tree({}, Place(origin))
    for rank, option in enumerate(options):
        if over := read_setting(option, rank, problems):
            tree = merge(tree, over, "", problems)
    params = read_params(plugin, use, tree, "", tree.place, problems)
    if params is None or len(problems):
        raise problems.error()
    return params


@dataclass(frozen=True)
class _Error:
    """What pydantic says of one value.

    Attributes:
        kind: its type, in pydantic's words.
        message: its text.
        context: numbers and names in the text.
        value: the value, or the mapping in which a name is missing or strange.
        loc: the path of the value, without pydantic's own marks for members of a union.
        name: the name that is missing, strange, or has a wrong default; else "".
    """

    kind: str
    message: str
    context: Mapping[str, Any]
    value: Tree
    loc: Loc
    name: str = ""

    @classmethod
    def of(cls, item: Mapping[str, Any], given: Tree) -> _Error:
        """Return an item of `ValidationError.errors()` with its value found."""
        value, loc = given, list[str | int]()
        path: Loc = item["loc"]
        strange = item["type"] == "extra_forbidden"
        for name in path[:-1] if strange else path:
            if isinstance(name, int) and name < len(value.items):
                value = value.items[name]
            elif str(name) in value.entries:
                value = value.entries[str(name)]
            else:
                continue
            loc.append(name)
        named = strange or item["type"] == "missing" or (path and not loc)
        return cls(
            item["type"],
            item["msg"],
            item.get("ctx", {}),
            value,
            tuple(loc),
            str(path[-1]) if named else "",
        )


def _validate(
    plugin: type[Configured], given: Tree, path: str, problems: Problems
) -> tuple[Params | None, list[_Error]]:
    """Return the parameters, and what pydantic finds wrong with them.

    A strict pass, as of JSON, judges values as they are written. Defaults, and what a unit makes
    of a text, are no JSON and judged by a second pass.
    """
    plain = given.plain()
    found: list[_Error] = []
    try:
        try:
            plugin.Params.model_validate_json(json.dumps(plain), strict=True)
        except ValidationError as error:
            for item in error.errors(include_url=False):
                wrong = _Error.of(item, given)
                named = wrong.kind in ("missing", "extra_forbidden")
                if named or (not wrong.name and wrong.value.plain() == item["input"]):
                    found.append(wrong)
        told = {(wrong.loc, wrong.name) for wrong in found}
        try:
            return plugin.Params.model_validate(plain), found
        except ValidationError as error:
            items = [_Error.of(item, given) for item in error.errors(include_url=False)]
            return None, found + [wrong for wrong in items if (wrong.loc, wrong.name) not in told]
    except Exception as error:  # a validator of the plugin's author may raise anything
        what = f"the check of these parameters failed: {type(error).__name__}: {error}"
        problems.add(given.place, path, what)
        return None, []


def _report(
    plugin: type[Configured],
    use: str,
    given: Tree,
    path: str,
    found: list[_Error],
    problems: Problems,
) -> None:
    guessed, before = "", len(problems)
    for error in (error for error in found if error.kind == "extra_forbidden"):
        known = names_of(plugin.Params, error.loc)
        if error.name in known:
            continue  # another member of a union has it
        near = did_you_mean(error.name, known)
        guessed += near
        has = "" if near else f" (it has {', '.join(known) or 'none'})"
        place = error.value.entries.get(error.name, error.value).name_place
        what = f"no such parameter of '{use}'{near}{has}"
        problems.add(place, join(path, *error.loc, error.name), what)
    wrong: dict[Loc, list[_Error]] = {}
    for error in found:
        where = join(path, *error.loc, error.name)
        if error.kind == "missing":
            if f"'{error.name}'" not in guessed:  # the name is there, misspelt
                what = f"missing; '{use}' needs it{_meaning(plugin, (*error.loc, error.name))}"
                problems.add(error.value.name_place, where, what)
        elif error.kind != "extra_forbidden" and error.name:
            what = f"the default of '{use}' is wrong: {_words(error, Dimensionless)}"
            problems.add(given.name_place, where, what)
        elif not error.name:
            wrong.setdefault(error.loc, []).append(error)
    for loc, errors in wrong.items():
        _report_value(plugin, path, loc, errors, problems)
    if len(problems) == before:  # each member of a union misses what another one has
        what = f"fits none of the forms that it may have, got {show(found[0].value.plain())}"
        found[0].value.refuse(problems, join(path, *found[0].loc), what)


def _report_value(
    plugin: type[Configured], path: str, loc: Loc, errors: list[_Error], problems: Problems
) -> None:
    """Add one problem for all that members of a union say of one value."""
    of = unit(field_of(plugin.Params, loc))
    value = errors[0].value
    first, *more = dict.fromkeys(_words(error, of) for error in errors)
    text = " or ".join([first, *(other.removeprefix("should be ") for other in more)])
    if {error.kind for error in errors} <= {"array", "unit"}:
        value, inner = _culprit(value, of)
        loc = (*loc, *inner)
        if inner and errors[0].kind == "array":
            text = "should be a finite number"
    if loc and errors[0].kind != "unit":
        text += f", got {show(value.plain())}{_near(errors)}"
    value.refuse(problems, join(path, *loc), text)


def _words(error: _Error, of: type[Unit]) -> str:
    """Return what a value should be, without what it is."""
    kind = error.kind
    context = {
        name: f"{number:g}" if isinstance(number, float) else number
        for name, number in error.context.items()
    }
    if kind in _SHOULD:
        text = _SHOULD[kind].format(**context)
        return f"{text} {of.symbol}" if kind in _BOUNDS and of.symbol else text
    if kind in ("float_type", "float_parsing"):
        if of is Dimensionless:
            return "should be a number"
        return f"should be a number in {of.symbol}, or a text with a unit ({of.quantity()})"
    if kind == "too_short":
        return f"should have at least {context['min_length']} items"
    if kind == "too_long":
        return f"should have at most {context['max_length']} items"
    if kind in _LISTS:
        return "should be a list"
    if kind in ("value_error", "assertion_error"):
        return str(context.get("error", error.message))
    return error.message.removeprefix("Input ").replace(" a valid ", " a ")


def _near(errors: list[_Error]) -> str:
    expected = "".join(str(error.context.get("expected", "")) for error in errors)
    return did_you_mean(str(errors[0].value.value), re.findall(r"'([^']*)'", expected))


def _culprit(value: Tree, of: type[Unit]) -> tuple[Tree, Loc]:
    """Return the one item that makes a list of numbers wrong, and its path, if there is one."""
    wrong: list[tuple[Tree, Loc]] = []

    def visit(tree: Tree, loc: Loc) -> None:
        for at, item in enumerate(tree.items):
            visit(item, (*loc, at))
        if not tree.items and not _is_number(tree.value, of):
            wrong.append((tree, loc))

    visit(value, ())
    return wrong[0] if len(wrong) == 1 else (value, ())


def _is_number(value: Any, of: type[Unit]) -> bool:
    if isinstance(value, str):
        try:
            value = of.parse(value)
        except MessageError:
            return False
    return isinstance(value, (int, float)) and value - value == 0  # neither infinite nor NaN


def _meaning(plugin: type[Configured], loc: Loc) -> str:
    symbol = unit(field_of(plugin.Params, loc)).symbol
    described = doc_of(plugin.Params, loc).rstrip(".")
    text = " ".join(part for part in (described, f"[{symbol}]" if symbol else "") if part)
    return f": {text}" if text else ""
