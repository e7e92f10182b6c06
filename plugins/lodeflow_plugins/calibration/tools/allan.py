"""`lodeflow calibrate allan`: the noises of a sensor at rest."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

import lodeflow as lf
from lodeflow_plugins.calibration import allan, rests

NAMES = ("quantization noise Q", "white noise N", "bias instability B", "rate random walk K")
UNITS = ("{} s", "{}/√Hz", "{}", "{}/√s")


class Allan(lf.CalibrationTool):
    """Allan deviation of sensors at rest: white noise, bias instability, random walk.

    Let the sensor lie still for as long as you can, an hour is good, at a steady temperature and
    without gaps. Streams that are left out with --stream NAME= are not looked at. The file tells
    the results; no node reads it.
    """

    def calibrate(
        self,
        raw_rate: lf.RawRate | None = None,
        raw_force: lf.RawForce | None = None,
        raw_mag: lf.RawField | None = None,
        imu: lf.Imu | None = None,
        mag: lf.MagneticField | None = None,
    ) -> lf.Calibration:
        given: list[tuple[str, str, Any, Any]] = [
            (name, "LSB", block.t, block.counts)
            for name, block in (
                ("raw_rate", raw_rate),
                ("raw_force", raw_force),
                ("raw_mag", raw_mag),
            )
            if block is not None
        ]
        if imu is not None:
            given.append(("imu rate", "rad/s", imu.t, imu.angular_velocity))
            given.append(("imu force", "m/s²", imu.t, imu.linear_acceleration))
        if mag is not None:
            given.append(("mag", "T", mag.t, mag.magnetic_field))
        if not given:
            raise lf.CalibrationError("the recording has no stream of a sensor that it looks at")
        quantities, shown, notes = [], [], []
        for name, unit, t, values in given:
            found = [self._noises(name, t, values[:, axis]) for axis in range(3)]
            shown.append((name, unit, found))
            coefficients = np.array([noises.coefficients for noises in found])
            errors = np.array([noises.errors for noises in found])
            for at, (noise, form) in enumerate(zip(NAMES, UNITS, strict=True)):
                if np.isfinite(coefficients[:, at]).any():
                    row = coefficients[:, at], form.format(unit), errors[:, at]
                    quantities.append(lf.Quantity(f"{name}: {noise}", *row))
                else:
                    notes.append(f"{name}: no {noise} shows in a record of this length")
            longest = float(found[0].tau[-1])
            quantities.append(lf.Quantity(f"{name}: longest averaging time", longest, "s"))
        return lf.Calibration("", {}, quantities, notes, _figure(shown))

    def _noises(self, name: str, t: np.ndarray, signal: np.ndarray) -> allan.Noises:
        pieces = rests.pieces_of(t)
        if len(pieces) != 1:
            last = 0.0 if not pieces else (int(t[pieces[0][1] - 1]) - int(t[0])) * 1e-9
            raise lf.CalibrationError(
                f"{name}: {max(len(pieces) - 1, 0)} gaps in the stamps, the first after {last:.3f} "
                "s; record without gaps, or less at a time"
            )
        rate = (len(t) - 1) / max((int(t[-1]) - int(t[0])) * 1e-9, 1e-9)
        try:
            return allan.analyse(signal, rate)
        except ValueError as error:
            raise lf.CalibrationError(
                f"{name}: {error}; record the sensor at rest for minutes to hours"
            ) from error


def _figure(shown: list[tuple[str, str, list[allan.Noises]]]) -> Callable[[Any], None]:
    def draw(figure: Any) -> None:
        for at, (name, unit, found) in enumerate(shown):
            axes = figure.add_subplot(1, len(shown), at + 1)
            for noises, label in zip(found, "xyz", strict=True):
                low, high = (noises.deviation * (1.0 + s * noises.relative_error) for s in (-1, 1))
                (line,) = axes.loglog(noises.tau, noises.deviation, lw=1, label=label)
                axes.fill_between(
                    noises.tau,
                    np.maximum(low, 1e-30),
                    high,
                    color=line.get_color(),
                    alpha=0.2,
                    lw=0,
                )
            n = np.nanmean([noises.coefficients[1] for noises in found])
            if np.isfinite(n):
                tau = found[0].tau
                axes.loglog(tau, n / np.sqrt(tau), "k--", lw=0.8, label="white noise")
            axes.set_title(name, fontsize=10)
            axes.set_xlabel("averaging time, s")
            axes.set_ylabel(f"Allan deviation, {unit}")
            axes.grid(alpha=0.3, which="both")
            axes.legend(fontsize=8)

    return draw
