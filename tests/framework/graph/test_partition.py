"""Groups and their links."""

from __future__ import annotations

import pytest

from lodeflow.graph.model import Wire
from lodeflow.graph.partition import Part, farthest


def part(name: str, *readers: str, reads: tuple[str, ...] = ()) -> Part:
    inlets = {Wire(sender, "out"): sender for sender in reads}
    return Part(name, (name,), inlets, {Wire(name, "out"): readers} if readers else {})


@pytest.mark.parametrize(
    ("parts", "links"),
    [
        ([part("a")], 0),
        ([part("a", "b"), part("b", reads=("a",))], 1),
        ([part("a", "b"), part("b", "c", reads=("a",)), part("c", reads=("b",))], 2),
        ([part("a", "b", "c"), part("b", reads=("a",)), part("c", reads=("a",)), part("d")], 2),
    ],
)
def test_how_far_groups_are_from_each_other(parts: list[Part], links: int) -> None:
    assert farthest({part.name: part for part in parts}) == links
