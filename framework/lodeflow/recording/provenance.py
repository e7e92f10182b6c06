"""Provenance: what, beside the graph, decides the bytes of a run."""

from __future__ import annotations

import json
import platform
import sys
from collections.abc import Iterable, Mapping, Sequence
from functools import cache
from importlib import metadata
from typing import Any

import numpy as np

from lodeflow.graph.model import Graph

LIBRARIES = ("lodeflow", "numpy", "scipy", "numba", "mcap", "zstandard", "eclipse-zenoh")


def provenance(graph: Graph, *, command: Sequence[str], started: str) -> dict[str, str]:
    """Return versions, host and arguments of a run, as texts.

    Args:
        graph: the graph in force.
        command: arguments of the command line.
        started: wall time of the start, ISO 8601.
    """
    found = {
        "graph": graph.name,
        "args": json.dumps(dict(graph.args), default=str),
        "command": json.dumps(list(command)),
        "started": started,
        "python": sys.version.split()[0],
        "platform": platform.platform(),
        "cpu_features": " ".join(_cpu_features()),
        "versions": json.dumps(versions(node.plugin.__module__ for node in graph.nodes.values())),
    }
    if graph.files:
        found["calibration_files"] = json.dumps(dict(graph.files))
    return found


def versions(modules: Iterable[str]) -> dict[str, str]:
    """Return the versions of the libraries, and of the packages that brought some modules."""
    tops = {module.partition(".")[0] for module in modules}
    by_module = _distributions()
    names = {*LIBRARIES, *(name for top in tops for name in by_module.get(top, ()))}
    found = {}
    for name in sorted(names):
        try:
            found[name] = metadata.version(name)
        except metadata.PackageNotFoundError:
            continue
    return found


@cache
def _distributions() -> Mapping[str, list[str]]:
    """Return the packages that each top module belongs to; asked once, it looks at all files."""
    return metadata.packages_distributions()


def _cpu_features() -> list[str]:
    """Return the SIMD extensions in use: sin and exp may differ in the last bit between them."""
    config: dict[str, Any] = np.show_config(mode="dicts") or {}  # type: ignore[assignment]
    return sorted(config.get("SIMD Extensions", {}).get("found", []))
