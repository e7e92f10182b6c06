"""What decides the outcome of a cell: its graph, its code, its data, as one short text.

A cell is not run again while its key stays the same. The framework counts by its version.
"""

from __future__ import annotations

import ast
import hashlib
import importlib.util
import json
import sys
from collections.abc import Iterable, Iterator
from functools import cache
from pathlib import Path
from typing import Any

from lodeflow.recording.provenance import versions
from lodeflow.study.model import Cell


def key_of(cell: Cell) -> str:
    """Return the key of a cell.

    It changes with the resolved graph (parameters and args included), with the source of the
    plugins and of what they import of their own package, with the versions of the other
    packages that they import, with the content of each file that a parameter names and of the
    recording, and with the streams that are collected.
    """
    graph, change = cell.graph, cell.change
    modules = sorted({node.plugin.__module__ for node in graph.nodes.values()})
    sources: dict[str, str] = {}
    outside: set[str] = set()
    for module in modules:
        found, imported = code_of(module)
        sources[module] = found
        outside |= imported
    document = {k: v for k, v in graph.document.items() if k not in ("name", "record", "processes")}
    files = {str(path): digest(path) for path in _files(graph.document)}
    if change.recording is not None:
        files["replay"] = digest(change.recording)
    decides = {
        "graph": document,
        "from": list(change.start),
        "code": sources,
        "versions": dict(versions(tuple(sorted(outside)))),
        "files": files,
        "streams": [str(wire) for wire in cell.streams],
    }
    text = json.dumps(decides, sort_keys=True, default=str)
    return hashlib.sha256(text.encode()).hexdigest()[:32]


def _files(value: Any) -> Iterator[Path]:
    """Yield each file that a text somewhere in a graph names."""
    if isinstance(value, dict):
        value = list(value.values())
    if isinstance(value, list):
        for inner in value:
            yield from _files(inner)
    elif isinstance(value, str) and 0 < len(value) < 4096 and "\0" not in value:
        path = Path(value)
        try:
            if path.is_file():
                yield path
        except OSError:
            return


def digest(path: Path) -> str:
    """Return the digest of a file's content; read once per state of the file."""
    status = path.stat()
    return _digest(path, status.st_size, status.st_mtime_ns)


@cache
def _digest(path: Path, size: int, modified: int) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "blake2b").hexdigest()[:32]


@cache
def code_of(module: str) -> tuple[str, frozenset[str]]:
    """Return the digest of a module with what it imports of its own package, and the rest.

    Returns:
        The digest, and the top names of all other packages that are imported.
    """
    package = module.partition(".")[0]
    if package == "lodeflow":
        return "", frozenset()  # counts by its version
    seen: dict[str, str] = {}
    outside = {package}
    pending = [module]
    while pending:
        name = pending.pop()
        source = None if name in seen else _source(name)
        if source is None:
            continue
        seen[name] = hashlib.sha256(source.encode("utf-8", "replace")).hexdigest()
        for imported in _imports(source, name):
            if imported.partition(".")[0] == package:
                pending.append(imported)
            else:
                outside.add(imported.partition(".")[0])
    text = json.dumps(seen, sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()[:32], frozenset(outside)


def _source(module: str) -> str | None:
    """Return the source of a module; None where the name is no module, or not Python."""
    try:
        spec = importlib.util.find_spec(module)
    except (ImportError, ValueError, AttributeError):
        return None
    file = Path(spec.origin) if spec is not None and spec.origin else None
    if file is None or file.suffix != ".py" or not file.is_file():
        return None
    return file.read_text(encoding="utf-8", errors="replace")


def _imports(source: str, module: str) -> Iterable[str]:
    """Yield the names that a source imports, each as the module that it may be."""
    try:
        tree = ast.parse(source)
    except SyntaxError:
        return
    loaded = sys.modules.get(module)
    package = getattr(loaded, "__package__", None) or module.rpartition(".")[0]
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            base = node.module or ""
            if node.level:
                above = package.rsplit(".", node.level - 1)[0] if node.level > 1 else package
                base = f"{above}.{base}" if base else above
            yield base
            yield from (f"{base}.{alias.name}" for alias in node.names)
