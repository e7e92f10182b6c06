"""Every mistake that a user can make in a study file, by its whole printed text."""

from pathlib import Path

import pytest

from lodeflow.errors import GraphError
from lodeflow.study.load import load_study

HEAD = "lodeflow_study: 1\nname: toys\ngraph: toy.yaml\n"


def read_case(block):
    given, _, expected = block.partition(">>>\n")
    name, _, text = given.partition("\n")
    whole = text.startswith("$ whole file\n")
    return name, text.removeprefix("$ whole file\n") if whole else HEAD + text, expected.strip("\n")


CASES = [
    read_case(block)
    for block in (Path(__file__).parent / "mistakes.txt").read_text().split("\n=== ")[1:]
]


@pytest.mark.parametrize(("name", "text", "expected"), CASES, ids=[case[0] for case in CASES])
def test_mistake(folder, name, text, expected):
    (folder / "study.yaml").write_text(text)
    with pytest.raises(GraphError) as caught:
        load_study("study.yaml", {"HOME": "/"})
    assert str(caught.value) == expected
