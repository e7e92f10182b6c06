"""Drawings of a graph."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import pytest

from lodeflow.graph import Graph, load_graph, load_graph_text
from lodeflow.graph.drawing import Format, draw

WALK = Path(__file__).parent / "walk.yaml"
LOOP = """\
lodeflow: 1
name: loop
nodes:
  end: {use: toys:Smoother, inputs: {rate: m}}
  m: {use: toys:Mixer, inputs: {rate: r, feedback: end}}
  r: {use: toys:Rates}
"""


def test_text() -> None:
    assert (
        draw(load_graph(WALK))
        == """\
walk: 4 nodes, 5 streams

vehicle  toys:Vehicle  (source, in process sensors)
├─ out  imu   Imu       recorded
├─ out  mag   RawField  recorded
├─ out  mode  Mode      recorded
└─ may lose: late

cal      toys:Calibrator  (in process estimation)
├─ in   raw  RawField       ← vehicle.mag
└─ out       MagneticField

fuser    toys:Fuser  (nearest to each imu within 5 ms, in process estimation)
├─ in   imu  Imu            ← vehicle.imu
├─ in   mag  MagneticField  ← cal
├─ when vehicle.mode is none or compass
└─ out       Attitude       recorded

show     toys:Display  (in process estimation)
└─ in   attitude  Attitude  ← fuser"""
    )


def test_text_follows_the_order_of_the_run_and_marks_delays() -> None:
    assert (
        draw(load_graph_text(LOOP), "text")
        == """\
loop: 3 nodes, 3 streams

r    toys:Rates  (source)
└─ out    AngularRate

m    toys:Mixer  (last value before each rate)
├─ in   rate      AngularRate  ← r
├─ in   feedback  AngularRate  ← end  (delayed)
└─ out            AngularRate

end  toys:Smoother
├─ in   rate  AngularRate  ← m
└─ out        AngularRate"""
    )


def test_mermaid() -> None:
    assert (
        draw(load_graph_text(LOOP), "mermaid")
        == """\
flowchart LR
  n_end["<b>end</b><br/>toys:Smoother"]
  n_m["<b>m</b><br/>toys:Mixer"]
  n_r(["<b>r</b><br/>toys:Rates"])
  n_m -->|"rate: AngularRate"| n_end
  n_r -->|"rate: AngularRate"| n_m
  n_end -.->|"feedback: AngularRate, delayed"| n_m"""
    )
    walk = draw(load_graph(WALK), "mermaid")
    assert '  subgraph g_sensors["sensors"]\n    n_vehicle([' in walk
    assert '  n_vehicle -.->|"when none or compass"| n_fuser' in walk


def test_dot() -> None:
    assert (
        draw(load_graph_text(LOOP), "dot")
        == """\
digraph "loop" {
  rankdir=LR;
  node [shape=box];
  "end" [label="end\\ntoys:Smoother"];
  "m" [label="m\\ntoys:Mixer"];
  "r" [label="r\\ntoys:Rates", style=rounded];
  "m" -> "end" [label="rate: AngularRate"];
  "r" -> "m" [label="rate: AngularRate"];
  "end" -> "m" [label="feedback: AngularRate, delayed", style=dashed];
}"""
    )
    assert '  subgraph "cluster_sensors" {\n    label="sensors";' in draw(load_graph(WALK), "dot")


def hostile() -> Graph:
    graph = load_graph_text(LOOP)
    nodes = {name: replace(node, use='a"b\\<i>#;|\\"') for name, node in graph.nodes.items()}
    return replace(graph, nodes=nodes)


def test_names_are_escaped() -> None:
    dot = draw(hostile(), "dot")
    for line in dot.splitlines():  # every quoted text ends where it should
        assert re.fullmatch(r'(?:[^"\\]|"(?:[^"\\]|\\.)*")*', line), line
    assert r"""[label="end\na\"b\\<i>#;|\\\""]""" in dot
    mermaid = draw(hostile(), "mermaid")
    assert '"<b>end</b><br/>a#quot;b\\#lt;i#gt;#35;;|\\#quot;"' in mermaid


def test_unknown_format() -> None:
    with pytest.raises(ValueError, match="'svg' is none of text, mermaid, dot"):
        draw(load_graph(WALK), "svg")  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("form", "shown"),
    [
        ("text", "└─ out       MagneticField  99 <Hz>\n"),
        ("mermaid", 'n_cal -->|"mag: MagneticField<br/>99 #lt;Hz#gt;"| n_fuser'),
        ("dot", '"cal" -> "fuser" [label="mag: MagneticField\\n99 <Hz>"];'),
    ],
)
def test_notes_stand_beside_their_streams(form: Format, shown: str) -> None:
    drawn = draw(load_graph(WALK), form, {"cal": "99 <Hz>", "nobody": "1 Hz"})
    assert shown in drawn
