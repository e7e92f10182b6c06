"""Study files to cells."""

import os
from pathlib import Path

import pytest
from studies import load

from lodeflow.errors import GraphError
from lodeflow.graph import load_graph_text
from lodeflow.study.load import load_study
from lodeflow.study.runner import job_of


def params(cell, node):
    return cell.graph.nodes[node].params


def test_the_grid_is_the_product_of_the_axes_and_the_last_one_varies_fastest(folder):
    study = load(
        "args: {count: 5}\n"
        "axes:\n"
        "  method: {cases: {flat: {}, steep: {swap: {level: 'study_toys:Steep'}}}}\n"
        "  gain: {set: level.gain, values: [0.5, 1 deg/s]}\n"
        "  seed: {arg: seed, from: 1, to: 3}\n"
    )
    assert len(study.cells) == 12
    assert [cell.name for cell in study.cells[:4]] == [
        "method=flat gain=0.5 seed=1",
        "method=flat gain=0.5 seed=2",
        "method=flat gain=0.5 seed=3",
        "method=flat gain=1 deg/s seed=1",
    ]
    last = study.cells[-1]
    assert last.graph.nodes["level"].plugin.__name__ == "Steep"
    assert params(last, "level").gain == pytest.approx(0.0174533)
    assert params(last, "noise").seed == 3
    assert params(last, "noise").count == 5
    assert [point.value for point in study.axes["seed"].points] == [1, 2, 3]
    assert list(study.columns) == [
        "wall", "data", "level.error", "level.axes.x", "level.axes.y", "level.axes.z",
        "level.samples",
    ]  # fmt: skip
    assert study.columns["level.error"].header == "level.error [rad/s]"


def test_a_study_without_axes_is_one_cell(folder):
    (cell,) = load("").cells
    assert cell.name == "all"


@pytest.mark.parametrize(
    ("axis", "labels"),
    [
        ("{arg: seed, values: [3, 4]}", ["3", "4"]),
        ("{arg: seed, values: {one: 1, two: 2}}", ["one", "two"]),
        ("{arg: seed, from: 0, to: 6, step: 3}", ["0", "3", "6"]),
        ("{set: level.gain, from: 0, to: 1, step: 0.25}", ["0", "0.25", "0.5", "0.75", "1"]),
        ("{arg: seed, from: 2, to: 1, step: -1}", ["2", "1"]),
        ("{swap: level, values: ['study_toys:Level', 'study_toys:Steep']}",
         ["study_toys:Level", "study_toys:Steep"]),
        ("{set: noise.file, files: 'walks/*.csv'}", ["walk-1", "walk-2"]),
        ("{set: noise.file, files: [walks/walk-2.csv, walks/walk-1.csv], label: '\\d'}",
         ["2", "1"]),
        ("{set: noise.file, files: 'walks/*.csv', label: 'w(al)k-(.)'}", None),
    ],
)  # fmt: skip
def test_values_of_an_axis(folder, axis, labels):
    (folder / "walks").mkdir()
    for name in ("walk-1.csv", "walk-2.csv"):
        (folder / "walks" / name).write_text("")
    if labels is None:
        with pytest.raises(GraphError, match="two values are called 'al'"):
            load(f"axes: {{a: {axis}}}")
    else:
        assert list(load(f"axes: {{a: {axis}}}").axes["a"].labels) == labels


def test_paths_start_at_the_study_and_environment_variables_are_filled_in(folder, monkeypatch):
    (folder / "deep").mkdir()
    (folder / "over.yaml").write_text("nodes: {level: {params: {gain: 7}}}")
    (folder / "data.bin").write_text("x")
    (folder / "deep" / "study.yaml").write_text(
        "lodeflow_study: 1\nname: deep\ngraph: ../toy.yaml\nwith: ../over.yaml\n"
        "set: {noise.file: '${TOY_DATA}/data.bin'}\n"
    )
    monkeypatch.setenv("TOY_DATA", str(folder))
    (cell,) = load_study("deep/study.yaml").cells
    assert params(cell, "level").gain == 7
    assert params(cell, "noise").file == f"{folder}/data.bin"


def test_a_case_may_have_a_graph_of_its_own(folder):
    text = (folder / "toy.yaml").read_text().replace("study_toys:Level", "study_toys:Steep")
    (folder / "other.yaml").write_text(text)
    study = load("axes: {g: {cases: {a: {}, b: {graph: other.yaml}}}}")
    names = [cell.graph.nodes["level"].plugin.__name__ for cell in study.cells]
    assert names == ["Level", "Steep"]
    assert [file.name for file in study.files] == ["study.yaml", "toy.yaml", "other.yaml"]


def test_a_graph_in_a_worker_is_the_graph_that_was_checked(folder):
    (cell,) = load("args: {seed: 5}\nset: {level.gain: 1e-7 rad/s}").cells
    again = load_graph_text(job_of(cell).graph)
    assert again == cell.graph


def test_scores_may_be_other_streams(folder):
    study = load("scores: [noise, level]")
    assert "noise.angular_rate.z" in study.columns
    assert "level.error" in study.columns
    study = load("scores: noise")
    assert "level.error" not in study.columns


def test_the_study_in_the_documentation(folder):
    root = Path(__file__).parents[3]
    text = (root / "docs" / "studies.md").read_text().split("```yaml\n")[1].split("```")[0]
    (folder / "noise.yaml").write_text(
        text.replace("../heading.yaml", f"{root}/graphs/heading.yaml")
    )
    study = load_study("noise.yaml")
    assert len(study.cells) == 2 * 2 * 30
    assert study.tables[0].values[0].heading(over=True) == "score.heading_rmse [deg], median"


def test_the_study_of_fusers():
    for package in ("vqf", "imufusion", "ahrs"):
        pytest.importorskip(package, reason="the extra 'peers' is not installed")
    if "LODEFLOW_DATA" not in os.environ:
        pytest.skip("LODEFLOW_DATA does not name a folder with broad/")
    path = Path(__file__).parents[3] / "graphs" / "studies" / "fusers_on_broad.yaml"
    study = load_study(path)
    assert set(study.axes["trial"].labels) >= {"02", "18", "25", "27", "31", "34"}
