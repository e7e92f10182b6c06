"""YAML text to a tree of values that know their places, and plain data back to YAML text.

Scalars are read by the YAML 1.2 core schema: 1e-3 is a number, `yes` and `12:30` are texts.
The tree is built from parser events, so that no nesting or alias of a hostile file can exhaust
the stack or the memory.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import yaml

from lodeflow.graph.problems import Origin, Place, Problems

Scalar = None | bool | int | float | str

DEPTH = 40
VALUES = 100_000
"""Most levels and values (aliases counted each time they are used) that one text may have."""

_BREAK = re.compile("\r\n|[\n\r\x85\u2028\u2029]")  # what YAML calls a line break
_UNREADABLE = re.compile("[^\t\n\r\x20-\x7e\x85\xa0-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")
_ARG = re.compile(r"\$\{(\w+)\}")
_HIDDEN = re.compile("\ue000(\\w+)\ue001")
_INT = re.compile(r"[-+]?[0-9]+|0x[0-9a-fA-F]+|0o[0-7]+")
_FLOAT = re.compile(r"[-+]?(?:\.[0-9]+|[0-9]+(?:\.[0-9]*)?)(?:[eE][-+]?[0-9]+)?")
_WORDS: dict[str, Scalar] = {
    **dict.fromkeys(("", "~", "null", "Null", "NULL")),
    **dict.fromkeys(("true", "True", "TRUE"), True),
    **dict.fromkeys(("false", "False", "FALSE"), False),
    **dict.fromkeys((".nan", ".NaN", ".NAN"), float("nan")),
    **{
        f"{sign}{word}": float(f"{sign}inf")
        for sign in ("", "+", "-")
        for word in (".inf", ".Inf", ".INF")
    },
}
_TAGS: dict[str, tuple[type, ...]] = {
    "str": (str,),
    "int": (int,),
    "float": (float, int),
    "bool": (bool,),
    "null": (type(None),),
}
_CORE = "tag:yaml.org,2002:"


@dataclass(frozen=True)
class Tree:
    """A value and where it was written.

    Attributes:
        value: a scalar, a tuple of trees, or a dict of trees by key.
        place: of the value.
        key: of the key that it stands under.
        note: what else to tell when the value is wrong, such as the arg it was taken from.
    """

    value: Scalar | tuple[Tree, ...] | dict[str, Tree]
    place: Place
    key: Place | None = None
    note: str = ""

    @property
    def name_place(self) -> Place:
        """Place of the key if there is one, else of the value."""
        return self.key or self.place

    @property
    def entries(self) -> dict[str, Tree]:
        """Entries of a mapping; none if it is something else."""
        return self.value if isinstance(self.value, dict) else {}

    @property
    def items(self) -> tuple[Tree, ...]:
        """Items of a list; none if it is something else."""
        return self.value if isinstance(self.value, tuple) else ()

    def plain(self) -> Any:
        """Return the value as plain data."""
        if isinstance(self.value, dict):
            return {name: entry.plain() for name, entry in self.value.items()}
        if isinstance(self.value, tuple):
            return [item.plain() for item in self.value]
        return self.value

    def refuse(self, problems: Problems, path: str, text: str) -> None:
        """Add a problem with this value."""
        problems.add(self.place, path, f"{text} ({self.note})" if self.note else text)

    def find(self, *names: str) -> Tree | None:
        """Return the value under a chain of keys, or None."""
        found: Tree | None = self
        for name in names:
            found = None if found is None else found.entries.get(name)
        return found


def read_text(path: str | Path) -> str:
    """Return the text of a file.

    Raises:
        ValueError: it cannot be read, or is not UTF-8; the text says why, without the path.
    """
    try:
        return Path(path).read_bytes().decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = error.object[: error.start].count(b"\n") + 1
        raise ValueError(f"line {line} is not UTF-8; save the file as UTF-8") from None
    except (OSError, ValueError) as error:
        why = getattr(error, "strerror", None) or str(error)
        raise ValueError(f"cannot be read: {why}") from None


def parse(text: str, origin: Origin, problems: Problems) -> Tree | None:
    """Return the only document of a text, or None after a problem that hides the rest.

    Args:
        text: YAML.
        origin: what to name as its place.
        problems: where syntax errors, keys given twice and unknown tags are added.
    """
    if origin.lines is not None:
        origin = replace(origin, lines=tuple(_BREAK.split(text)))
    if bad := _UNREADABLE.search(text):
        what = f"the character U+{ord(bad[0]):04X} is not allowed in YAML; remove it"
        problems.add(_at(origin, text, bad.start()), "", what)
        return None
    try:
        # In a flow mapping {x: ${y}}, YAML would end the text at the brace.
        return _Builder(_ARG.sub("$\ue000\\1\ue001", text), origin, problems).document()
    except _Stop as stop:
        problems.add(stop.place, "", stop.text)
    except yaml.MarkedYAMLError as error:
        place, what = _syntax(error, text, origin)
        problems.add(place, "", what if what.startswith("nested") else f"not YAML: {what}")
    return None


def scalar(text: str) -> Scalar:
    """Return what a plain (not quoted) scalar means by the YAML 1.2 core schema.

    Raises:
        ValueError: an integer with more digits than Python converts.
    """
    if text in _WORDS:
        return _WORDS[text]
    if _INT.fullmatch(text):
        return int(text, 0 if text[:2] in ("0x", "0o") else 10)
    return float(text) if _FLOAT.fullmatch(text) else text


class _Stop(Exception):
    """Parsing cannot go on."""

    def __init__(self, place: Place, text: str) -> None:
        super().__init__(text)
        self.place, self.text = place, text


class _Builder:
    """Builds a tree from the events of the parser."""

    def __init__(self, text: str, origin: Origin, problems: Problems) -> None:
        self._events = yaml.parse(text, Loader=getattr(yaml, "CSafeLoader", yaml.SafeLoader))
        self._origin = origin
        self._problems = problems
        self._anchors: dict[str, tuple[Tree, int]] = {}
        self._values = 0

    def document(self) -> Tree:
        """Return the only document; null where there is none."""
        event = next(self._events)
        while isinstance(event, (yaml.StreamStartEvent, yaml.DocumentStartEvent)):
            event = next(self._events)
        if isinstance(event, yaml.StreamEndEvent):
            return Tree(None, Place(self._origin, 1, 1, 0))
        tree = self._value(event, 0)
        next(self._events)  # the end of the document
        event = next(self._events)
        if not isinstance(event, yaml.StreamEndEvent):
            raise _Stop(self._span(event, event), "a second document; a file holds one")
        return tree

    def _span(self, first: Any, last: Any) -> Place:
        start, end = first.start_mark, last.end_mark
        length = end.column - start.column if start.line == end.line else 2**31
        return Place(self._origin, start.line + 1, start.column + 1, max(1, length))

    def _value(self, event: Any, depth: int) -> Tree:
        place = self._span(event, event)
        before = self._values
        self._count(1, place)
        if depth > DEPTH:
            raise _Stop(place, f"nested more than {DEPTH} levels deep")
        if isinstance(event, yaml.AliasEvent):
            if event.anchor not in self._anchors:
                raise _Stop(place, f"no anchor '&{event.anchor}' before this alias")
            tree, count = self._anchors[event.anchor]
            self._count(count, place)
            return tree
        if isinstance(event, yaml.ScalarEvent):
            tree = Tree(self._scalar(event, place), place)
        elif isinstance(event, yaml.SequenceStartEvent):
            tree = self._list(event, depth)
        else:
            tree = self._mapping(event, depth)
        if event.anchor is not None:
            self._anchors[event.anchor] = tree, self._values - before
        return tree

    def _count(self, values: int, place: Place) -> None:
        self._values += values
        if self._values > VALUES:
            raise _Stop(place, f"more than {VALUES} values")

    def _scalar(self, event: Any, place: Place) -> Scalar:
        text = _HIDDEN.sub("{\\1}", event.value)
        tag = self._tag(event)
        plain = event.implicit[0] or tag not in ("", "str")
        try:
            text.encode()
            meaning = scalar(text) if plain else text
        except UnicodeEncodeError:
            self._problems.add(place, "", "an escape that is not valid Unicode")
            return ""
        except ValueError:
            self._problems.add(place, "", "a number with too many digits")
            return 0
        if tag and not (tag in _TAGS and isinstance(meaning, _TAGS[tag])):
            self._unknown_tag(event, place)
        return meaning

    def _list(self, event: Any, depth: int) -> Tree:
        self._check_tag(event, "seq")
        items: list[Tree] = []
        while not isinstance(following := next(self._events), yaml.SequenceEndEvent):
            items.append(self._value(following, depth + 1))
        return Tree(tuple(items), self._span(event, following))

    def _mapping(self, event: Any, depth: int) -> Tree:
        self._check_tag(event, "map")
        entries: dict[str, Tree] = {}
        merged: dict[str, Tree] = {}
        while not isinstance(key := next(self._events), yaml.MappingEndEvent):
            place = self._span(key, key)
            if not isinstance(key, yaml.ScalarEvent):
                raise _Stop(place, "a key must be a plain word")
            name = _HIDDEN.sub("{\\1}", key.value)
            value = self._value(next(self._events), depth + 1)
            if name == "<<" and key.implicit[0]:
                merged.update(self._merged(value))
            elif name in entries:
                first = entries[name].name_place
                self._problems.add(
                    place, "", f"the key '{name}' is given twice, first in line {first.line}"
                )
            else:
                entries[name] = replace(value, key=place)
        return Tree({**merged, **entries}, self._span(event, key))

    def _merged(self, value: Tree) -> dict[str, Tree]:
        """Return what `<<: *anchor` or `<<: [*one, *two]` brings; the first to name a key wins."""
        found: dict[str, Tree] = {}
        for mapping in value.items or (value,):
            if not isinstance(mapping.value, dict):
                self._problems.add(mapping.place, "", "'<<' takes a mapping, or a list of them")
            found = {**mapping.entries, **found}
        return found

    def _tag(self, event: Any) -> str:
        """Return the name of an explicit tag of the YAML core, or "" for none."""
        if event.tag in (None, "!"):
            return ""
        return str(event.tag).removeprefix(_CORE)

    def _unknown_tag(self, event: Any, place: Place) -> None:
        tag = str(event.tag).replace(_CORE, "!!")
        self._problems.add(place, "", f"the tag '{tag}' is not known here; remove it")
        self._problems.silence(place)

    def _check_tag(self, event: Any, expected: str) -> None:
        if self._tag(event) not in ("", expected):
            self._unknown_tag(event, self._span(event, event))


def _at(origin: Origin, text: str, position: int) -> Place:
    lines = _BREAK.split(text[:position])
    return Place(origin, len(lines), len(lines[-1]) + 1)


def _syntax(error: yaml.MarkedYAMLError, text: str, origin: Origin) -> tuple[Place, str]:
    """Return the place of a syntax error, and in our words what to do."""
    problem = error.problem or "cannot be read"
    mark = error.problem_mark or error.context_mark
    place = Place(origin, mark.line + 1, mark.column + 1) if mark else Place(origin)
    opened = error.context_mark
    since = f"line {opened.line + 1}, column {opened.column + 1}" if opened else "above"
    lines = _BREAK.split(text)
    rest = lines[mark.line][mark.column :] if mark and mark.line < len(lines) else ""
    if opened and not rest.strip():  # the end of the text tells less than the beginning
        place = Place(origin, opened.line + 1, opened.column + 1)
    for sign, kind in (("}", "braces"), ("]", "brackets")):
        if f"',' or '{sign}'" in problem:
            return place, f"a ',' or '{sign}' is missing in the {kind} opened at {since}"
    if "mapping values are not allowed" in problem:
        return place, "a ':' where no key can be; quote a text with ': ' in it, or mend the indent"
    if "cannot start any token" in problem and rest.startswith("\t"):
        return place, "a tab; indent with spaces"
    if "cannot start any token" in problem:
        return place, f"a text that begins with {rest[:1]} needs quotes"
    if "unexpected end of stream" in problem:
        return place, f"the quotes opened at {since} are not closed"
    if "nesting depth" in problem:  # the parser's own limit, which lies above ours
        return place, f"nested more than {DEPTH} levels deep"
    if "expected ':'" in problem:
        return place, "a key needs ': ' and a value"
    if "node content" in problem:
        return place, "a value is missing here"
    if "indicator" in problem or "block end" in problem or "expected key" in problem:
        return place, f"this does not fit the block that begins at {since}; mend the indent"
    return place, problem


class _Dumper(yaml.SafeDumper):
    """Quotes also what only YAML 1.2 takes for a number, and writes no anchors."""

    def ignore_aliases(self, data: Any) -> bool:
        return True


for _pattern in (_INT, _FLOAT):
    _Dumper.add_implicit_resolver(
        "tag:lodeflow,2025:number", re.compile(f"^(?:{_pattern.pattern})$"), list("-+.0123456789")
    )


def to_yaml(data: Mapping[str, Any]) -> str:
    """Return plain data as YAML text that reads back as the same data.

    Numbers, texts, lists and mappings with text keys are what a graph's document is made of.
    """
    return yaml.dump(
        dict(data), Dumper=_Dumper, sort_keys=False, allow_unicode=True, default_flow_style=None
    )
