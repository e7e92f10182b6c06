"""Discovery of plugins by pluggy, lazily: listing and checking names imports nothing heavy.

A plugin package has an entry point in the group `lodeflow` that names a module with hook
implementations. No hook is called on the path of a message.
"""

from __future__ import annotations

import importlib
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from importlib import metadata
from pathlib import Path
from typing import Any

import pluggy

from lodeflow.errors import NodeError, did_you_mean
from lodeflow.node import Node, Source

GROUP = "lodeflow"
hookspec = pluggy.HookspecMarker(GROUP)
hookimpl = pluggy.HookimplMarker(GROUP)


class Hooks:
    """The hooks that a plugin package may implement."""

    @hookspec
    def lodeflow_nodes(self) -> Mapping[str, str]:
        """Return plugin names with import paths, {"name": "package.module:Class"}."""
        raise NotImplementedError

    @hookspec
    def lodeflow_messages(self) -> list[str]:
        """Return the modules that declare message types."""
        raise NotImplementedError

    @hookspec
    def lodeflow_commands(self) -> Mapping[str, str]:
        """Return commands of the command line, {"name": "package.module:click_command"}."""
        raise NotImplementedError

    @hookspec
    def lodeflow_importers(self) -> Mapping[str, str]:
        """Return formats of `lodeflow import`, {"format": "package.module:Class"}.

        The class is a Source whose only required parameter is `file`, the path.
        """
        raise NotImplementedError

    @hookspec
    def lodeflow_calibrations(self) -> Mapping[str, str]:
        """Return kinds of `lodeflow calibrate`, {"kind": "package.module:Class"}.

        The class is a CalibrationTool.
        """
        raise NotImplementedError


@dataclass(frozen=True)
class Entry:
    """A registered name: where it points, and which package brought it."""

    name: str
    path: str
    package: str


class Registry:
    """The names that installed plugin packages bring."""

    def __init__(self, manager: pluggy.PluginManager) -> None:
        self.manager = manager
        self.broken: dict[str, str] = {}
        """Packages that are installed but cannot be used, and why."""
        self.nodes = self._collect("lodeflow_nodes")
        self.commands = self._collect("lodeflow_commands")
        self.importers = self._collect("lodeflow_importers")
        self.calibrations = self._collect("lodeflow_calibrations")

    def _collect(self, hook: str) -> dict[str, Entry]:
        found: dict[str, Entry] = {}
        for implementation in getattr(self.manager.hook, hook).get_hookimpls():
            package = implementation.plugin_name
            try:
                brought = dict(implementation.function())
            except Exception as error:  # one broken package must not take the others along
                self.broken[package] = f"{hook}: {type(error).__name__}: {error}"
                continue
            for name, path in brought.items():
                if name in found:
                    raise NodeError(
                        f"{hook}: {name!r} is brought by both {found[name].package} and {package}; "
                        "uninstall one of them"
                    )
                found[name] = Entry(name, path, package)
        return found

    def load(self, use: str) -> type[Node] | type[Source]:
        """Return the class that `use` names: a plugin, or "module:Class" for one not packaged.

        Raises:
            NodeError: nothing of that name, or it cannot be imported, or it is no plugin.
        """
        if ":" in use:
            return _plugin(use, use)
        if use not in self.nodes:
            broken = "".join(f"; package {name} is broken: {w}" for name, w in self.broken.items())
            raise NodeError(
                f"no plugin {use!r}{did_you_mean(use, self.nodes)} "
                f"('lodeflow nodes' lists them; 'module:Class' names one in a file){broken}"
            )
        return _plugin(use, self.nodes[use].path)


@cache
def registry() -> Registry:
    """Return the installed plugins, discovered once."""
    manager = pluggy.PluginManager(GROUP)
    manager.add_hookspecs(Hooks)
    broken = {}
    for point in metadata.entry_points(group=GROUP):
        try:
            manager.register(point.load(), name=point.name)
        except Exception as error:  # one broken package must not take the others along
            broken[point.name] = f"{point.value}: {type(error).__name__}: {error}"
    found = Registry(manager)
    found.broken.update(broken)
    return found


def load_object(path: str) -> Any:
    """Import what "package.module:Name" names; the current folder is importable.

    Raises:
        NodeError: the module or the name in it cannot be imported, and why.
    """
    module_name, _, name = path.partition(":")
    if not module_name or not name:
        raise NodeError(f"{path!r} must read 'package.module:Name'")
    here = str(Path.cwd())
    if here not in sys.path:
        sys.path.insert(0, here)
    try:
        module = importlib.import_module(module_name)
    except NodeError:
        raise
    except (Exception, SystemExit) as error:
        raise NodeError(f"{path!r} cannot be imported: {type(error).__name__}: {error}") from error
    try:
        return getattr(module, name)
    except AttributeError:
        raise NodeError(
            f"module {module_name!r} has no {name!r}{did_you_mean(name, vars(module))}"
        ) from None


def _plugin(use: str, path: str) -> type[Node] | type[Source]:
    found = load_object(path)
    if not (isinstance(found, type) and issubclass(found, (Node, Source))):
        raise NodeError(f"{use!r} is not a plugin: {path} is no subclass of Node or Source")
    if not hasattr(found, "spec"):
        raise NodeError(f"{use!r} is not a plugin: it has no step, step_block or read")
    return found
