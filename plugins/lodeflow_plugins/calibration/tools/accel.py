"""`lodeflow calibrate accel`: the twelve coefficients of an accelerometer."""

from __future__ import annotations

from typing import Annotated, Literal

import numpy as np
from pydantic import Field, model_validator

import lodeflow as lf
from lodeflow_plugins.calibration import least_squares
from lodeflow_plugins.calibration.tools import figures, positions

Axis = Literal["x", "-x", "y", "-y", "z", "-z"]
NAMES = ("x up", "x down", "y up", "y down", "z up", "z down")
FACES = np.array([sign * axis for axis in np.eye(3) for sign in (1.0, -1.0)])
"""Specific force in g, FLU, in each of the six positions."""
NEAREST = np.cos(np.radians(20.0))
"""A position further from all faces than this is none of the six."""
RECORD = "rest the sensor on each of its six faces, on a level plate, for a second or more"


class Accel(lf.CalibrationTool):
    """Gain and offset of an accelerometer, twelve coefficients, for accel_calibrator.

    Rest the sensor on each of its six faces, on a level plate, in any order, for a second or more
    (Chu et al. 2017, Eq. 8 and Table 2); the positions are found in the recording. With
    `attitude`, the readings of a platform, any six positions or more do that it holds.
    """

    class Params(lf.Params):
        """How the sensor sits in the body, and what to ask of the data."""

        mounting: tuple[Axis, Axis, Axis] = ("x", "y", "z")
        """Body axis, forward x, left y, up z, that each sensor axis points along, roughly."""
        gravity: Annotated[float, lf.MeterPerSecondSquared] = Field(lf.STANDARD_GRAVITY, gt=0)
        """At the place."""
        samples: int = Field(100, ge=8)
        """Fewest in a position."""
        tolerance: float = Field(0.02, gt=0)
        """Largest distance of a position from the fit, g."""

        @model_validator(mode="after")
        def _is_a_triad(self) -> Accel.Params:
            if {axis[-1] for axis in self.mounting} != set("xyz"):
                raise ValueError("mounting should name each of x, y and z once, with its sign")
            return self

    def calibrate(self, raw: lf.RawForce, attitude: lf.Attitude | None = None) -> lf.Calibration:
        p = self.params
        notes = []
        if attitude is None:
            found = positions.find(raw.t, raw.counts, 1.0, raw.t, raw.counts, p.samples)
            found, force = self._faces(found)
            notes.append(
                "which axis points up was told by mounting, not by the data; the level of the "
                "plate is part of the misalignment"
            )
        else:
            found, matrices = positions.at_attitudes(attitude, raw.t, raw.counts, p.samples)
            force = matrices[:, 2, :]  # up in the body
        try:
            fit = least_squares.accelerometer(found.sensor, force)
        except ValueError as error:
            raise lf.CalibrationError(f"{error}; {RECORD}") from error
        residual = force - fit.model(found.sensor)
        if refusal := positions.too_far(found, residual, p.tolerance, "g"):
            raise refusal
        sensitivity = 1.0 / np.linalg.norm(fit.gain, axis=0)
        return lf.Calibration(
            "accel_calibrator",
            {"unit": p.gravity, "gain": fit.gain, "offset": fit.offset, "body_axes": "flu"},
            [
                lf.Quantity("gain", fit.gain, "g/LSB", fit.gain_error),
                lf.Quantity("offset", fit.offset, "g", fit.offset_error),
                lf.Quantity("sensitivity", sensitivity, "LSB/g"),
                lf.Quantity("residual rms", 1e3 * fit.residual_rms, "mg"),
                lf.Quantity("condition number", fit.condition),
                lf.Quantity("positions", len(found)),
                lf.Quantity("samples in a position, fewest", int(found.count.min())),
            ],
            notes,
            figures.residuals(
                np.arange(1.0, len(found) + 1.0),
                1e3 * residual,
                "position",
                "residual, mg",
                f"accelerometer in {len(found)} positions at rest",
            ),
        )

    def _faces(self, found: positions.Positions) -> tuple[positions.Positions, np.ndarray]:
        """Return the positions, and the specific force, (P, 3) in g, in each."""
        rows = np.array(
            [FACES[NAMES.index(f"{a[-1]} up")] * (-1) ** (len(a) - 1) for a in self.params.mounting]
        )
        direction = found.sensor / np.linalg.norm(found.sensor, axis=1, keepdims=True)
        cosines = direction @ rows @ FACES.T
        face = np.argmax(cosines, axis=1)
        for at in np.flatnonzero(cosines.max(axis=1) < NEAREST):
            angle = np.degrees(np.arccos(cosines[at].max()))
            raise lf.CalibrationError(
                f"the data contradict each other: the sensor rests at {found.seconds[at]:.1f} s, "
                f"{angle:.0f} degrees from the nearest face; {RECORD}, or record the attitude "
                "of a platform along"
            )
        if missing := [name for at, name in enumerate(NAMES) if at not in face]:
            raise lf.CalibrationError(
                f"no rest of {self.params.samples} samples with {', '.join(missing)}; found "
                f"{len(found)} rests ({', '.join(NAMES[at] for at in face)}); {RECORD}"
            )
        return found, FACES[face]
