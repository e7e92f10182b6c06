"""Problems of a graph: what is wrong, at which place of which text, printed with an excerpt."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

from lodeflow.errors import GraphError

WIDTH = 110
"""Longest piece of a line that an excerpt shows."""


@dataclass(frozen=True)
class Origin:
    """A text that values come from.

    Attributes:
        label: file name as given, or the option ("--set fuser.sigma=1").
        rank: order in which problems of several texts are printed.
        lines: lines of a file, for excerpts; none for an option, which has no positions.
    """

    label: str
    rank: int = 0
    lines: tuple[str, ...] | None = None


@dataclass(frozen=True)
class Place:
    """A stretch of an origin.

    Attributes:
        origin: the text.
        line: counts from 1; 0 means the whole text.
        column: counts characters from 1.
        length: how much to underline; 0 shows no excerpt.
    """

    origin: Origin
    line: int = 0
    column: int = 0
    length: int = 1

    def __str__(self) -> str:
        if self.origin.lines is None or not self.line:
            return self.origin.label
        return f"{self.origin.label}:{self.line}:{self.column}"

    def excerpt(self) -> str:
        """Return the line with the place underlined, or "" where there is none to show."""
        lines = self.origin.lines or ()
        if not (self.length and 0 < self.line <= len(lines) and lines[self.line - 1].strip()):
            return ""
        line, start = lines[self.line - 1], self.column - 1
        length = max(1, min(self.length, len(line) - start))
        if len(line) > WIDTH:  # show the surroundings of the place
            first = max(0, min(start - WIDTH // 4, len(line) - WIDTH))
            line, start = line[first : first + WIDTH], start - first
            length = max(1, min(length, WIDTH - start))
        margin = f"  {self.line} | "
        before = "".join("\t" if char == "\t" else " " for char in line[:start].ljust(start))
        return f"{margin}{line}\n{' ' * (len(margin) - 2)}| {before}{'^' * length}"


@dataclass(frozen=True)
class Problem:
    """One mistake: its place, the path of the value in the graph, and what to do."""

    place: Place
    path: str
    text: str

    def __str__(self) -> str:
        head = ": ".join(part for part in (str(self.place), self.path, self.text) if part)
        excerpt = self.place.excerpt()
        return f"{head}\n{excerpt}" if excerpt else head


class Problems:
    """Collects problems, so that a user sees all of them at once."""

    def __init__(self) -> None:
        self._found: list[Problem] = []
        self._silent: set[tuple[int, int, int]] = set()

    def add(self, place: Place, path: str, text: str) -> None:
        """Note a problem."""
        if (place.origin.rank, place.line, place.column) not in self._silent:
            self._found.append(Problem(place, path, text))

    def silence(self, place: Place) -> None:
        """Let nothing more be said of a value whose mistake has been told."""
        self._silent.add((place.origin.rank, place.line, place.column))

    def __len__(self) -> int:
        return len(self._found)

    def error(self) -> GraphError:
        """Return the error that holds all problems, in the order of their places."""
        ordered = sorted(
            dict.fromkeys(self._found),
            key=lambda p: (p.place.origin.rank, p.place.line, p.place.column),
        )
        return GraphError([str(problem) for problem in ordered])


def show(value: Any, limit: int = 60) -> str:
    """Return plain data as one would write it in a graph file, shortened."""
    text = _flow(value)
    return text if len(text) <= limit else f"{text[: limit - 3]}..."


def _flow(value: Any) -> str:
    match value:
        case None:
            return "null"
        case bool():
            return str(value).lower()
        case float() if not math.isfinite(value):
            return f"{'-' if value < 0 else ''}.{'nan' if value != value else 'inf'}"
        case str():
            return "'" + value.replace("'", "''").replace("\n", "\\n") + "'"
        case dict():
            return "{" + ", ".join(f"{key}: {_flow(item)}" for key, item in value.items()) + "}"
        case list() | tuple():
            return "[" + ", ".join(_flow(item) for item in value) + "]"
        case _:
            return str(value)


def join(path: str, *names: str | int) -> str:
    """Return the path of a value inside the one at `path`: a.b for a key, a[0] for an item."""
    for name in (name for name in names if name != ""):
        path += f"[{name}]" if isinstance(name, int) else f".{name}" if path else name
    return path
