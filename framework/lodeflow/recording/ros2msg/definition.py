"""A recorded `ros2msg` definition as a tree: each type with its members, dependencies resolved.

Source: ROS 2 interface definition (design.ros2.org/articles/legacy_interface_definition.html),
with the dependencies behind the type itself, each led by a line of "=" and "MSG: package/Type".
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from functools import lru_cache

from lodeflow.errors import MessageError
from lodeflow.messages.ros import PRIMITIVES, STANDARD, full_name

DEEPEST = 64
"""Levels of types in types that are followed."""

_SEPARATOR = re.compile(r"^=+[ \t]*\r?$", re.MULTILINE)
_DEPENDENCY = re.compile(r"\s*MSG:[ \t]*([\w/]+)")
_MEMBER = re.compile(
    r"(?P<base>[A-Za-z]\w*(?:/\w+)*)(?:<=\d+)?"
    r"(?P<array>\[(?:(?P<count>\d+)|<=\d+)?\])?"
    r"\s+(?P<name>[A-Za-z]\w*)\s*(?P<rest>.*)"
)
_DUMMY = "structure_needs_at_least_one_member"  # what ROS 2 puts into a type without members


@dataclass(frozen=True)
class Member:
    """One member of a type.

    Attributes:
        name: its name.
        type: a primitive, "string" or "wstring"; else a type of its own.
        count: length of a fixed array; None for a single value or a sequence.
        sequence: whether it has any number of elements.
    """

    name: str
    type: str | Struct
    count: int | None = None
    sequence: bool = False

    def __str__(self) -> str:
        kind = self.type if isinstance(self.type, str) else self.type.name
        array = "[]" if self.sequence else "" if self.count is None else f"[{self.count}]"
        return f"{kind}{array} {self.name}"


@dataclass(frozen=True)
class Struct:
    """A type: its ROS 2 name, and its members in wire order."""

    name: str
    members: tuple[Member, ...]

    def find(self, path: str) -> Member | None:
        """Return the member at a path of single values, such as "header.stamp.sec"."""
        first, _, rest = path.partition(".")
        for member in self.members:
            if member.name == first:
                if not rest:
                    return member
                if isinstance(member.type, Struct) and member.count is None and not member.sequence:
                    return member.type.find(rest)
        return None


@lru_cache(maxsize=256)
def parse(name: str, schema: bytes) -> Struct:
    """Return the type that a schema record defines.

    Args:
        name: ROS 2 name of the type.
        schema: its definition with all that it depends on, `ros2msg`.

    Raises:
        MessageError: it is no such definition; names the line or the type that is missing.
    """
    top, *rest = _SEPARATOR.split(schema.decode("utf-8", "replace"))
    texts = dict(STANDARD)
    for text in rest:
        found = _DEPENDENCY.match(text)
        if found is not None:
            texts[full_name(found[1])] = text[found.end() :]
    texts[name] = top
    return _Parser(texts).struct(name)


class _Parser:
    def __init__(self, texts: dict[str, str]) -> None:
        self.texts = texts
        self.known: dict[str, Struct] = {}
        self.open: list[str] = []

    def struct(self, name: str) -> Struct:
        if name in self.known:
            return self.known[name]
        if name in self.open or len(self.open) == DEEPEST:
            raise MessageError(f"{name} is defined in terms of itself, or too deep")
        if name not in self.texts:
            raise MessageError(f"the definition of {name} is missing")
        self.open.append(name)
        lines = (line.partition("#")[0].strip() for line in self.texts[name].splitlines())
        members = [found for line in lines if line and (found := self._member(name, line))]
        self.open.pop()
        self.known[name] = Struct(name, tuple(members or [Member(_DUMMY, "uint8")]))
        return self.known[name]

    def _member(self, owner: str, line: str) -> Member | None:
        """Return what a line declares, None for a constant."""
        found = _MEMBER.fullmatch(line)
        if found is None:
            raise MessageError(f"{owner}: {line!r} declares no member")
        if found["rest"].startswith("="):
            return None
        base = found["base"]
        kind: str | Struct = base
        if base not in PRIMITIVES and base not in ("string", "wstring"):
            if base == "Header":
                base = "std_msgs/Header"
            elif "/" not in base:
                base = f"{owner.partition('/')[0]}/{base}"
            kind = self.struct(full_name(base))
        count = None if found["count"] is None else int(found["count"])
        return Member(found["name"], kind, count, found["array"] is not None and count is None)
