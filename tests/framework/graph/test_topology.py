"""Order and cycles, on wires alone."""

from __future__ import annotations

import itertools

import toys

from lodeflow.graph.model import GraphNode, Wire
from lodeflow.graph.topology import cycles, loops, order
from lodeflow.params import Params


def wired(**inputs: dict[str, str]) -> dict[str, GraphNode]:
    """Return nodes by name; those with an input `feedback` hold it with delay."""
    return {
        name: GraphNode(
            name,
            "",
            toys.Mixer if "feedback" in wires else toys.Smoother,
            Params(),
            {port: Wire(sender, "out") for port, sender in wires.items()},
        )
        for name, wires in inputs.items()
    }


def test_order_follows_wires_and_else_the_file() -> None:
    nodes = wired(d={"rate": "b"}, c={}, b={"rate": "a"}, a={}, e={"rate": "c"})
    assert order(nodes) == (["c", "a", "b", "d", "e"], [])


def test_what_lies_behind_a_cycle_is_left_over_but_not_named() -> None:
    nodes = wired(x={"rate": "c"}, a={"rate": "c"}, b={"rate": "a"}, c={"rate": "b"}, r={})
    assert order(nodes) == (["r"], ["x", "a", "b", "c"])
    assert [[edge.to for edge in loop] for loop in loops(nodes)] == [["b", "c", "a"]]


def test_each_knot_gives_its_shortest_loop() -> None:
    nodes = wired(
        a={"rate": "b", "other": "c"}, b={"rate": "a"}, c={"rate": "b"},
        p={"rate": "q"}, q={"rate": "p"},
    )  # fmt: skip
    assert [[edge.to for edge in loop] for loop in loops(nodes)] == [["b", "a"], ["q", "p"]]


def test_a_delayed_input_closes_a_cycle() -> None:
    nodes = wired(m={"rate": "r", "feedback": "s"}, s={"rate": "m"}, r={})
    assert order(nodes) == (["r", "m", "s"], [])
    assert loops(nodes) == []
    assert cycles(nodes) == [{"m", "s"}]


def test_a_long_chain() -> None:
    names = [f"n{at}" for at in range(300)]
    chain = {name: {"rate": before} for before, name in itertools.pairwise(names)}
    nodes = wired(**dict(reversed(chain.items())), n0={})
    assert order(nodes) == (names, [])
