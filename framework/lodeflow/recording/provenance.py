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
        **host(),
        "versions": json.dumps(
            versions(node.plugin.__module__.partition(".")[0] for node in graph.nodes.values())
        ),
    }
    if graph.files:
        found["calibration_files"] = json.dumps(dict(graph.files))
    return found


def host() -> dict[str, str]:
    """Return what of the machine decides bytes."""
    return {
        "python": sys.version.split()[0],
        "platform": platform.platform(),
        "cpu_features": " ".join(_cpu_features()),
    }


def versions(tops: Iterable[str]) -> dict[str, str]:
    """Return the versions of the libraries, and of the packages that some top modules belong to.

    For a graph, the modules that brought its plugins.
    """
    by_module = _distributions()
    names = {*LIBRARIES, *(name for top in tops for name in by_module.get(top, ()))}
    return {name: found for name in sorted(names) if (found := _version(name))}


@cache
def _version(name: str) -> str:
    """Return the version of a package; "" if it is not installed."""
    try:
        return metadata.version(name)
    except metadata.PackageNotFoundError:
        return ""


@cache
def _distributions() -> Mapping[str, list[str]]:
    """Return the packages that each top module belongs to; asked once, it looks at all files."""
    return metadata.packages_distributions()


def _cpu_features() -> list[str]:
    """Return the SIMD extensions in use: sin and exp may differ in the last bit between them."""
    config: dict[str, Any] = np.show_config(mode="dicts") or {}  # type: ignore[assignment]
    return sorted(config.get("SIMD Extensions", {}).get("found", []))
