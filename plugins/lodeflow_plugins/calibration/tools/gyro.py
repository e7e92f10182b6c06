"""`lodeflow calibrate gyro` and `gyro-bias`: the coefficients of a gyroscope, and its zero."""

from __future__ import annotations

import numpy as np
from pydantic import Field

import lodeflow as lf
from lodeflow_plugins.calibration import least_squares, rests
from lodeflow_plugins.calibration.tools import figures, positions

STEADY = float(np.radians(0.01))
"""Scatter of a turntable's rate, rad/s, that is no change of it."""


class Gyro(lf.CalibrationTool):
    """Gain and bias of a gyroscope, twelve coefficients, for gyro_calibrator.

    Turn it on a turntable about all three axes at several rates both ways, each held for a second
    or more (Chu et al. 2017, Eqs. 12 to 17, six rates about each axis). `rate` is what the
    turntable tells, in the body; stretches in which it is steady are averaged.
    """

    class Params(lf.Params):
        """What to ask of the data."""

        samples: int = Field(100, ge=8)
        """Fewest at a rate."""
        tolerance: float = Field(0.02, gt=0)
        """Largest distance of a steady rate from the fit, part of the largest rate."""

    def calibrate(self, raw: lf.RawRate, rate: lf.AngularRate) -> lf.Calibration:
        p = self.params
        found = positions.find(rate.t, rate.angular_rate, STEADY, raw.t, raw.counts, p.samples)
        turned = np.degrees(found.reference)
        try:
            fit = least_squares.gyroscope(found.sensor, turned)
        except ValueError as error:
            raise lf.CalibrationError(
                f"{error}; found {len(found)} steady rates, record several, both ways, about each "
                "of the three axes"
            ) from error
        residual = turned - fit.model(found.sensor)
        largest = float(np.abs(turned).max())
        if refusal := positions.too_far(found, residual, p.tolerance * largest, "°/s"):
            raise refusal
        return lf.Calibration(
            "gyro_calibrator",
            {"unit": "1 deg/s", "k": fit.k, "body_axes": "flu"},
            [
                lf.Quantity("gain, transposed", fit.k[:3], "°/s/LSB", fit.k_error[:3]),
                lf.Quantity("bias", fit.k[3], "°/s", fit.k_error[3]),
                lf.Quantity("zero-rate output", fit.model.inverse().offset, "LSB"),
                lf.Quantity("residual rms", fit.residual_rms, "°/s"),
                lf.Quantity("condition number", fit.condition),
                lf.Quantity("steady rates", len(found)),
                lf.Quantity("samples at a rate, fewest", int(found.count.min())),
            ],
            ["the dependence on acceleration and temperature was not looked at"],
            figures.residuals(
                turned,
                residual,
                "rate about the axis, °/s",
                "residual, °/s",
                f"gyroscope at {len(found)} steady rates",
            ),
        )


class GyroBias(lf.CalibrationTool):
    """Zero-rate output of a gyroscope from rests, for gyro_calibrator over its other coefficients.

    Let the sensor lie still for ten seconds or more, warm as in use, without a turntable that
    turns: a steady turn looks like rest. Name the file behind that of `calibrate gyro`:
    `file: [gyro.yaml, gyro_bias.yaml]`.
    """

    class Params(lf.Params):
        """What to ask of the data."""

        samples: int = Field(1000, ge=100)
        """Fewest at rest, in one stretch."""
        tolerance: float = Field(10.0, gt=0)
        """Largest difference between two stretches at rest, in LSB."""

    def calibrate(self, raw: lf.RawRate) -> lf.Calibration:
        p = self.params
        found = rests.find(raw.t, raw.counts, p.samples, 1.0)
        if not found:
            raise lf.CalibrationError(
                f"nothing lies still for {p.samples} samples; record the sensor at rest for ten "
                "seconds or more"
            )
        means = np.array([rest.mean for rest in found])
        if (apart := np.ptp(means, axis=0)).max() > p.tolerance:
            raise lf.CalibrationError(
                f"the data contradict each other: {len(found)} stretches that look like rest "
                f"differ by {apart.max():.3g} LSB (at most {p.tolerance:g}); record it without "
                "steady turns, and warm"
            )
        count = np.array([rest.count for rest in found])
        bias = count @ means / count.sum()
        parts = np.concatenate([_parts(raw.counts[rest.first : rest.last]) for rest in found])
        error = parts.std(axis=0, ddof=1) / np.sqrt(len(parts))
        seconds = (raw.t - raw.t[0]) * 1e-9
        spans = [(float(seconds[r.first]), float(seconds[r.last - 1])) for r in found]
        return lf.Calibration(
            "gyro_calibrator",
            {"zero_rate": bias},
            [
                lf.Quantity("zero-rate output", bias, "LSB", error),
                lf.Quantity("noise of a sample", found[0].scatter, "LSB"),
                lf.Quantity("largest difference between stretches", apart, "LSB"),
                lf.Quantity("stretches at rest", len(found)),
                lf.Quantity("samples at rest", int(count.sum())),
            ],
            ["the turn of the earth, up to 0.0042 °/s, is part of it; so is any steady turn"],
            figures.stretches(seconds, raw.counts, spans, "raw rate, LSB"),
        )


def _parts(rows: np.ndarray) -> np.ndarray:
    """Return the means of ten parts, whose scatter shows the slow noise too."""
    return np.array([part.mean(axis=0) for part in np.array_split(rows, 10)])
