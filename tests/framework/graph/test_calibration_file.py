"""Calibration files: where their values stand among the layers, and every way to be wrong."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from lodeflow.errors import GraphError
from lodeflow.graph import dump, dump_calibration, load_graph, load_graph_text
from lodeflow.graph.explanation import explain

GRAPH = """\
lodeflow: 1
name: calibrated
args: {file: null}
nodes:
  source: {use: "toys:Vehicle"}
  cal:
    use: "toys:Calibrated"
    inputs: {raw: source.mag}
    params: {bias: [1, 2, 3], scale: 5.0}
"""
GOOD = {"bias": [7.0, 8.0, 9.0], "gain": "2 uT"}


def calibration(params: Any = None, use: str = "toys:Calibrated") -> str:
    params = GOOD if params is None else params
    return dump_calibration(use, params, {}, ["a note"], {"kind": "toy"})


@pytest.fixture(autouse=True)
def _files(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    text = GRAPH.replace("args: {file: null}\n", "")
    Path("graph.yaml").write_text(text)
    Path("plain.yaml").write_text(text.replace("{bias: [1, 2, 3], scale: 5.0}", "{file: cal.yaml}"))
    Path("cal.yaml").write_text(calibration())


def values(path: str, **options: Any) -> dict[str, Any]:
    params = load_graph(path, **options).nodes["cal"].params
    return {**params.model_dump(), "bias": params.bias.tolist()}


FROM_FILE = {"file": None, "bias": [7.0, 8.0, 9.0], "gain": 2e-6, "scale": 1.0}


def test_a_file_gives_all_that_is_needed() -> None:
    assert values("plain.yaml") == FROM_FILE


def test_a_file_replaces_what_was_set_before_it() -> None:
    assert values("graph.yaml", sets=["cal.file=cal.yaml"]) == FROM_FILE
    Path("over.yaml").write_text("nodes: {cal: {params: {file: cal.yaml}}}")
    assert values("graph.yaml", overlays=["over.yaml"]) == FROM_FILE


def test_what_stands_beside_it_or_comes_later_wins() -> None:
    for sets in (["cal.file=cal.yaml", "cal.scale=4"], ["cal.scale=4", "cal.file=cal.yaml"]):
        assert values("graph.yaml", sets=sets) == {**FROM_FILE, "scale": 4.0}
    Path("over.yaml").write_text("nodes: {cal: {params: {file: cal.yaml, scale: 3}}}")
    assert values("graph.yaml", overlays=["over.yaml"]) == {**FROM_FILE, "scale": 3.0}
    assert values("graph.yaml", overlays=["over.yaml"], sets=["cal.scale=4"])["scale"] == 4.0


def test_null_names_no_file() -> None:
    assert values("graph.yaml", sets=["cal.file=null"])["bias"] == [1.0, 2.0, 3.0]


def test_of_several_files_the_later_win() -> None:
    Path("more.yaml").write_text(calibration({"scale": 9.0, "gain": "3 uT"}))
    found = values("graph.yaml", sets=["cal.file=[cal.yaml, more.yaml]"])
    assert found == {**FROM_FILE, "scale": 9.0, "gain": pytest.approx(3e-6)}


def test_an_arg_may_name_it() -> None:
    text = GRAPH.replace("file: null", "file: cal.yaml")
    text = text.replace("bias: [1, 2, 3]", 'file: "${file}"')
    found = load_graph_text(text)
    assert found.nodes["cal"].params.bias.tolist() == [7.0, 8.0, 9.0]
    assert "args" not in found.document  # nothing refers to it any more


def test_the_resolved_graph_needs_no_file() -> None:
    found = load_graph("graph.yaml", sets=["cal.file=cal.yaml", "cal.scale=4"])
    assert found.files == {"cal.yaml": calibration()}
    text = dump(found)
    Path("cal.yaml").unlink()
    again = load_graph_text(text)
    assert again.nodes == found.nodes
    assert dump(again) == text
    assert "file" not in text


def test_explain_tells_what_a_file_set_and_removed() -> None:
    shown = explain("graph.yaml", "cal.bias", sets=["cal.file=cal.yaml"]).splitlines()
    assert shown[-2].split() == ["graph.yaml:8:20", "[1,", "2,", "3]"]
    assert shown[-1].split() == ["cal.yaml:4:9", "[7.0,", "8.0,", "9.0]", "<-", "in", "force"]
    shown = explain("graph.yaml", "cal.scale", sets=["cal.file=cal.yaml"]).splitlines()
    assert shown[-1].endswith("null, removes it")
    assert shown[-3].endswith("1.0   <- in force")


def problems(file: str | None, name: str = "cal.yaml", **options: Any) -> str:
    if file is not None:
        Path(name).write_text(file)
    with pytest.raises(GraphError) as caught:
        load_graph("plain.yaml", **options)
    assert len(caught.value.problems) == 1, caught.value
    return caught.value.problems[0].splitlines()[0]


def test_every_mistake_is_told_with_its_place() -> None:
    good = calibration()
    assert problems(good.replace("bias:", "bais:")).startswith(
        "cal.yaml:4:3: nodes.cal.params.bais: no such parameter of 'toys:Calibrated', did you mean"
    )
    assert problems(good.replace("[7.0, 8.0, 9.0]", "[7.0, x, 9.0]")).startswith(
        "cal.yaml:4:15: nodes.cal.params.bias[1]: 'x' is not a number with a unit (LSB)"
    )
    assert problems(good.replace("_calibration: 1", "_calibration: 2")).startswith(
        "cal.yaml:1:23: lodeflow_calibration: should be 1, the version that this lodeflow reads"
    )
    assert problems(good.replace("notes:", "note:")).startswith(
        "cal.yaml:7:1: note: unknown key, did you mean 'notes'?"
    )
    assert problems("a: 1").startswith("cal.yaml:1:1: no calibration file; one begins with")
    assert problems("a: [1").startswith("cal.yaml:1:4: not YAML: ")
    assert problems(calibration(use="")).startswith("cal.yaml:1:1: holds no parameters")
    assert problems(good.replace("2 uT", "${x} uT")).startswith(
        "cal.yaml:5:9: params.gain: '${' has no meaning in a calibration"
    )
    Path("cal.yaml").unlink()
    assert problems(None).startswith(
        "plain.yaml:8:20: nodes.cal.params.file: 'cal.yaml': cannot be read: No such file"
    )
    assert problems(None, sets=["cal.file=7"]).startswith(
        "--set cal.file=7: nodes.cal.params.file: should be the path of a calibration file, or"
    )


def test_a_file_for_another_plugin_is_refused() -> None:
    Path("graph.yaml").write_text(
        GRAPH.replace("args: {file: null}\n", "").replace("toys:Calibrated", "mag_calibrator")
    )
    Path("cal.yaml").write_text(calibration(use="accel_calibrator"))
    with pytest.raises(GraphError, match="use: is for 'accel_calibrator', not for 'mag_calibrat"):
        load_graph("graph.yaml", sets=["cal.file=cal.yaml"])


def test_a_node_made_by_hand_is_told_that_files_are_read_elsewhere() -> None:
    import toys

    with pytest.raises(ValueError, match="is read where a graph is loaded; here, give the values"):
        toys.Calibrated.Params(file="cal.yaml", bias=[1, 2, 3])
