"""Options that several commands share."""

from __future__ import annotations

import functools
from collections.abc import Callable
from pathlib import Path
from typing import Any

import click

GRAPH = click.argument("graph", type=click.Path(dir_okay=False, path_type=Path))


def overrides(function: Callable[..., Any]) -> Callable[..., Any]:
    """Add --arg, --with, --set and --swap; the command gets them as one mapping `overrides`."""

    @click.option("--arg", "args", multiple=True, metavar="K=V", help="Value of an argument.")
    @click.option(
        "--with",
        "overlays",
        multiple=True,
        type=click.Path(dir_okay=False, path_type=Path),
        help="Overlay: a partial graph file laid over the graph.",
    )
    @click.option("--set", "sets", multiple=True, metavar="NODE.PARAM=V", help="Set a parameter.")
    @click.option("--swap", "swaps", multiple=True, metavar="NODE=PLUGIN", help="Swap a plugin.")
    @functools.wraps(function)
    def wrapped(*, args: Any, overlays: Any, sets: Any, swaps: Any, **others: Any) -> Any:
        others["overrides"] = {"args": args, "overlays": overlays, "sets": sets, "swaps": swaps}
        return function(**others)

    return wrapped


JSON = click.option("--json", "as_json", is_flag=True, help="Print one JSON object.")
