"""A cell is run again if, and only if, something that decides its outcome has changed."""

import importlib
import sys

import pytest
from studies import load

from lodeflow.study.key import code_of

PLUGIN = """\
import lodeflow as lf
from {package}.inner import double

class Doubler(lf.Node):
    def step(self, rate: lf.AngularRate) -> lf.AngularRate:
        return double(rate)
"""


def key(text):
    (cell,) = load(text).cells
    return cell.key


def test_the_same_study_has_the_same_keys(folder):
    assert key("args: {seed: 1}") == key("args: {seed: 1}")


@pytest.mark.parametrize(
    "text",
    [
        "args: {seed: 2}",
        "set: {level.gain: 2}",
        "swap: {level: 'study_toys:Steep'}",
        "scores: [level, noise]",
    ],
)
def test_a_change_of_the_graph_changes_the_key(folder, text):
    assert key(text) != key("")


def test_what_is_recorded_and_what_the_graph_is_called_does_not_count(folder):
    before = key("")
    text = (folder / "toy.yaml").read_text().replace("name: toy", "name: other")
    (folder / "toy.yaml").write_text(text + "record: {to: x.mcap}\n")
    assert key("") == before


def test_the_content_of_a_file_that_a_parameter_names_counts(folder):
    (folder / "data.csv").write_text("1")
    before = key("set: {noise.file: data.csv}")
    assert key("set: {noise.file: data.csv}") == before
    (folder / "data.csv").write_text("2")
    assert key("set: {noise.file: data.csv}") != before


def test_the_code_of_a_plugin_counts_with_what_it_imports_of_its_package(folder, monkeypatch):
    package = folder / "keypack"
    package.mkdir()
    (package / "__init__.py").write_text("")
    (package / "node.py").write_text(PLUGIN.format(package="keypack"))
    (package / "inner.py").write_text("import numpy\nfrom . import deep\ndef double(x): return x\n")
    (package / "deep.py").write_text("A = 1\n")
    (package / "other.py").write_text("B = 1\n")
    monkeypatch.syspath_prepend(str(folder))
    importlib.import_module("keypack.node")

    def code():
        code_of.cache_clear()
        return code_of("keypack.node")

    digest, outside = code()
    assert outside == {"keypack", "numpy", "lodeflow"}
    (package / "other.py").write_text("B = 2\n")
    assert code()[0] == digest
    (package / "deep.py").write_text("A = 2\n")
    assert code()[0] != digest
    for name in [name for name in sys.modules if name.startswith("keypack")]:
        del sys.modules[name]
