"""The rules of imports, clocks and asserts, read from the syntax trees of all modules."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

import lodeflow

ROOT = Path(__file__).parents[1]
FRAMEWORK, PLUGINS = ROOT / "framework" / "lodeflow", ROOT / "plugins" / "lodeflow_plugins"

LAYERS = [  # each imports from those before it
    {"errors"},
    {"messages", "algebra"},
    {"sync", "params", "clock"},
    {"node"},
    {"registry", "calibration"},
    {"graph"},
    {"runtime"},
    {"transport", "recording"},
    {"plotting"},
    {"supervisor", "testing", "purity"},
    {"study"},
    {"cli"},
]
LEVEL = {unit: level for level, units in enumerate(LAYERS) for unit in units}
DOOR = "lodeflow"
"""The front door, as a unit: it imports up to the registry, and no unit imports it."""
DOOR_LEVEL = LEVEL["registry"]

ONLY = {
    "zenoh": {"transport"},
    "mcap": {"recording"},
    "yaml": {"graph"},
    "click": {"cli"},
    "rich": {"cli"},
    "matplotlib": {"study"},
    "numba": set(),
    "scipy": set(),
}
CLOCKS = {
    f"time.{name}{unit}"
    for name in ("time", "monotonic", "perf_counter", "process_time", "clock_gettime")
    for unit in ("", "_ns")
} | {
    f"datetime.{name}"
    for name in ("datetime.now", "datetime.utcnow", "datetime.today", "date.today")
}


def imports(tree: ast.AST) -> Iterator[tuple[int, str, str | None]]:
    """Yield (line, module, name) of each import; the name is None for `import module`."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from ((node.lineno, alias.name, None) for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            module = "." * node.level + (node.module or "")
            yield from ((node.lineno, module, alias.name) for alias in node.names)


def unit_of(path: Path) -> str:
    """Return the unit that a file of the framework belongs to."""
    top = path.parts[0]
    return DOOR if top == "__init__.py" else top.removesuffix(".py")


def target_of(module: str, name: str | None) -> str | None:
    """Return the unit of the framework that an import names, if it names one."""
    top, _, rest = module.partition(".")
    if top != "lodeflow":
        return None
    if rest:
        return rest.partition(".")[0]
    return name if name in LEVEL else DOOR


def check_framework(path: Path, source: str) -> list[str]:
    """Return what a file breaks; `path` is relative to the package."""
    unit, tree = unit_of(path), ast.parse(source)
    if unit not in LEVEL and unit != DOOR:
        return [f"{path}: {unit} has no place among the layers"]
    level = LEVEL.get(unit, DOOR_LEVEL + 0.5)
    found = []
    for line, module, name in imports(tree):
        where = f"{path}:{line}: "
        target = target_of(module, name)
        if module.startswith("."):
            found.append(f"{where}a relative import")
        elif target is not None:
            if target != DOOR and target not in LEVEL:
                found.append(f"{where}{target} has no place among the layers")
            elif target == DOOR or (target != unit and LEVEL[target] > level):
                found.append(f"{where}{unit} must not import {target}")
        else:
            owners = ONLY.get(module.partition(".")[0])
            if owners is not None and unit not in owners:
                allowed = f"only {', '.join(owners)} may" if owners else "only plugins may"
                found.append(f"{where}{unit} imports {module}, which {allowed}")
    found += [
        f"{path}:{node.lineno}: assert, which `python -O` leaves out"
        for node in ast.walk(tree)
        if isinstance(node, ast.Assert)
    ]
    return found + ([] if unit == "clock" else check_clocks(path, tree))


def check_mutual(edges: set[tuple[str, str]]) -> list[str]:
    """Return the units of one layer that import each other."""
    return [f"{a} and {b} import each other" for a, b in sorted(edges) if a < b and (b, a) in edges]


def check_plugin(path: Path, source: str) -> list[str]:
    """Return what a file of a plugin package breaks; `path` begins with the package."""
    tree = ast.parse(source)
    found = []
    for line, module, name in imports(tree):
        where = f"{path}:{line}: "
        if module.startswith("."):
            found.append(f"{where}a relative import")
        elif module.startswith("lodeflow."):
            found.append(f"{where}{module} is behind the front door; import lodeflow")
        elif module == "lodeflow" and name is not None and name not in lodeflow.__all__:
            found.append(f"{where}lodeflow has no public {name}")
    return found + check_clocks(path, tree)


def check_clocks(path: Path, tree: ast.AST) -> list[str]:
    """Return where a clock is read, under whatever name it was imported."""
    known: dict[str, str] = {}
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            known |= {alias.asname or alias.name: alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            for alias in node.names:
                known[alias.asname or alias.name] = f"{node.module}.{alias.name}"
    found = []
    for node in ast.walk(tree):
        if isinstance(node, ast.Attribute | ast.Name):
            first, dot, rest = ast.unparse(node).partition(".")
            name = known.get(first, "") + dot + rest
            if name in CLOCKS:
                found.append(f"{path}:{node.lineno}: {name}, which only clock.py may read")
    return found


def files(package: Path) -> list[Path]:
    return sorted(package.rglob("*.py"))


@pytest.mark.parametrize("path", files(FRAMEWORK), ids=lambda p: str(p.relative_to(FRAMEWORK)))
def test_the_framework_keeps_the_rules(path: Path) -> None:
    assert check_framework(path.relative_to(FRAMEWORK), path.read_text()) == []


@pytest.mark.parametrize("path", files(PLUGINS), ids=lambda p: str(p.relative_to(PLUGINS)))
def test_the_bundled_plugins_keep_the_rules(path: Path) -> None:
    assert check_plugin(path.relative_to(PLUGINS.parent), path.read_text()) == []


def test_no_two_units_of_the_framework_import_each_other() -> None:
    edges = set()
    for path in files(FRAMEWORK):
        for _, module, name in imports(ast.parse(path.read_text())):
            target = target_of(module, name)
            if target is not None and target != unit_of(path.relative_to(FRAMEWORK)):
                edges.add((unit_of(path.relative_to(FRAMEWORK)), target))
    assert ("node", "sync") in edges
    assert check_mutual(edges) == []


def test_there_is_something_to_check() -> None:
    assert {"errors", "node", "runtime", "graph"} <= {
        unit_of(path.relative_to(FRAMEWORK)) for path in files(FRAMEWORK)
    }
    assert len(files(PLUGINS)) > 5


@pytest.mark.parametrize(
    ("path", "source", "problem"),
    [
        ("errors.py", "import lodeflow.messages.cdr", "errors must not import messages"),
        ("messages/cdr.py", "from lodeflow.sync import END", "messages must not import sync"),
        ("messages/cdr.py", "from lodeflow import clock", "messages must not import clock"),
        ("algebra.py", "from lodeflow.node import Node", "algebra must not import node"),
        ("sync.py", "from lodeflow.node import Node", "sync must not import node"),
        (
            "graph/load.py",
            "from lodeflow.runtime.plan import Plan",
            "graph must not import runtime",
        ),
        ("runtime/plan.py", "def f():\n    import lodeflow.testing", "runtime must not import te"),
        ("recording/a.py", "from lodeflow.supervisor import run", "recording must not import sup"),
        ("node.py", "import lodeflow as lf", "node must not import lodeflow"),
        ("node.py", "from lodeflow import Imu", "node must not import lodeflow"),
        ("cli/run.py", "from lodeflow import __version__", "cli must not import lodeflow"),
        ("__init__.py", "from lodeflow.graph import load", "lodeflow must not import graph"),
        ("runtime/plan.py", "from .align import Column", "a relative import"),
        ("tools.py", "", "tools has no place among the layers"),
        ("runtime/plan.py", "import lodeflow.tools", "tools has no place among the layers"),
        ("runtime/plan.py", "import zenoh", "imports zenoh, which only transport may"),
        ("runtime/plan.py", "from mcap.reader import x", "imports mcap.reader, which only record"),
        ("registry.py", "import yaml", "registry imports yaml, which only graph may"),
        ("graph/load.py", "import click", "graph imports click, which only cli may"),
        ("supervisor/run.py", "from rich import print", "imports rich, which only cli may"),
        ("supervisor/run.py", "from lodeflow.study.load import x", "supervisor must not import st"),
        ("cli/study.py", "import matplotlib", "imports matplotlib, which only study may"),
        ("runtime/plan.py", "import numba as nb", "imports numba, which only plugins may"),
        ("node.py", "def f(x):\n    assert x", "assert, which `python -O` leaves out"),
        ("node.py", "import time\ntime.time()", "time.time, which only clock.py may read"),
        ("node.py", "import time as t\nf = t.monotonic_ns", "time.monotonic_ns, which only"),
        ("node.py", "from time import time_ns as now\nnow()", "time.time_ns, which only clock.py"),
        ("node.py", "import datetime\ndatetime.datetime.now()", "datetime.datetime.now, which on"),
        ("node.py", "from datetime import datetime as d\nd.now()", "datetime.datetime.now, which"),
        ("node.py", "from datetime import date\ndate.today()", "datetime.date.today, which only"),
    ],
)
def test_a_broken_rule_of_the_framework_is_found(path: str, source: str, problem: str) -> None:
    (found,) = check_framework(Path(path), source)
    assert found.startswith(path)
    assert problem in found


@pytest.mark.parametrize(
    ("path", "source"),
    [
        ("clock.py", "import time\ntime.time_ns()"),
        ("node.py", "import time\ntime.sleep(1)\nfrom datetime import timedelta"),
        ("node.py", "class Now:\n    def time(self): ...\n\nNow().time()"),
        ("messages/cdr.py", "from lodeflow.messages.fields import Kind\nimport numpy"),
        ("runtime/plan.py", "from lodeflow.graph.model import Graph\nfrom lodeflow import errors"),
        ("__init__.py", "from lodeflow.registry import hookimpl\nfrom lodeflow.errors import X"),
        ("cli/run.py", "import click\nfrom lodeflow.testing import check_node"),
        ("transport/link.py", "import zenoh"),
        ("recording/reader.py", "import mcap"),
        ("graph/tree.py", "import yaml"),
    ],
)
def test_what_is_allowed_is_not_found(path: str, source: str) -> None:
    assert check_framework(Path(path), source) == []


@pytest.mark.parametrize(
    ("source", "problem"),
    [
        ("from lodeflow.messages.message import Message", "is behind the front door"),
        ("def f():\n    import lodeflow.runtime.plan", "is behind the front door"),
        ("from lodeflow import runtime", "lodeflow has no public runtime"),
        ("from lodeflow import *", "lodeflow has no public *"),
        ("from ..fusion import x", "a relative import"),
        ("import time\ntime.time()", "time.time, which only clock.py may read"),
    ],
)
def test_a_broken_rule_of_a_plugin_is_found(source: str, problem: str) -> None:
    (found,) = check_plugin(Path("pack/node.py"), source)
    assert found.startswith("pack/node.py:")
    assert problem in found


def test_what_a_plugin_may_import() -> None:
    source = (
        "import lodeflow as lf\nfrom lodeflow import Imu\nimport numba\nfrom pack.filter import f"
    )
    assert check_plugin(Path("pack/node.py"), source) == []


def test_units_that_import_each_other_are_found() -> None:
    assert check_mutual({("study", "supervisor"), ("cli", "study")}) == []
    assert check_mutual({("study", "supervisor"), ("supervisor", "study")}) == [
        "study and supervisor import each other"
    ]
