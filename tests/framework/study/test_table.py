"""Tables over cells, against numbers worked out by hand."""

import math

import pytest
from studies import done, load

from lodeflow.study.table import fill
from lodeflow.study.worker import Outcome

AXES = """\
axes:
  method:
    cases: {flat: {}, twice: {set: {level.gain: 2}}, steep: {swap: {level: 'study_toys:Steep'}}}
  count: {arg: count, values: [4, 9]}
  seed: {arg: seed, from: 0, to: 2}
"""


@pytest.fixture
def made(folder):
    """Fill the only table of a study whose errors are known."""

    def make(table, change=lambda results: None):
        study = load(f"{AXES}tables:\n  t: {table}\n")
        results = done(study)
        for cell, outcome in results.outcomes.items():
            assert not outcome.error, cell
        for cell in study.cells:  # method 1, 2, 3; count 10, 20; seed 0, 1, 2
            at = [list(study.axes[a].labels).index(cell.point[a].label) for a in study.axes]
            error = (at[0] + 1) + 10 * (at[1] + 1) + 0.1 * at[2]
            results.outcomes[cell.key].numbers["level.error"] = error
        change(results)
        return fill(study.tables[0], results)

    return make


def test_rows_columns_margin_and_caption(made):
    filled = made("{rows: method, columns: count, value: level.error, margin: max, title: Errors}")
    assert filled.headers == ("method", "4", "9", "max")
    assert list(filled.texts()) == [
        ("flat", "11.10", "21.10", "21.10"),
        ("twice", "12.10", "22.10", "22.10"),
        ("steep", "13.10", "23.10", "23.10"),
    ]
    assert filled.caption == "level.error [rad/s], mean, over seed (3)."
    assert filled.markdown() == (
        "## Errors\n\n| method | 4 | 9 | max |\n| --- | ---: | ---: | ---: |\n"
        "| flat | 11.10 | 21.10 | 21.10 |\n| twice | 12.10 | 22.10 | 22.10 |\n"
        "| steep | 13.10 | 23.10 | 23.10 |\n\nlevel.error [rad/s], mean, over seed (3).\n"
    )


def test_several_values_each_with_its_statistic(made):
    filled = made(
        "{rows: [method, count], where: {method: [steep, flat]}, values: {"
        "mid: {value: level.error, statistic: median, digits: 1},"
        "worst: {value: level.error, statistic: max, unit: deg/s, digits: 0},"
        "many: {value: level.error, statistic: count above 11.05},"
        "n: {value: level.samples, statistic: sum, digits: 0}}}"
    )
    assert filled.headers == ("method", "count", "mid", "worst", "many", "n")
    assert list(filled.texts()) == [
        ("steep", "4", "13.1", f"{math.degrees(13.2):.0f}", "3", "12"),
        ("steep", "9", "23.1", f"{math.degrees(23.2):.0f}", "3", "27"),
        ("flat", "4", "11.1", f"{math.degrees(11.2):.0f}", "2", "12"),
        ("flat", "9", "21.1", f"{math.degrees(21.2):.0f}", "3", "27"),
    ]
    assert "worst: level.error [deg/s], max" in filled.caption


def test_columns_and_several_values(made):
    filled = made(
        "{rows: method, columns: count, margin: mean, where: {seed: 0, method: flat},"
        " values: {a: level.error, b: level.samples}, digits: 1}"
    )
    assert filled.headers == ("method", "4 a", "4 b", "9 a", "9 b", "mean a", "mean b")
    assert filled.caption == "a: level.error [rad/s]; b: level.samples."
    assert list(filled.texts()) == [("flat", "11.0", "4.0", "21.0", "9.0", "16.0", "6.5")]


def test_published_figures_stand_beside(made):
    filled = made(
        "{rows: method, columns: count, margin: mean, value: level.error, where: {method: flat},"
        " reference: {source: 'a paper', figures: {flat: {4: 11.234, mean: 16}}}}"
    )
    assert list(filled.texts()) == [("flat", "11.10 (11.23)", "21.10", "16.10 (16.00)")]
    assert filled.caption.endswith("; in parentheses: a paper.")
    (row,) = filled.as_dict()["rows"]
    assert row["reference"] == {"4": 11.234, "mean": 16.0}
    assert row["values"]["4"] == pytest.approx(11.1)


def test_published_figures_of_several_values(made):
    filled = made(
        "{rows: method, values: {a: level.error, b: level.samples}, where: {method: twice},"
        " reference: {figures: {twice: {b: 6.5}}}}"
    )
    assert list(filled.texts()) == [("twice", "17.10", "6.50 (6.50)")]


def test_pairs(made):
    def first_seed_of_flat_is_worst(results):
        for cell in results.study.cells:
            if cell.point["method"].label == "flat" and cell.point["seed"].label == "0":
                results.outcomes[cell.key].numbers["level.error"] = 99.0

    filled = made(
        "{rows: method, value: level.error, compare: {with: twice}}", first_seed_of_flat_is_worst
    )
    assert filled.headers[-1] == "lower than twice"
    assert filled.wins == ("4 of 6", "", "0 of 6")
    filled = made("{rows: method, value: level.error, compare: {with: twice, better: higher}}")
    assert filled.wins == ("0 of 6", "", "6 of 6")


def test_failed_cells_and_nan_are_not_hidden(made):
    def spoil(results):
        cells = {cell.name: cell.key for cell in results.study.cells}
        results.outcomes[cells["method=flat count=4 seed=1"]] = Outcome({}, "it failed")
        results.outcomes[cells["method=twice count=4 seed=1"]].numbers["level.error"] = None
        for seed in range(3):
            results.outcomes[cells[f"method=steep count=9 seed={seed}"]] = Outcome({"wall": 1.0})

    filled = made("{rows: method, columns: count, value: level.error}", spoil)
    assert list(filled.texts()) == [
        ("flat", "11.10 [2 of 3]", "21.10"),
        ("twice", "nan", "22.10"),
        ("steep", "13.10", "-"),
    ]
    assert filled.as_dict()["rows"][1]["values"]["4"] is None
