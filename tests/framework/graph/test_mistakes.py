"""Every mistake that a user can make in a graph file, by its whole printed text."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import pytest

from lodeflow.errors import GraphError
from lodeflow.graph import load_graph_text

HEAD = "lodeflow: 1\nname: walk\n"


@dataclass
class Case:
    name: str
    text: str
    expected: str
    overlays: dict[str, str] = field(default_factory=dict)
    options: dict[str, list[str]] = field(default_factory=dict)


def read_case(block: str) -> Case:
    given, _, expected = block.partition(">>>\n")
    name, _, given = given.partition("\n")
    text, *overlays = given.split("+++ ")
    case = Case(name, "", expected.strip("\n"))
    case.overlays = dict(overlay.split("\n", 1) for overlay in overlays)
    lines = text.splitlines(keepends=True)
    whole = "$ whole file\n" in lines
    for line in lines:
        if line.startswith("$ ") and line != "$ whole file\n":
            kind, _, option = line[2:].rstrip("\n").partition(": ")
            case.options.setdefault(f"{kind}s", []).append(option)
    graph = "".join(line for line in lines if not line.startswith("$ "))
    case.text = graph if whole else HEAD + graph
    return case


def printed(case: Case, folder: Path) -> str:
    for name, text in case.overlays.items():
        (folder / name).write_text(text)
    with pytest.raises(GraphError) as caught:
        load_graph_text(
            case.text, filename="walk.yaml", overlays=list(case.overlays), **case.options
        )
    return str(caught.value)


CASES = [
    read_case(block)
    for block in (Path(__file__).parent / "mistakes.txt").read_text().split("\n=== ")[1:]
]


@pytest.mark.parametrize("case", CASES, ids=lambda case: case.name)
def test_mistake(case: Case, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    assert printed(case, tmp_path) == case.expected


def test_mistakes_are_many() -> None:
    assert len(CASES) > 60
    assert len({case.name for case in CASES}) == len(CASES)
