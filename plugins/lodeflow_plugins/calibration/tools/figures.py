"""Figures of calibrations, drawn on a matplotlib Figure that the framework hands over."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

BEFORE, AFTER = "C1", "C0"
AXES = "xyz"
SLICE = 0.35
"""Half the thickness, per radius, of what a projection of a sphere shows."""


def spheres(before: np.ndarray, after: np.ndarray, what: str) -> Callable[[Any], None]:
    """Readings before and after, in slices through the middle, and how far each is off the sphere.

    before, after: (N, 3), in units of the sphere's radius; what: label of the rows.
    """

    def draw(figure: Any) -> None:
        grid = figure.add_gridspec(2, 3, height_ratios=(2, 1))
        circle = np.linspace(0.0, 2.0 * np.pi, 200)
        for at, (i, j) in enumerate(((0, 1), (1, 2), (0, 2))):
            axes = figure.add_subplot(grid[0, at])
            axes.plot(np.cos(circle), np.sin(circle), color="black", lw=0.8)
            near = np.abs(after[:, 3 - i - j]) < SLICE
            for values, color, label in ((before, BEFORE, "before"), (after, AFTER, "after")):
                axes.plot(values[near, i], values[near, j], ".", ms=3, color=color, label=label)
            axes.set_aspect("equal")
            axes.set_title(f"|{AXES[3 - i - j]}| < {SLICE}", fontsize=9)
            axes.set_xlabel(AXES[i])
            axes.set_ylabel(AXES[j])
            axes.grid(alpha=0.3)
        figure.axes[0].legend(fontsize=8, loc="upper left")
        axes = figure.add_subplot(grid[1, :])
        for values, color in ((before, BEFORE), (after, AFTER)):
            distance = 100.0 * (np.linalg.norm(values, axis=1) - 1.0)
            rms = np.sqrt(np.mean(distance**2))
            axes.plot(distance, ".-", lw=0.5, ms=3, color=color, label=f"rms {rms:.2g} %")
        axes.set_xlabel(what)
        axes.set_ylabel("off the sphere, %")
        axes.legend(fontsize=8)
        axes.grid(alpha=0.3)

    return draw


def circle(before: np.ndarray, after: np.ndarray) -> Callable[[Any], None]:
    """Level readings before and after, and how far each is off the circle over its direction.

    before, after: (N, 2), forward and left, in units of the circle's radius.
    """

    def draw(figure: Any) -> None:
        plane, over = figure.subplots(1, 2)
        angle = np.linspace(0.0, 2.0 * np.pi, 200)
        plane.plot(np.cos(angle), np.sin(angle), color="black", lw=0.8)
        direction = np.degrees(np.arctan2(after[:, 1], after[:, 0]))
        for values, color, label in ((before, BEFORE, "before"), (after, AFTER, "after")):
            plane.plot(values[:, 0], values[:, 1], ".", ms=3, color=color, label=label)
            distance = 100.0 * (np.hypot(values[:, 0], values[:, 1]) - 1.0)
            rms = np.sqrt(np.mean(distance**2))
            over.plot(direction, distance, ".", ms=3, color=color, label=f"rms {rms:.2g} %")
        plane.set_aspect("equal")
        plane.set_xlabel("forward")
        plane.set_ylabel("left")
        over.set_xlabel("direction of the field, deg")
        over.set_ylabel("off the circle, %")
        for axes in (plane, over):
            axes.legend(fontsize=8)
            axes.grid(alpha=0.3)

    return draw


def residuals(
    x: np.ndarray, residual: np.ndarray, x_label: str, y_label: str, title: str
) -> Callable[[Any], None]:
    """Residuals (N, 3) of a fit over x, (N,) or (N, 3)."""

    def draw(figure: Any) -> None:
        axes = figure.add_subplot()
        columns = x if x.ndim == 2 else np.repeat(x[:, None], 3, axis=1)
        for at, name in enumerate(AXES):
            axes.plot(columns[:, at], residual[:, at], "o", ms=4, label=name)
        axes.axhline(0.0, color="black", lw=0.8)
        axes.set_xlabel(x_label)
        axes.set_ylabel(y_label)
        axes.set_title(title, fontsize=10)
        axes.legend()
        axes.grid(alpha=0.3)

    return draw


def stretches(
    seconds: np.ndarray, values: np.ndarray, spans: Sequence[tuple[float, float]], y_label: str
) -> Callable[[Any], None]:
    """Readings (N, 3) over time, with the stretches that were used shaded."""

    def draw(figure: Any) -> None:
        axes = figure.add_subplot()
        every = max(len(seconds) // 5000, 1)
        for at, name in enumerate(AXES):
            axes.plot(seconds[::every], values[::every, at], lw=0.5, label=name)
        for first, last in spans:
            axes.axvspan(first, last, color="black", alpha=0.1, lw=0)
        axes.set_xlabel("time, s")
        axes.set_ylabel(y_label)
        axes.set_title("at rest where shaded", fontsize=10)
        axes.legend()
        axes.grid(alpha=0.3)

    return draw
