"""Changes of a graph while it runs: which nodes become others, and how that is written down."""

from __future__ import annotations

import json
from typing import Any

from lodeflow.errors import RecordingError
from lodeflow.graph.load import load_graph_text
from lodeflow.graph.model import Graph, GraphNode
from lodeflow.graph.tree import to_yaml


def changed_nodes(old: Graph, new: Graph) -> list[GraphNode]:
    """Return the nodes of `new` that have another plugin or other parameters in `old`."""
    return [node for name, node in new.nodes.items() if node != old.nodes.get(name)]


def with_change(graph: Graph, name: str, use: str, params: str) -> Graph:
    """Return a graph with a change that was written down.

    Args:
        graph: as it was before.
        name: node that changed.
        use: its plugin.
        params: its parameters, as JSON.

    Raises:
        GraphError: the changed graph does not check here.
        RecordingError: there is no such node, or the parameters are no JSON.
    """
    document: dict[str, Any] = json.loads(json.dumps(graph.document, default=str))
    try:
        node = document["nodes"][name]
        node["use"], node["params"] = use, json.loads(params)
    except (KeyError, ValueError) as error:
        raise RecordingError(f"a change of '{name}' cannot be understood: {error}") from error
    return load_graph_text(to_yaml(document), filename=f"change of '{name}'")
