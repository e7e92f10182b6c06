"""Discovery: names, duplicates, loading, and what is said where it fails."""

from __future__ import annotations

import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pluggy
import pytest

import lodeflow as lf
from lodeflow.errors import NodeError
from lodeflow.registry import GROUP, Entry, Hooks, Registry, load_object, registry

NODES = """
import lodeflow as lf

class Doubler(lf.Node):
    def step(self, x: lf.Heading) -> lf.Heading: ...

class Base(lf.Node):
    '''Has no step yet.'''

class Reader(lf.Source):
    def read(self, clock: lf.Clock) -> "list[lf.Imu]": ...

def plot(): ...
"""


def package(**hooks: Any) -> Any:
    found = SimpleNamespace()
    for name, value in hooks.items():

        def hook(value: Any = value) -> Any:
            return value

        setattr(
            found, f"lodeflow_{name}", lf.hookimpl(specname=f"lodeflow_{name}")(lambda v=value: v)
        )
    return found


def manager(**packages: Any) -> pluggy.PluginManager:
    found = pluggy.PluginManager(GROUP)
    found.add_hookspecs(Hooks)
    for name, plugin in packages.items():
        found.register(plugin, name)
    return found


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return a current folder with a module of nodes in it."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", list(sys.path))
    before = set(sys.modules)
    (tmp_path / "registry_nodes.py").write_text(NODES)
    yield tmp_path
    for name in set(sys.modules) - before:
        del sys.modules[name]


def test_names_of_all_packages_come_together() -> None:
    found = Registry(
        manager(
            one=package(nodes={"doubler": "a:Doubler"}, commands={"plot": "a:plot"}),
            two=package(
                nodes={"tripler": "b:Tripler"},
                importers={"broad": "b:read"},
                calibrations={"fcm": "b:Fcm"},
            ),
        )
    )
    assert found.nodes == {
        "doubler": Entry("doubler", "a:Doubler", "one"),
        "tripler": Entry("tripler", "b:Tripler", "two"),
    }
    assert found.commands == {"plot": Entry("plot", "a:plot", "one")}
    assert found.calibrations == {"fcm": Entry("fcm", "b:Fcm", "two")}
    assert found.importers == {"broad": Entry("broad", "b:read", "two")}


def test_listing_names_imports_nothing(folder: Path) -> None:
    found = Registry(manager(one=package(nodes={"doubler": "registry_nodes:Doubler"})))
    assert list(found.nodes) == ["doubler"]
    assert "registry_nodes" not in sys.modules
    assert found.load("doubler").__name__ == "Doubler"
    assert "registry_nodes" in sys.modules


def test_a_name_can_be_brought_by_one_package_only() -> None:
    with pytest.raises(NodeError) as found:
        Registry(manager(one=package(nodes={"x": "a:X"}), two=package(nodes={"x": "b:X"})))
    assert str(found.value) in {
        f"lodeflow_nodes: 'x' is brought by both {a} and {b}; uninstall one of them"
        for a, b in (("one", "two"), ("two", "one"))
    }


def test_a_class_in_a_file_is_loaded_by_module_and_name(folder: Path) -> None:
    assert Registry(manager()).load("registry_nodes:Reader").__name__ == "Reader"


def broken(folder: Path, use: str, **nodes: str) -> str:
    with pytest.raises(NodeError) as found:
        Registry(manager(one=package(nodes=nodes))).load(use)
    return str(found.value)


def test_what_is_said_of_names_that_cannot_be_loaded(folder: Path) -> None:
    assert broken(folder, "dubler", doubler="a:Doubler") == (
        "no plugin 'dubler', did you mean 'doubler'? ('lodeflow nodes' lists them; 'module:Class' "
        "names one in a file)"
    )
    assert broken(folder, "missing") == (
        "no plugin 'missing' ('lodeflow nodes' lists them; 'module:Class' names one in a file)"
    )
    assert broken(folder, "registry_nodes:Dubler") == (
        "module 'registry_nodes' has no 'Dubler', did you mean 'Doubler'?"
    )
    assert broken(folder, "no_such_module:X") == (
        "'no_such_module:X' cannot be imported: ModuleNotFoundError: No module named "
        "'no_such_module'"
    )
    assert broken(folder, "registry_nodes:plot") == (
        "'registry_nodes:plot' is not a plugin: registry_nodes:plot is no subclass of Node or "
        "Source"
    )
    assert broken(folder, "base", base="registry_nodes:Base") == (
        "'base' is not a plugin: it has no step, step_block or read"
    )
    assert broken(folder, "registry_nodes:") == "'registry_nodes:' must read 'package.module:Name'"
    assert broken(folder, "x", x="registry_nodes") == (
        "'registry_nodes' must read 'package.module:Name'"
    )


def test_a_mistake_in_the_plugins_file_is_passed_on(folder: Path) -> None:
    (folder / "registry_broken.py").write_text(
        "import lodeflow as lf\nclass Bad(lf.Node):\n    def step(self) -> None: ...\n"
    )
    text = broken(folder, "registry_broken:Bad")
    assert text.startswith("registry_broken.Bad (")
    assert text.endswith("step has no input; see Source")
    (folder / "registry_syntax.py").write_text("def x(:\n")
    text = broken(folder, "registry_syntax:X")
    assert text.startswith("'registry_syntax:X' cannot be imported: SyntaxError: ")


def test_load_object_takes_anything(folder: Path) -> None:
    assert load_object("registry_nodes:plot").__name__ == "plot"


def test_the_installed_plugins_are_discovered_once() -> None:
    assert registry() is registry()


def test_the_hooks_specify_but_do_not_answer() -> None:
    for hook in (
        Hooks.lodeflow_nodes,
        Hooks.lodeflow_messages,
        Hooks.lodeflow_commands,
        Hooks.lodeflow_importers,
        Hooks.lodeflow_calibrations,
    ):
        with pytest.raises(NotImplementedError):
            hook(Hooks())
