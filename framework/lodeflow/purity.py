"""Reads a plugin's code for what makes two runs differ: wall clocks and unseeded randomness."""

from __future__ import annotations

import ast
import inspect
import sys
import textwrap
from collections.abc import Iterator
from typing import Any

FORBIDDEN = {
    "time": {"time", "time_ns", "monotonic", "monotonic_ns", "perf_counter", "perf_counter_ns"},
    "datetime": {"now", "utcnow", "today"},
    "random": {"random", "randint", "uniform", "gauss", "normal", "choice", "shuffle", "seed",
               "rand", "randn", "standard_normal"},
}  # fmt: skip


def impurity(plugin: type) -> str | None:
    """Return the first call of the wall clock, or of an unseeded generator, in a plugin's code.

    The functions and classes of the plugin's own package that its code names are read as well.

    Returns:
        Such as "time.time in Late.step", or None where there is none.
    """
    seen: set[int] = set()
    pending: list[Any] = [plugin]
    package = plugin.__module__.partition(".")[0]
    while pending:
        current = pending.pop()
        if id(current) in seen:
            continue
        seen.add(id(current))
        try:
            tree = ast.parse(textwrap.dedent(inspect.getsource(current)))
        except (OSError, TypeError, SyntaxError):
            continue
        for call in _forbidden_calls(tree):
            return f"{call} in {current.__qualname__}"
        pending += _named_in(tree, current, package)
    return None


def _named_in(tree: ast.AST, owner: Any, package: str) -> Iterator[Any]:
    """Yield the functions and classes of the plugin's own package that a piece of code names."""
    scope = vars(sys.modules[owner.__module__])
    for node in ast.walk(tree):
        found = None
        if isinstance(node, ast.Name):
            found = scope.get(node.id)
        elif isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name):
            found = getattr(scope.get(node.value.id), node.attr, None)
        found = getattr(found, "py_func", found)  # a compiled function
        module = getattr(found, "__module__", None) or ""
        code = inspect.isroutine(found) or inspect.isclass(found)
        if code and package != "lodeflow" and module.partition(".")[0] == package:
            yield found


def _forbidden_calls(tree: ast.AST) -> Iterator[str]:
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom) and node.module in FORBIDDEN:
            for alias in node.names:
                if alias.name in FORBIDDEN[node.module] and node.module != "datetime":
                    yield f"{node.module}.{alias.name}"
        if isinstance(node, ast.Call):
            name = ast.unparse(node.func)
            owner, _, called = name.rpartition(".")
            if called in FORBIDDEN.get(owner.rpartition(".")[2], ()):
                yield name
            if called == "default_rng" and _unseeded(node):
                yield f"{name}() without a seed"


def _unseeded(call: ast.Call) -> bool:
    """Whether a generator is made from the entropy of the machine."""
    given = [*call.args, *(keyword.value for keyword in call.keywords)]
    return all(isinstance(value, ast.Constant) and value.value is None for value in given)
