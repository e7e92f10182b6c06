"""`lodeflow calibrate mag`: sensitivity, misalignment and bias of a magnetometer."""

from __future__ import annotations

from typing import Annotated

import numpy as np
from pydantic import Field

import lodeflow as lf
from lodeflow_plugins.calibration import error_models, separation
from lodeflow_plugins.calibration.tools import figures, positions, sphere


class Mag(lf.CalibrationTool):
    """Sensitivity, misalignment and bias of a magnetometer, for mag_calibrator.

    With `attitude`, the readings of a platform: error separation from the positions in which it
    holds still (Chu et al. 2017, Eqs. 6 and 7). Record 20 positions or more, in all headings,
    pitched and rolled to both sides, each held for a second. Without `dip`, dip and magnetic north
    are found along.

    Without: an ellipsoid through the readings. Turn the sensor slowly about all its axes, each
    pointing up and down once, far from iron. With `force`, the calibrated specific force, the
    ellipsoid's axes are aligned to the body: the angle between field and vertical is constant.
    Without it, a rotation common to all axes is not observable, and left out.
    """

    class Params(lf.Params):
        """What the data do not tell, and what to ask of them."""

        field: Annotated[float, lf.Tesla] = Field(50e-6, gt=0)
        """Strength of the earth's field at the place; sensitivities count per it."""
        dip: Annotated[float | None, lf.Radian] = None
        """Of the field, with the platform's north magnetic; null finds dip and north."""
        samples: int = Field(100, ge=8)
        """Fewest in a position."""
        tolerance: float = Field(0.02, gt=0)
        """Largest distance of a position, or rms of all readings, from the fit, per field."""

    def calibrate(
        self,
        raw: lf.RawField,
        attitude: lf.Attitude | None = None,
        force: lf.SpecificForce | None = None,
    ) -> lf.Calibration:
        if attitude is not None:
            return self._separate(raw, attitude)
        return self._ellipsoid(raw, force)

    def _separate(self, raw: lf.RawField, attitude: lf.Attitude) -> lf.Calibration:
        p = self.params
        found, matrices = positions.at_attitudes(attitude, raw.t, raw.counts, p.samples)
        try:
            done = separation.separate(found.sensor, matrices, p.dip)
        except ValueError as error:
            raise lf.CalibrationError(
                f"{error}; found {len(found)} positions, record 20 or more, in all headings, "
                "pitched and rolled to both sides"
            ) from error
        fit = done.fit
        relative = done.residuals / fit.sensitivity
        if refusal := positions.too_far(found, relative, p.tolerance, "of the field"):
            raise refusal
        notes = [strength_note(p.field)]
        if p.dip is None:
            notes.append(
                "dip and magnetic north were found along; standard errors of the sensor take them "
                "as known"
            )
        field = np.einsum("nji,j->ni", matrices, separation.direction(done.azimuth, done.dip))
        before = found.sensor / fit.sensitivity.mean()
        return lf.Calibration(
            "mag_calibrator",
            calibrator_params(p.field, fit.sensitivity, fit.misalignment, fit.bias),
            [
                lf.Quantity("sensitivity", fit.sensitivity, "LSB/field", fit.sensitivity_error),
                lf.Quantity("axis angles", np.degrees(np.arccos(fit.misalignment)), "°"),
                lf.Quantity("standard error of an axis", np.degrees(fit.direction_error), "°"),
                lf.Quantity("bias", fit.bias, "LSB", fit.bias_error),
                lf.Quantity("dip", np.degrees(done.dip), "°", np.degrees(done.dip_error)),
                lf.Quantity(
                    "magnetic north, clockwise from the platform's",
                    np.degrees(done.azimuth),
                    "°",
                    np.degrees(done.azimuth_error),
                ),
                lf.Quantity("residual rms", fit.residual_rms, "LSB"),
                lf.Quantity("condition number", fit.condition),
                lf.Quantity("positions", len(found)),
                lf.Quantity("samples in a position, fewest", int(found.count.min())),
            ],
            notes,
            figures.spheres(before, field + _mapped(fit.model, done.residuals), "position"),
        )

    def _ellipsoid(self, raw: lf.RawField, force: lf.SpecificForce | None) -> lf.Calibration:
        p = self.params
        fitted = sphere.fit(raw.counts, p.tolerance)
        up = None if force is None else (force.t, force.specific_force)
        aligned = sphere.align(fitted, raw.t, raw.counts, up)
        matrix = np.linalg.inv(aligned.matrix)
        sensitivity = np.linalg.norm(matrix, axis=1)
        misalignment = matrix / sensitivity[:, None]
        readings = sphere.thinned(raw.counts, fitted)
        before = readings / sensitivity.mean()
        return lf.Calibration(
            "mag_calibrator",
            calibrator_params(p.field, sensitivity, misalignment, fitted.centre),
            [
                lf.Quantity("sensitivity", sensitivity, "LSB/field", fitted.sensitivity_error),
                lf.Quantity("axis angles", np.degrees(np.arccos(misalignment)), "°"),
                lf.Quantity("bias", fitted.centre, "LSB", fitted.centre_error),
                *sphere.quantities(fitted, aligned, len(readings)),
            ],
            [strength_note(p.field), *aligned.notes],
            figures.spheres(before, (readings - fitted.centre) @ aligned.matrix.T, "reading"),
        )


def _mapped(model: error_models.Affine, residual: np.ndarray) -> np.ndarray:
    """Residuals (N, 3) in LSB as fields in the body."""
    return residual @ np.linalg.inv(model.matrix).T


def strength_note(field: float) -> str:
    """What a calibration says of the strength of the field."""
    return (
        f"the strength of the field is not observable: sensitivities count per {field * 1e6:g} uT, "
        "set by field"
    )


def calibrator_params(
    field: float, sensitivity: np.ndarray, misalignment: np.ndarray, bias: np.ndarray
) -> dict[str, object]:
    """The parameters of mag_calibrator."""
    return {
        "unit": field,
        "sensitivity": sensitivity,
        "bias": bias,
        "misalignment": misalignment,
        "body_axes": "flu",
    }
