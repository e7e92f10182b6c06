"""Figures over the cells of a study, by matplotlib, which only they import."""

from __future__ import annotations

import importlib
import math
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from lodeflow.errors import RunError
from lodeflow.study.model import Figure
from lodeflow.study.store import Results
from lodeflow.study.table import Selection

FORMS = ("png", "svg")


def matplotlib() -> Any:
    """Return matplotlib, which draws into files and needs no screen.

    Raises:
        RunError: it is not installed.
    """
    try:
        found: Any = importlib.import_module("matplotlib")
    except ImportError as error:
        raise RunError(
            "figures need the package matplotlib; install lodeflow with its extra: "
            "pip install 'lodeflow[plot]', or leave them out: --no-figures"
        ) from error
    return found


def draw(figure: Figure, results: Results, folder: Path) -> list[Path]:
    """Draw a figure as PNG and SVG, and return the files.

    Raises:
        RunError: matplotlib is not installed.
    """
    # Neither a window system nor the pyplot registry of open figures is wanted here.
    matplotlib().rcParams["svg.hashsalt"] = figure.name  # the same bytes each time
    made = importlib.import_module("matplotlib.figure").Figure(figsize=(8, 4.5), dpi=150)
    axes = made.add_subplot()
    cells = Selection(results, figure.where)
    {"bars": _bars, "lines": _lines, "box": _box}[figure.kind](axes, figure, cells)
    axes.set_title(figure.title)
    shown = (figure.x, *((figure.series,) if figure.series else ()))
    over = figure.kind != "box" and bool(cells.left_over(shown))
    axes.set_ylabel(figure.value.heading(over=over))
    axes.set_xlabel(figure.x)
    if figure.log:
        axes.set_yscale("log")
    axes.grid(axis="y", alpha=0.3)
    axes.set_axisbelow(True)
    if figure.series:
        axes.legend(frameon=False, loc="upper left", bbox_to_anchor=(1.0, 1.0))
    made.tight_layout()
    files = [folder / f"{figure.name}.{form}" for form in FORMS]
    for file in files:
        made.savefig(file, metadata={"Date": None} if file.suffix == ".svg" else None)
    return files


def _series(figure: Figure, cells: Selection) -> Sequence[str]:
    return cells.labels(figure.series) if figure.series else ("",)


def _numbers(figure: Figure, cells: Selection, x: str, series: str) -> list[float]:
    """Return the numbers, in SI units, of the cells at a label of x and of the series."""
    place = {figure.x: x, **({figure.series: series} if figure.series else {})}
    return cells.numbers(cells.at(place), figure.value)


def _statistic(figure: Figure, numbers: list[float]) -> float:
    return figure.value.compute(numbers) if numbers else math.nan


def _shown(figure: Figure, numbers: list[float]) -> list[float]:
    """Return numbers in the unit that is shown, without NaN."""
    factor = figure.value.of.factor(figure.value.unit)
    return [number / factor for number in numbers if not math.isnan(number)]


def _side_by_side(
    figure: Figure, cells: Selection
) -> Iterator[tuple[str, str, float, list[float], list[list[float]]]]:
    """Yield (name, colour, width, places, numbers at each label of x) of each series."""
    labels, series = cells.labels(figure.x), _series(figure, cells)
    width = 0.8 / len(series)
    for at, name in enumerate(series):
        places = [x - 0.4 + width * (at + 0.5) for x in range(len(labels))]
        found = [_numbers(figure, cells, label, name) for label in labels]
        yield name, f"C{at}", width, places, found


def _bars(axes: Any, figure: Figure, cells: Selection) -> None:
    for name, colour, width, places, found in _side_by_side(figure, cells):
        heights = [_statistic(figure, numbers) for numbers in found]
        axes.bar(places, heights, width, color=colour, label=name)
    _name_ticks(axes, cells.labels(figure.x))


def _lines(axes: Any, figure: Figure, cells: Selection) -> None:
    labels = cells.labels(figure.x)
    points = {p.label: p.value for p in cells.results.study.axes[figure.x].points}
    values = [points[label] for label in labels]
    numeric = all(isinstance(value, int | float) for value in values)
    places: list[Any] = values if numeric else list(range(len(labels)))
    for name in _series(figure, cells):
        found = [_numbers(figure, cells, label, name) for label in labels]
        (line,) = axes.plot(places, [_statistic(figure, n) for n in found], marker="o", label=name)
        spread = [_shown(figure, numbers) for numbers in found]
        statistic = figure.value.statistic
        in_unit = not (statistic.counts or statistic.shares)
        if in_unit and any(len(numbers) > 1 for numbers in spread):
            low = [min(numbers, default=math.nan) for numbers in spread]
            high = [max(numbers, default=math.nan) for numbers in spread]
            axes.fill_between(places, low, high, color=line.get_color(), alpha=0.15, linewidth=0)
    if not numeric:
        _name_ticks(axes, labels)


def _box(axes: Any, figure: Figure, cells: Selection) -> None:
    for name, colour, width, places, found in _side_by_side(figure, cells):
        boxes = axes.boxplot(
            [_shown(figure, numbers) for numbers in found],
            positions=places,
            widths=0.9 * width,
            patch_artist=True,
            medianprops={"color": "black"},
            manage_ticks=False,
        )
        for number, box in enumerate(boxes["boxes"]):
            box.set(facecolor=colour, alpha=0.6, label=None if number else name)
    _name_ticks(axes, cells.labels(figure.x))


def _name_ticks(axes: Any, labels: Sequence[str]) -> None:
    long = sum(map(len, labels)) > 70
    axes.set_xticks(range(len(labels)), labels, rotation=20 if long else 0,
                    ha="right" if long else "center")  # fmt: skip
