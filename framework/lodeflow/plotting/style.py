"""How figures look, and the one place that loads matplotlib, which only figures need."""

from __future__ import annotations

import importlib
from typing import Any

from lodeflow.errors import LodeflowError

COLORS = ("#2f6fb5", "#e07b1a", "#2f9e66", "#c8403c", "#8659b5", "#8a6a4f", "#d16ba5", "#6b7280")
"""Of streams and recordings; told apart also by most who do not see red and green alike."""
AXES = {"x": "#c8403c", "y": "#2f9e66", "z": "#2f6fb5", "w": "#6b7280"}
"""Of components."""
SHADES = ("#e8eaee", "#cfe3f7", "#fbe0c3", "#d5efdf", "#f6d3d1", "#e4d9f2", "#f3ecc4", "#e6dcd4")
"""Of modes, behind lines."""
TEXT, FAINT = "#1f2933", "#7b8794"

_SETTINGS: dict[str, Any] = {
    "axes.axisbelow": True,
    "axes.edgecolor": "#b5bcc4",
    "axes.grid": True,
    "axes.labelcolor": TEXT,
    "axes.labelsize": 9,
    "axes.linewidth": 0.8,
    "axes.spines.right": False,
    "axes.spines.top": False,
    "axes.titlecolor": TEXT,
    "axes.titlelocation": "left",
    "axes.titlesize": 10,
    "axes.titleweight": "bold",
    "figure.dpi": 100,
    "font.size": 9,
    "grid.color": "#e4e7eb",
    "grid.linewidth": 0.7,
    "legend.fontsize": 8.5,
    "legend.frameon": False,
    "lines.linewidth": 1.1,
    "lines.solid_joinstyle": "round",
    "path.simplify": False,  # a line is thinned already, its spikes kept
    "savefig.dpi": 160,
    "svg.hashsalt": "lodeflow",  # the same figure gives the same bytes
    "xtick.color": FAINT,
    "xtick.labelcolor": TEXT,
    "ytick.color": FAINT,
    "ytick.labelcolor": TEXT,
}


def load(module: str = "matplotlib") -> Any:
    """Return a module of matplotlib.

    Raises:
        LodeflowError: it is not installed.
    """
    try:
        return importlib.import_module(module)
    except ImportError as error:
        raise LodeflowError(
            "figures need the package matplotlib; install lodeflow with its extra: "
            "pip install 'lodeflow[plot]'"
        ) from error


def styled() -> Any:
    """Return a context in which figures are made and written in this style.

    Raises:
        LodeflowError: matplotlib is not installed.
    """
    return load().rc_context(_SETTINGS)
