"""Graph files: from YAML to a checked description that holds no live object."""

from lodeflow.graph.calibration_file import dump_calibration
from lodeflow.graph.load import dump, load_graph, load_graph_text
from lodeflow.graph.model import Gate, Graph, GraphNode, Loss, Record, Wire
from lodeflow.graph.parameters import settings
from lodeflow.graph.topology import Edge, edges, order

__all__ = [
    "Edge",
    "Gate",
    "Graph",
    "GraphNode",
    "Loss",
    "Record",
    "Wire",
    "dump",
    "dump_calibration",
    "edges",
    "load_graph",
    "load_graph_text",
    "order",
    "settings",
]
