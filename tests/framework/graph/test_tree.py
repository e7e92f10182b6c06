"""Reading YAML: places, scalars, and files that mean harm."""

from __future__ import annotations

import math
from typing import Any

import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

from lodeflow.graph.problems import Origin, Problems, show
from lodeflow.graph.tree import Tree, parse, scalar, to_yaml


def read(text: str) -> Tree:
    problems = Problems()
    tree = parse(text, Origin("t.yaml", 0, ()), problems)
    assert tree is not None
    assert not len(problems), problems.error()
    return tree


def refused(text: str) -> str:
    problems = Problems()
    parse(text, Origin("t.yaml", 0, ()), problems)
    return str(problems.error())


@pytest.fixture(params=["C", "Python"])
def _each_parser(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    if request.param == "Python":
        monkeypatch.delattr(yaml, "CSafeLoader", raising=False)


@pytest.mark.usefixtures("_each_parser")
def test_places() -> None:
    tree = read("a:\n  - {b: ä, c: ${x}}\n  - 'd'\n")
    item = tree.entries["a"].items[0]
    spots = {name: (value.key, value.place) for name, value in item.entries.items()}
    assert {name: (str(key), str(place)) for name, (key, place) in spots.items()} == {
        "b": ("t.yaml:2:6", "t.yaml:2:9"),
        "c": ("t.yaml:2:12", "t.yaml:2:15"),
    }
    assert item.entries["c"].place.length == len("${x}")
    assert item.place.length == len("{b: ä, c: ${x}}")
    assert tree.plain() == {"a": [{"b": "ä", "c": "${x}"}, "d"]}


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("", None), ("~", None), ("NULL", None), ("nUll", "nUll"),
        ("true", True), ("False", False), ("yes", "yes"), ("on", "on"),
        ("12", 12), ("-12", -12), ("+3", 3), ("0x1F", 31), ("0o17", 15), ("017", 17),
        ("1.5", 1.5), (".5", 0.5), ("1.", 1.0), ("1e3", 1000.0), ("-1.5E-3", -0.0015),
        (".inf", math.inf), ("-.INF", -math.inf),
        ("1e", "1e"), ("e3", "e3"), (".", "."), ("1_000", "1_000"), ("1:30", "1:30"),
    ],
)  # fmt: skip
def test_plain_scalars(text: str, value: Any) -> None:
    found = scalar(text)
    assert (type(found), found) == (type(value), value)
    assert math.isnan(scalar(".NaN"))  # type: ignore[arg-type]


@pytest.mark.usefixtures("_each_parser")
@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("[" * 100_000, ": nested more than 40 levels deep\n"),
        ("a:\n" + "".join(" " * i + "- \n" for i in range(99)), "nested more than 40 levels"),
        ("a: &a [*a]", "no anchor '&a' before this alias"),
        ("n: " + "9" * 5000, "a number with too many digits"),
        ("a: \ud800", "the character U+D800 is not allowed in YAML"),
    ],
)
def test_files_that_mean_harm(text: str, expected: str) -> None:
    assert expected in refused(text)


@pytest.mark.usefixtures("_each_parser")
def test_many_laughs() -> None:
    lines = ["a0: &a0 [lol, lol, lol, lol, lol, lol, lol, lol, lol, lol]"]
    lines += [f"a{n}: &a{n} [{', '.join([f'*a{n - 1}'] * 10)}]" for n in range(1, 9)]
    assert "more than 100000 values" in refused("\n".join(lines))


@pytest.mark.usefixtures("_each_parser")
@pytest.mark.parametrize(
    ("text", "what"),
    [
        ("a: [1, 2", "a ',' or ']' is missing in the brackets opened at line 1, column 4"),
        ("a: {b: 1", "a ',' or '}' is missing in the braces opened at line 1, column 4"),
        ("a: b: c", "a ':' where no key can be"),
        ("a:\n\t- b", "a tab; indent with spaces"),
        ("a: `b`", "a text that begins with ` needs quotes"),
        ("a: 'b", "the quotes opened at line 1, column 4 are not closed"),
        ("a:\n  b: 1\n c: 2", "this does not fit the block that begins at line 1, column 1"),
        ("- a\nb: 1", "this does not fit the block that begins at line 1, column 1"),
        ("a: [1, }", "a value is missing here"),
    ],
)
def test_both_parsers_say_the_same(text: str, what: str) -> None:
    assert what in refused(text)


PLAIN = st.recursive(
    st.none()
    | st.booleans()
    | st.integers()
    | st.floats(allow_nan=False)
    | st.text(st.characters(exclude_categories=["Cs", "Cc", "Co"]))
    | st.sampled_from(["1e5", "0o7", "yes", "null", "~", "-", "1_0", "${x}", "a: b", "<<", "!t"]),
    lambda inner: st.lists(inner, max_size=4)
    | st.dictionaries(st.text("ab${}<1: ", max_size=4), inner, max_size=4),
    max_leaves=20,
)  # fmt: skip


@settings(deadline=None)
@given(st.dictionaries(st.text("abcé-_.#&*!", max_size=5), PLAIN, max_size=5))
def test_plain_data_survives_yaml(data: dict[str, Any]) -> None:
    again = read(to_yaml(data)).plain()
    assert again == data
    assert repr(again) == repr(data)  # 1 is not 1.0, and not true


def test_values_are_shown_as_written_in_yaml() -> None:
    value = {"a": [1, 2.5, True, None, "it's"], "b": {}}
    assert show(value) == "{a: [1, 2.5, true, null, 'it''s'], b: {}}"
    assert show(list(range(100))) == "[0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15, 16..."
