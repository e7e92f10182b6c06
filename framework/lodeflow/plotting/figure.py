"""The figure: panels of lines over one axis of time, modes as shaded spans."""

from __future__ import annotations

import datetime
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from lodeflow.errors import RecordingError, did_you_mean
from lodeflow.plotting.decimation import Stamps, Values, broken
from lodeflow.plotting.quantities import Quantity
from lodeflow.plotting.read import Read, modes_held
from lodeflow.plotting.request import Line, Panel, sources
from lodeflow.plotting.style import AXES, COLORS, FAINT, SHADES, load, styled

FORMATS = ("png", "svg", "pdf")
_HEIGHTS = {1: 4.4, 2: 3.0}  # inches of a panel, by how many there are
_SCALES = ((3 * 86400, 86400, "days"), (3 * 3600, 3600, "h"), (0, 1, "s"))
_CALENDAR = 10**17  # ns; stamps above that, of 1973, are those of a clock


def format_of(path: Path) -> str:
    """Return the format that the name of a file asks for.

    Raises:
        RecordingError: no figure is written in that format.
    """
    form = path.suffix.removeprefix(".").lower()
    if form not in FORMATS:
        named = f"'{path.suffix}'" if path.suffix else "a name without suffix"
        raise RecordingError(
            f"{path}: no figure is written as {named}{did_you_mean(form, FORMATS)} "
            f"({', '.join('.' + known for known in FORMATS)})"
        )
    return form


def write(drawn: Any, path: Path) -> None:
    """Write a figure, over an older one.

    Raises:
        RecordingError: the file cannot be written, or has no suffix of a format.
    """
    form = format_of(path)
    metadata = {"png": {"Software": None}, "svg": {"Date": None}, "pdf": {"CreationDate": None}}
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with styled():
            drawn.savefig(path, format=form, metadata=metadata[form])
    except OSError as error:
        raise RecordingError(f"{path}: cannot be written: {error.strerror}") from error


def show(panels: Sequence[Panel], found: Read, names: Sequence[str]) -> None:
    """Show a figure in a window until it is closed; see `draw` for the arguments.

    Raises:
        RecordingError: there is no display.
    """
    what = "there is no display to open a window on; write a file with --to plot.png"
    pyplot = load("matplotlib.pyplot")
    try:
        with styled():
            made = pyplot.figure()
            if not hasattr(made.canvas.manager, "window"):
                raise RecordingError(what)
            draw(panels, found, names, made)
            pyplot.show()
    except ImportError as error:  # a backend was asked for that does not work here
        raise RecordingError(what) from error


def draw(
    panels: Sequence[Panel], found: Read, names: Sequence[str], into: Any | None = None
) -> Any:
    """Return a figure of some panels.

    Args:
        panels: what to draw; a single mode of a single recording is shaded behind the others,
            several have panels of their own.
        found: what was read for them.
        names: what each recording is called.
        into: an empty figure of matplotlib; a new one, which needs no display, if None.
    """
    modes = [panel for panel in panels if panel.is_mode]
    plain = [panel for panel in panels if not panel.is_mode]
    behind = modes[0].lines[0] if plain and len(modes) == 1 and len(modes[0].lines) == 1 else None
    strips = [line for panel in modes for line in panel.lines if line is not behind]
    height = _HEIGHTS.get(len(plain), 2.1)
    heights = [height] * len(plain) + [0.55] * len(strips)
    with styled():
        size = (10.0, sum(heights) + 0.75 + 0.25 * len(strips))
        made = load("matplotlib.figure").Figure() if into is None else into
        made.set_size_inches(size)
        made.set_layout_engine("constrained", h_pad=0.06, w_pad=0.08)
        grid = made.subplots(
            len(heights), 1, sharex=True, squeeze=False, gridspec_kw={"height_ratios": heights}
        )
        axes = grid[:, 0].tolist()
        seconds, unit = next((s, u) for least, s, u in _SCALES if _length(found) >= least)
        look = _Look(panels, names, seconds * 1e9)
        for panel, axis in zip(plain, axes, strict=False):
            look.lines(panel, axis, found)
        for line, axis in zip(strips, axes[len(plain) :], strict=True):
            look.strip(line, axis, found)
        if behind is not None:
            look.shade(behind, axes[: len(plain)], found, made)
        axes[-1].set_xlabel(_time(found, unit))
        axes[-1].set_xlim(found.start / seconds / 1e9, found.end / seconds / 1e9)
        made.suptitle(" · ".join(names), x=0.995, ha="right", fontsize=8, color=FAINT)
    return made


def _length(found: Read) -> float:
    return (found.end - found.start) / 1e9


def _time(found: Read, unit: str) -> str:
    if not found.common:
        return f"time since the start of each recording ({unit})"
    if found.origin < _CALENDAR:
        return f"time since the first message ({unit})" if found.origin else f"time ({unit})"
    begun = datetime.datetime.fromtimestamp(found.origin // 10**9, tz=datetime.UTC)
    return f"time since {begun:%Y-%m-%d %H:%M:%S} UTC ({unit})"


class _Look:
    """Which colours and names things have in a figure."""

    def __init__(self, panels: Sequence[Panel], names: Sequence[str], scale: float) -> None:
        self.names = names
        self.scale = scale
        self.sources = sources(panels)
        self.several = len({line.recording for panel in panels for line in panel.lines}) > 1
        shown = dict.fromkeys(
            value for p in panels for line in p.lines for value in line.quantity.modes
        )
        self.shades = {value: SHADES[i % len(SHADES)] for i, value in enumerate(sorted(shown))}

    def source(self, line: Line) -> str:
        """What a line comes from."""
        return f"{line.stream} · {self.names[line.recording]}" if self.several else line.stream

    def lines(self, panel: Panel, axis: Any, found: Read) -> None:
        """Draw a panel of lines."""
        own = {(line.recording, line.topic) for line in panel.lines}
        for place, line in enumerate(panel.lines):
            if len(own) == 1 and len(panel.lines) > 1:
                component = line.quantity.component
                label, color = component, AXES.get(component, COLORS[place % len(COLORS)])
            else:
                number = self.sources[line.recording, line.topic]
                label, color = self.source(line), COLORS[number % len(COLORS)]
            t, values = _points(line.quantity, *found.points[line])
            finite = values[np.isfinite(values)]
            # A rough line hides a smooth one: it lies beneath.
            height = 2 + 1 / (1 + np.abs(np.diff(finite)).sum())
            axis.plot(
                t / self.scale,
                values,
                color=color,
                label=label,
                drawstyle="steps-post" if line.quantity.whole else "default",
                marker="o" if len(finite) <= 60 else None,
                markersize=3,
                alpha=0.9,
                zorder=height,
            )
        axis.set_title(panel.title.replace("_", " "))
        if len(own) == 1:
            self._credit(panel.lines[0], axis)
        if len(panel.lines) > 1:
            # Over the panel, where it hides nothing.
            axis.legend(
                loc="lower center", bbox_to_anchor=(0.5, 0.985), ncols=min(len(panel.lines), 4),
                borderaxespad=0.1, handlelength=1.4, columnspacing=1.4,
            )  # fmt: skip
        axis.set_ylabel(panel.unit, rotation=0, ha="right", va="center")
        if panel.unit == "°" and panel.lines[0].quantity.turn:
            _degrees(axis)
        axis.margins(y=0.06)

    def strip(self, line: Line, axis: Any, found: Read) -> None:
        """Draw a mode alone."""
        seen = self._spans(line, [axis], found, alpha=1.0)
        axis.set_yticks([])
        axis.grid(visible=False)
        axis.set_title(line.quantity.name.replace("_", " "))
        self._credit(line, axis)
        self._legend(axis, line, seen, loc="lower center", bbox_to_anchor=(0.5, 0.97))

    def shade(self, line: Line, axes: Sequence[Any], found: Read, figure: Any) -> None:
        """Draw a mode behind panels of lines."""
        seen = self._spans(line, axes, found, alpha=0.75)
        self._legend(figure, line, seen, loc="outside upper left", title=self.source(line))

    def _credit(self, line: Line, axis: Any) -> None:
        """Say over a panel which stream it shows."""
        axis.annotate(
            self.source(line), (1, 1), (0, 4), xycoords="axes fraction", va="bottom",
            textcoords="offset points", ha="right", fontsize=8.5, color=FAINT,
        )  # fmt: skip

    def _spans(self, line: Line, axes: Sequence[Any], found: Read, alpha: float) -> list[int]:
        spans = modes_held(*found.points[line], found.end)
        for axis in axes:
            for value in dict.fromkeys(value for value, _, _ in spans):
                pieces = [
                    (begin / self.scale, (end - begin) / self.scale)
                    for mode, begin, end in spans
                    if mode == value
                ]
                axis.broken_barh(
                    pieces, (0, 1), transform=axis.get_xaxis_transform(), zorder=0, linewidth=0,
                    facecolor=self.shades.get(value, SHADES[0]), alpha=alpha,
                )  # fmt: skip
        return sorted({value for value, _, _ in spans})

    def _legend(self, on: Any, line: Line, seen: Sequence[int], **options: Any) -> None:
        patch = load("matplotlib.patches").Patch
        known: Mapping[int, str] = line.quantity.modes
        handles = [
            patch(facecolor=self.shades.get(v, SHADES[0]), label=known.get(v, str(v))) for v in seen
        ]
        on.legend(
            handles=handles, ncols=max(1, len(seen)), handlelength=1.2, borderaxespad=0.1, **options
        )


def _points(quantity: Quantity, t: Stamps, values: Values) -> tuple[Values, Values]:
    at = t.astype(np.float64)
    return broken(at, values, quantity.turn) if quantity.turn else (at, values)


def _degrees(axis: Any) -> None:
    """Put the ticks of a wide range of angles at fractions of a turn."""
    low, high = axis.dataLim.intervaly
    if not (math.isfinite(low) and high - low > 100):
        return
    step = 90 if high - low > 200 else 45
    axis.yaxis.set_major_locator(load("matplotlib.ticker").MultipleLocator(step))
