"""Keys: where in Zenoh's key space a run lives."""

from __future__ import annotations

from lodeflow.graph.model import Wire

DATA = "lodeflow"
"""Streams, for everybody who wants to look: lodeflow/<graph>/<node>/<port>."""
CONTROL = "@lodeflow"
"""Everything else. No wildcard of a user catches it: `**` does not match a chunk with @."""


def stream(graph: str, wire: Wire) -> str:
    """Return the key of a stream."""
    return f"{DATA}/{graph}/{wire.node}/{wire.port}"


def link(graph: str, to: str, sender: str) -> str:
    """Return the key over which one group sends to another."""
    return f"{CONTROL}/{graph}/to/{to}/{sender}"


def control(graph: str, group: str) -> str:
    """Return the key at which a process answers questions and takes orders."""
    return f"{CONTROL}/{graph}/control/{group}"
