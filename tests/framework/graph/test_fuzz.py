"""Whatever a file holds, it gives a Graph or a GraphError, and nothing else."""

from __future__ import annotations

import contextlib
from pathlib import Path
from typing import Any

import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

from lodeflow.errors import GraphError
from lodeflow.graph import Graph, dump, load_graph_text
from lodeflow.graph.drawing import draw

GOOD = (Path(__file__).parent / "walk.yaml").read_text()
PIECES = [*"{}[]:,#&*!|>'\"%@`-? \n\t\\$~<=", "<<: ", "${", "${seed}", "*a", "&a ", "null", "1e999"]


def attempt(text: str, **options: list[str]) -> None:
    with contextlib.suppress(GraphError):
        graph = load_graph_text(text, **options)
        assert isinstance(graph, Graph)
        assert load_graph_text(dump(graph)) == graph
        draw(graph)


@settings(deadline=None)
@given(st.text() | st.lists(st.sampled_from([*PIECES, "a", "nodes", "1"])).map("".join))
def test_random_text(text: str) -> None:
    attempt(text)


@settings(deadline=None)
@given(st.text(max_size=20), st.sampled_from(["sets", "swaps", "args"]), st.booleans())
def test_random_options(text: str, option: str, named: bool) -> None:
    prefix = {"sets": "fuser.gain=", "swaps": "fuser=", "args": "trial="}[option]
    attempt(GOOD, **{option: [prefix + text if named else text]})


@settings(max_examples=300, deadline=None)
@given(st.data())
def test_random_changes_of_characters(data: st.DataObject) -> None:
    text = GOOD
    for _ in range(data.draw(st.integers(1, 3))):
        at = data.draw(st.integers(0, len(text)))
        end = data.draw(st.integers(at, min(at + 8, len(text))))
        text = (
            text[:at] + data.draw(st.sampled_from(["", *PIECES]) | st.text(max_size=3)) + text[end:]
        )
    attempt(text)


VALUES: st.SearchStrategy[Any] = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text("a.${}:_ ", max_size=5)
    | st.sampled_from(["toys:Vehicle", "toys:Smoother", "vehicle.mag", "cal", "${seed}", "all"]),
    lambda inner: st.lists(inner, max_size=3)
    | st.dictionaries(st.sampled_from(["use", "params", "inputs", "mag"]), inner, max_size=3),
    max_leaves=6,
)  # fmt: skip


@settings(max_examples=300, deadline=None)
@given(st.data())
def test_random_changes_of_values(data: st.DataObject) -> None:
    document = yaml.safe_load(
        GOOD.replace("${seed}", "'${seed}'").replace("${trial}", "'${trial}'")
    )
    for _ in range(data.draw(st.integers(1, 3))):
        place: Any = document
        while True:
            keys = list(place) if isinstance(place, dict) else list(range(len(place)))
            if not keys:
                break
            key = data.draw(st.sampled_from(keys))
            if isinstance(place[key], (dict, list)) and place[key] and data.draw(st.booleans()):
                place = place[key]
                continue
            if isinstance(place, dict) and data.draw(st.booleans()):
                place[data.draw(st.sampled_from(["use", "rate", "cal", "nodes", "x"]))] = data.draw(
                    VALUES
                )
            else:
                place[key] = data.draw(VALUES)
            break
    attempt(yaml.safe_dump(document, sort_keys=False))


@pytest.mark.parametrize("at", range(0, len(GOOD), 7))
def test_a_file_that_ends_early(at: int) -> None:
    attempt(GOOD[:at])
