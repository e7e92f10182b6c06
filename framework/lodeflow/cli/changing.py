"""What `set` and `swap` share: a change of a running graph, in all its processes at one stamp."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from lodeflow.cli.looking_in import say
from lodeflow.cli.output import print_json
from lodeflow.errors import RunError
from lodeflow.supervisor.looking import View, Where, run

PATIENCE = 5.0
"""Seconds that a run has to react."""


def change(
    where: Where, graph: str | None, sets: Sequence[str], swaps: Sequence[str], *, as_json: bool
) -> int:
    """Change nodes of a running graph, and say from when on.

    Raises:
        RunError: there is no such run, the graph would not check, or a node cannot change; then
            nothing has changed.
    """
    with run(where, graph) as view:
        wanted = {"sets": list(sets), "swaps": list(swaps)}
        nodes = {text.partition("=")[0].partition(".")[0].strip() for text in (*sets, *swaps)}
        groups = {group for group, about in view.about.items() if nodes & about["nodes"].keys()}
        if len(groups) > 1:
            t, changed = _in_step(view, wanted)
        else:
            # Every process checks it; where none has the node, any of them says so.
            told = _ask(view, sorted(groups)[0] if groups else sorted(view.about)[0], wanted)
            t, changed = told["t"], told["nodes"]
            for group in view.about.keys() - groups:
                _ask(view, group, {**wanted, "t": t})
    if as_json:
        print_json({"graph": view.graph, "nodes": changed, "t": t})
    else:
        say([f"{', '.join(changed)} changed from t={t} ns on"])
    return 0


def _in_step(view: View, wanted: dict[str, Any]) -> tuple[int, list[str]]:
    """Hold all processes, and let them go on with the change at one stamp, or without it."""
    try:
        held = {group: _ask(view, group, {**wanted, "phase": "prepare"}) for group in view.about}
    except RunError:
        view.onlooker.ask("change", graph=view.graph, timeout=PATIENCE, phase="abort")
        raise
    t = max(told["t"] for told in held.values() if told["nodes"])
    for group in held:
        _ask(view, group, {"phase": "commit", "t": t})
    return t, [node for told in held.values() for node in told["nodes"]]


def _ask(view: View, group: str, details: dict[str, Any]) -> dict[str, Any]:
    answers = view.onlooker.ask(
        "change", graph=view.graph, group=group, timeout=PATIENCE, **details
    )
    if not answers:
        raise RunError(f"{view.graph}, group '{group}': no answer")
    if answers[0].error:
        raise RunError(answers[0].error)
    told: dict[str, Any] = answers[0].told
    return told
