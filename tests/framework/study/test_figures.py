"""Figures: each kind draws what the cells have."""

import importlib
import sys
import xml.etree.ElementTree as ET

import pytest
from studies import done, load

from lodeflow.errors import RunError
from lodeflow.study.figures import draw

pytest.importorskip("matplotlib", reason="figures need matplotlib")

STUDY = """\
axes:
  method: {cases: {flat: {}, twice: {set: {level.gain: 2}}}}
  count: {arg: count, values: [4, 9]}
  seed: {arg: seed, from: 0, to: 2}
figures:
  bars: {kind: bars, x: method, series: count, value: level.error, unit: deg/s}
  lines: {kind: lines, x: count, series: method, value: level.error, log: true, title: Growth}
  spread: {kind: box, x: method, series: count, value: level.error, statistic: median}
  one: {kind: lines, x: method, value: level.samples, where: {seed: [0, 2]}}
"""


@pytest.fixture
def drawn(folder):
    study = load(STUDY)
    results = done(study)
    return {figure.name: draw(figure, results, folder) for figure in study.figures}


def test_png_and_svg_of_each(drawn):
    assert list(drawn) == ["bars", "lines", "spread", "one"]
    for png, svg in drawn.values():
        assert png.read_bytes().startswith(b"\x89PNG")
        assert ET.parse(svg).getroot().tag.endswith("svg")


def test_bars_are_as_high_as_the_statistic(folder):
    study = load(STUDY)
    results = done(study)
    figure = study.figures[0]
    module = importlib.import_module("lodeflow.study.figures")
    axes = importlib.import_module("matplotlib.figure").Figure().add_subplot()
    module._bars(axes, figure, module.Selection(results, figure.where))
    heights = [bar.get_height() for bar in axes.patches]
    assert len(heights) == 4
    numbers = [
        results.of(cell).numbers["level.error"]
        for cell in study.cells
        if (cell.point["method"].label, cell.point["count"].label) == ("twice", "9")
    ]
    assert heights[-1] == pytest.approx(figure.value.compute(numbers))


def test_without_matplotlib_it_is_told_what_to_do(folder, monkeypatch):
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    study = load(STUDY)
    with pytest.raises(RunError, match=r"pip install 'lodeflow\[plot\]', or .* --no-figures"):
        draw(study.figures[0], done(study), folder)
