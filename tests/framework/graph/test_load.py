"""Good graphs, the order of overrides, and the document that repeats a graph."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
import toys
import yaml

import lodeflow as lf
from lodeflow.errors import GraphError
from lodeflow.graph import Gate, Graph, Record, Wire, dump, load_graph, load_graph_text

WALK = Path(__file__).parent / "walk.yaml"
HEAD = "lodeflow: 1\nname: walk\n"


def load(nodes: str, **options: list[str]) -> Graph:
    return load_graph_text(HEAD + nodes, **options)


def overlay(folder: Path, text: str, name: str = "over.yaml") -> Path:
    path = folder / name
    path.write_text(text)
    return path


def test_graph_of_a_file() -> None:
    graph = load_graph(WALK)
    assert graph.name == "walk"
    assert graph.args == {"seed": 7, "trial": None}
    assert list(graph.nodes) == ["vehicle", "cal", "fuser", "show"]
    vehicle, cal, fuser, show = graph.nodes.values()
    assert vehicle.plugin is toys.Vehicle
    assert vehicle.params == toys.Vehicle.Params(seed=7)
    assert vehicle.allow == {"late"}
    assert cal.inputs == {"raw": Wire("vehicle", "mag")}
    assert cal.params.bias.tolist() == [1.0, 2.0, 3.0]
    assert fuser.inputs == {"imu": Wire("vehicle", "imu"), "mag": Wire("cal", "out")}
    assert fuser.params.gyro_noise == pytest.approx(math.radians(0.5))
    assert fuser.gates == (Gate(Wire("vehicle", "mode"), "mode", frozenset({0, 1})),)
    assert show.inputs == {"attitude": Wire("fuser", "out")}
    streams = [Wire("vehicle", port) for port in ("imu", "mag", "mode")]
    to = "recordings/{name}-{seed}-{start}.mcap"
    assert graph.record == Record(to, (*streams, Wire("fuser", "out")))
    groups = {name: group.nodes for name, group in graph.processes.items()}
    assert groups == {"sensors": ("vehicle",), "estimation": ("cal", "fuser", "show")}
    assert graph.notes == ()


def test_least_graph() -> None:
    graph = load("nodes: {v: {use: toys:Vehicle}}")
    assert graph == Graph("walk", graph.nodes, document=graph.document)
    assert graph.nodes["v"].params == toys.Vehicle.Params()


def test_empty_parts_are_as_good_as_none() -> None:
    bare = load("nodes: {v: {use: toys:Vehicle}}")
    empty = load(
        "args:\nnodes:\n  v:\n    use: toys:Vehicle\n    params:\n    inputs:\n    when:\n"
        "record:\nprocesses:\n"
    )
    assert (empty.nodes, empty.record, empty.processes) == (bare.nodes, None, {})


def test_record_defaults_to_all_streams() -> None:
    graph = load("nodes: {v: {use: toys:Vehicle}}\nrecord: {streams: all}")
    assert graph.record == Record("recordings/{name}-{start}.mcap", None)


def test_anchors_and_merges() -> None:
    graph = load(
        "nodes:\n"
        "  a: &vehicle {use: toys:Vehicle, params: &same {seed: 3, rate: 10}}\n"
        "  b: *vehicle\n"
        "  c: {<<: *vehicle, params: {<<: *same, seed: 4}}\n"
    )
    params = [node.params for node in graph.nodes.values()]
    assert [(p.seed, p.rate) for p in params] == [(3, 10.0), (3, 10.0), (4, 10.0)]


@pytest.mark.parametrize(
    ("written", "value"),
    [("1e-3", 1e-3), ("2", 2.0), ("1E2", 100.0), ("0x10", 16.0), ("'2 kHz'", 2000.0)],
)
def test_numbers_are_those_of_yaml_1_2(written: str, value: float) -> None:
    graph = load(f"nodes: {{v: {{use: toys:Vehicle, params: {{rate: {written}}}}}}}")
    assert graph.nodes["v"].params.rate == value


@pytest.mark.parametrize("written", ["yes", "off", "12:30:00", "2024-01-01", "1_000", "0o8", "="])
def test_texts_are_those_of_yaml_1_2(written: str) -> None:
    graph = load(f"nodes: {{v: {{use: toys:Vehicle, params: {{trial: {written}}}}}}}")
    assert graph.nodes["v"].params.trial == written
    assert load_graph_text(dump(graph)) == graph


def test_an_arg_keeps_its_type_alone_and_is_formatted_inside_a_text() -> None:
    text = (
        "args: {n: 3, list: [1, 2, 3], on: true, x: 1e-3}\n"
        "nodes:\n"
        "  v: {use: toys:Vehicle, params: {seed: ${n}, trial: 'n${n} ${on} ${x}'}}\n"
        "  cal: {use: toys:Calibrator, inputs: {raw: v.mag}, params: {bias: ${list}}}\n"
    )
    graph = load(text, args=["n=4"])
    assert graph.nodes["v"].params.seed == 4
    assert graph.nodes["v"].params.trial == "n4 true 0.001"
    assert graph.nodes["cal"].params.bias.tolist() == [1.0, 2.0, 3.0]


def test_an_arg_may_name_a_plugin_and_a_stream() -> None:
    text = (
        "args: {kind: Vehicle, from: v}\n"
        "nodes:\n"
        "  v: {use: 'toys:${kind}'}\n"
        "  cal: {use: toys:Calibrator, inputs: {raw: '${from}.mag'}, params: {bias: [0, 0, 0]}}\n"
    )
    assert load(text).nodes["cal"].inputs == {"raw": Wire("v", "mag")}


def test_order_of_overrides(tmp_path: Path) -> None:
    first = overlay(tmp_path, "nodes: {vehicle: {params: {rate: 2, seed: 2}}}", "first.yaml")
    second = overlay(tmp_path, "nodes: {vehicle: {params: {rate: 3}}}", "second.yaml")

    def rate(**options: object) -> tuple[int, float]:
        params = load_graph(WALK, **options).nodes["vehicle"].params  # type: ignore[arg-type]
        return params.seed, params.rate

    assert rate() == (7, 100.0)
    assert rate(args=["seed=8"]) == (8, 100.0)
    assert rate(overlays=[first]) == (2, 2.0)
    assert rate(overlays=[first, second]) == (2, 3.0)
    assert rate(overlays=[second, first]) == (2, 2.0)
    assert rate(overlays=[first, second], sets=["vehicle.rate=4"]) == (2, 4.0)
    assert rate(sets=["vehicle.rate=4", "vehicle.params.rate=5 kHz"]) == (7, 5000.0)
    assert rate(sets=["vehicle.seed=${seed}"], overlays=[first], args=["seed=9"]) == (9, 2.0)


def test_an_overlay_adds_replaces_and_removes(tmp_path: Path) -> None:
    change = overlay(
        tmp_path,
        "nodes:\n"
        "  show: null\n"
        "  again: {use: toys:Vehicle}\n"
        "  cal: {params: {bias: [4, 5, 6]}}\n"
        "  fuser: {params: {gyro_noise: null}, when: null}\n"
        "record: {streams: all}\n"
        "processes: null\n"
        "args: {trial: null}\n",
    )
    graph = load_graph(WALK, overlays=[change])
    assert list(graph.nodes) == ["vehicle", "cal", "fuser", "again"]
    assert graph.nodes["cal"].params.bias.tolist() == [4.0, 5.0, 6.0]
    assert graph.nodes["fuser"].params.gyro_noise == 0.01
    assert graph.nodes["fuser"].gates == ()
    assert graph.record == Record("recordings/{name}-{seed}-{start}.mcap", None)
    assert graph.processes == {}


def test_set_reaches_nested_parameters_wires_and_null() -> None:
    graph = load_graph(
        WALK,
        sets=["show.limits.low=0.5", "show.depth=null", "fuser.inputs.mag=cal.out"],
    )
    assert graph.nodes["show"].params.limits.low == 0.5
    assert graph.nodes["show"].params.depth is None
    assert graph.nodes["fuser"].inputs["mag"] == Wire("cal", "out")


def test_an_arg_that_a_set_makes_useless_is_no_mistake() -> None:
    graph = load_graph(WALK, sets=["vehicle.trial=x"])
    assert graph.args == {"seed": 7}
    assert load_graph_text(dump(graph)) == graph


def test_swap_keeps_wires_and_common_parameters() -> None:
    text = WALK.read_text().replace("0.5 deg/s", "0.5 deg/s, iterations: 3")
    graph = load_graph_text(
        text, filename="w.yaml", swaps=["fuser=toys:OtherFuser"], sets=["fuser.beta=0.2"]
    )
    fuser = graph.nodes["fuser"]
    assert fuser.plugin is toys.OtherFuser
    assert fuser.inputs == {"imu": Wire("vehicle", "imu"), "mag": Wire("cal", "out")}
    assert len(fuser.gates) == 1
    assert fuser.params == toys.OtherFuser.Params(gyro_noise=math.radians(0.5), beta=0.2)
    assert graph.notes == (
        "--swap fuser=toys:OtherFuser: 'toys:OtherFuser' has no parameter 'iterations', dropped "
        "(w.yaml:13:49)",
    )


def test_a_cycle_closed_by_a_delayed_hold() -> None:
    graph = load(
        "nodes:\n"
        "  m: {use: toys:Mixer, inputs: {rate: r, feedback: s}}\n"
        "  s: {use: toys:Smoother, inputs: {rate: m}}\n"
        "  r: {use: toys:Rates}\n"
        "  own: {use: toys:Mixer, inputs: {rate: r, feedback: own}}\n"
    )
    assert graph.nodes["m"].inputs["feedback"] == Wire("s", "out")


def test_a_problem_of_one_node_hides_none_of_another() -> None:
    with pytest.raises(GraphError) as caught:
        load("nodes: {v: {use: toys:Vehicle, params: {seed: x}}, w: {use: w}}\nrecord: 3")
    assert len(caught.value.problems) == 3
    assert isinstance(caught.value, lf.LodeflowError)


def test_a_mistake_behind_an_anchor_is_told_once_for_each_use() -> None:
    with pytest.raises(GraphError) as caught:
        load(
            "nodes:\n"
            "  a: {use: toys:Vehicle, params: &p {seed: x}}\n"
            "  b: {use: toys:Rates, params: *p}\n"
        )
    assert [p.splitlines()[0] for p in caught.value.problems] == [
        "graph.yaml:4:38: nodes.b.params.seed: no such parameter of 'toys:Rates' (it has none)",
        "graph.yaml:4:44: nodes.a.params.seed: should be an integer, got 'x'",
    ]


@pytest.mark.parametrize(
    ("content", "expected"),
    [
        (None, "g.yaml: cannot be read: No such file or directory"),
        (b"lodeflow: 1\nname: \xff\n", "g.yaml: line 2 is not UTF-8; save the file as UTF-8"),
        (
            b"lodeflow: \x001\n",
            "g.yaml:1:11: the character U+0000 is not allowed in YAML; remove it\n"
            "  1 | lodeflow: \x001\n    |           ^",
        ),
    ],
)
def test_files_that_are_no_text(
    content: bytes | None, expected: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    if content is not None:
        Path("g.yaml").write_bytes(content)
    with pytest.raises(GraphError) as caught:
        load_graph("g.yaml")
    assert str(caught.value) == expected


def test_a_byte_order_mark_is_ignored(tmp_path: Path) -> None:
    path = tmp_path / "bom.yaml"
    path.write_bytes(b"\xef\xbb\xbf" + WALK.read_bytes())
    assert load_graph(path) == load_graph(WALK)


OPTIONS: list[dict[str, list[str]]] = [
    {},
    {"args": ["seed=12", "trial='1e5'"]},
    {"sets": ["vehicle.trial=yes", "fuser.gain=1e-3", "cal.bias=[-0.0, 1e-300, .5]"]},
    {"sets": ["vehicle.trial=null", "show.limits={low: 1 deg}", "cal.scales=[1e22]"]},
    {"sets": ["vehicle.trial='two\\nlines: \"#\" ${seed}'"], "args": ["seed=3"]},
    {"swaps": ["fuser=toys:OtherFuser"], "sets": ["fuser.inputs.mag=cal.out"]},
]


@pytest.mark.parametrize("options", OPTIONS)
def test_the_document_repeats_the_graph(options: dict[str, list[str]]) -> None:
    graph = load_graph(WALK, **options)
    text = dump(graph)
    again = load_graph_text(text)
    assert again == graph
    assert dump(again) == text
    assert [str(again.nodes[n].params) for n in again.nodes] == [
        str(graph.nodes[n].params) for n in graph.nodes
    ]


def test_the_document_is_plain_yaml() -> None:
    graph = load_graph(WALK)
    assert yaml.safe_load(dump(graph)) == graph.document
    assert np.array_equal(graph.document["nodes"]["cal"]["params"]["bias"], [1, 2, 3])
