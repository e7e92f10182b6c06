"""Cells in parallel processes: failures, kills, and what is finished."""

import json
import logging
from pathlib import Path

import pytest
from studies import load
from study_toys import GRAPH

from lodeflow.errors import RunError
from lodeflow.study.runner import run_cells
from lodeflow.study.store import FINISHED, Results, finished, provenance, write, writing
from lodeflow.study.worker import Outcome

FAULTS = ["none", "raise", "kill", "exit", "nan", "warn", "silent"]


@pytest.fixture(scope="module")
def outcomes(tmp_path_factory):
    """What comes of a cell with each fault, run in one go."""
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(tmp_path_factory.mktemp("faults"))
        Path("toy.yaml").write_text(GRAPH)
        study = load(f"axes: {{fault: {{set: level.fault, values: [{', '.join(FAULTS)}]}}}}")
        found = {}
        run_cells(study.cells, 2, lambda cell, outcome: found.update({cell.name: outcome}))
    return {name.partition("=")[2]: outcome for name, outcome in found.items()}


def test_every_cell_has_an_outcome(outcomes):
    assert sorted(outcomes) == sorted(FAULTS)


def test_a_good_cell(outcomes):
    good = outcomes["none"]
    assert good.error == ""
    assert good.numbers["level.samples"] == 10
    assert good.numbers["level.axes.z"] == 1.0
    assert good.numbers["level.error"] == good.numbers["level.axes.x"]
    assert good.numbers["data"] == 0.09
    assert good.numbers["wall"] > 0


def test_an_exception_is_told_with_node_and_stamp(outcomes):
    failed = outcomes["raise"]
    assert "node 'level' (Level.step_block) failed" in failed.error
    assert "ArithmeticError: too level" in failed.error


def test_a_killed_process_is_a_failed_cell(outcomes):
    assert outcomes["kill"].error == (
        "its process was killed by SIGKILL, perhaps for want of memory"
    )
    assert outcomes["exit"].error == "its process ended with code 3"


def test_nan_and_silence(outcomes):
    assert outcomes["nan"].numbers["level.error"] is None
    assert outcomes["silent"].error == ""
    assert "level.error" not in outcomes["silent"].numbers


def test_warnings_are_kept(outcomes):
    assert outcomes["warn"].logs == ("lodeflow.node.level: rather level",)
    assert outcomes["none"].logs == ()


def test_finished_cells_are_kept_and_a_line_cut_off_is_not(folder):
    study = load("axes: {seed: {arg: seed, from: 0, to: 2}}")
    first, second, _ = study.cells
    (folder / "out").mkdir()
    outcome = Outcome({"wall": 0.5, "level.error": None, "level.samples": 3}, logs=("hm",))
    with finished(folder / "out", fresh=False) as (known, keep):
        assert known == {}
        keep(first, outcome)
        keep(second, outcome)
    path = folder / "out" / FINISHED
    text = path.read_text()
    path.write_text(text[:-20])
    with finished(folder / "out", fresh=False) as (known, keep):
        assert known == {first.key: outcome}
        keep(second, outcome)
    with finished(folder / "out", fresh=False) as (known, _):
        assert set(known) == {first.key, second.key}
    with finished(folder / "out", fresh=True) as (known, _):
        assert known == {}
    assert path.read_text() == ""


def test_two_studies_do_not_write_into_one_folder(folder):
    (folder / "out").mkdir()
    told = "another 'lodeflow study' is writing here"
    with finished(folder / "out", fresh=False), pytest.raises(RunError, match=told):  # noqa: SIM117
        with finished(folder / "out", fresh=False):
            pass


def test_a_folder_that_cannot_be_written(folder):
    (folder / "file").write_text("")
    told = "file/out: cannot be written: Not a directory"
    with pytest.raises(RunError, match=told), writing(folder / "file" / "out"):
        pass


def test_the_table_of_cells(folder):
    import pyarrow.parquet

    study = load(
        "axes:\n  method: {cases: {a: {}, b: {set: {level.gain: 2}}}}\n"
        "  seed: {arg: seed, from: 0, to: 1}\n"
    )
    results = Results(study)
    for number, cell in enumerate(study.cells[:3]):
        numbers = {"wall": 0.25, "data": 1.0, "level.error": number / 3, "level.samples": number}
        results.outcomes[cell.key] = Outcome(numbers)
    failed = study.cells[1]
    results.outcomes[failed.key] = Outcome({}, "it, failed")
    (folder / "out").mkdir()
    write(results, folder / "out", ["study", "study.yaml"], "2025-01-01")
    assert (folder / "out" / "cells.csv").read_text() == (
        "method,seed,wall [s],data [s],level.error [rad/s],level.axes.x [rad/s],"
        "level.axes.y [rad/s],level.axes.z [rad/s],level.samples,error\n"
        "a,0,0.25,1.0,0.0,,,,0,\n"
        'a,1,,,,,,,,"it, failed"\n'
        "b,0,0.25,1.0,0.6666666666666666,,,,2,\n"
        "b,1,,,,,,,,not run\n"
    )
    table = pyarrow.parquet.read_table(folder / "out" / "cells.parquet")
    assert table.column("seed").to_pylist() == [0, 1, 0, 1]
    assert table.column("level.error [rad/s]").to_pylist() == [0.0, None, 2 / 3, None]
    assert str(table.schema.field("level.samples").type) == "int64"
    assert {file.name for file in (folder / "out" / "study").iterdir()} == {
        "study.yaml", "toy.yaml",
    }  # fmt: skip
    about = json.loads((folder / "out" / "provenance.json").read_text())
    assert about == json.loads(json.dumps(provenance(study, ["study", "study.yaml"], "2025-01-01")))
    assert about["args"]["seed"] == [0, 1]
    assert "numpy" in about["versions"]


def test_logging_is_left_as_it_was():
    assert not [h for h in logging.getLogger("lodeflow").handlers if type(h).__name__ == "_Logs"]
