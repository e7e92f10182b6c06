"""Kinds of `lodeflow calibrate` for two compasses: pair and fcm."""

from __future__ import annotations

from collections.abc import Callable
from typing import Annotated, Any

import numpy as np
from pydantic import Field

import lodeflow as lf
from lodeflow_plugins.calibration.tools.figures import AFTER, BEFORE
from lodeflow_plugins.interference import fuzzy_c_means
from lodeflow_plugins.interference.fcm_stage import FcmLearning, FcmParams, FcmStage
from lodeflow_plugins.interference.stages import TRUSTED

STARTS = 5
"""Starts from which clusters are learned again, to see whether the data determine them."""
SAME = 0.1
"""Largest move of a centre from start to start, in units of the limits, that counts as none."""

ALIKE = 0.005
"""Difference of the strengths of two compasses, as a part, that goes without a word."""


class Pair(lf.CalibrationTool):
    """Undisturbed field and heading difference of two calibrated compasses, for dmc_features.

    Give the streams behind the ellipse_calibrators, level, with nothing magnetic near; best of a
    whole turn, as what is left of the ellipses differs with the heading.

    Source: Hao, Yang and Huang, section 1: the initial difference at the table's zero mark.
    """

    class Params(lf.Params):
        """What to ask of the data."""

        tolerance: Annotated[float, lf.Radian] = Field(float(np.radians(3.0)), gt=0)
        """Largest standard deviation of the heading difference."""
        field_tolerance: float = Field(0.05, gt=0)
        """Largest standard deviation of the strength of the field, as part of it."""

    def calibrate(self, first: lf.MagneticField, second: lf.MagneticField) -> lf.Calibration:
        p = self.params
        t, one, other = np.intersect1d(first.t, second.t, return_indices=True)
        if len(t) < 2:
            raise lf.CalibrationError(
                "the compasses have no two stamps in common; record both from the same readings"
            )
        a, b = (
            x[:, 0] + 1j * x[:, 1]
            for x in (first.magnetic_field[one], second.magnetic_field[other])
        )
        each = np.array([np.abs(a).mean(), np.abs(b).mean()])
        strength = np.abs(np.concatenate([a, b]))
        field, spread = float(strength.mean()), float(strength.std())
        apart = a * b.conj()
        mean = float(np.angle((apart / np.abs(apart)).sum()))
        off = np.angle(apart * np.exp(-1j * mean))
        deviation = float(off.std())
        if deviation > p.tolerance or spread > p.field_tolerance * field:
            raise lf.CalibrationError(
                f"the heading difference varies by {np.degrees(deviation):.2g}° (at most "
                f"{np.degrees(p.tolerance):.2g}°) and the field by {100 * spread / field:.2g} % "
                f"(at most {100 * p.field_tolerance:g} %): something magnetic was near, or a "
                "compass is not calibrated; find its ellipse first, and record with nothing "
                "magnetic near"
            )
        error = deviation / np.sqrt(len(t))
        notes = [
            "an error that both compasses share is not observable: compare with a known heading",
            "a file replaces what a graph sets: give rate_interval and gap of dmc_features again",
        ]
        if (unlike := abs(float(each[0] / each[1]) - 1.0)) > ALIKE:
            notes.append(
                f"the fields of the compasses differ by {100 * unlike:.2g} %, which counts as a "
                "field error: give the same field to both ellipse_calibrators"
            )
        return lf.Calibration(
            "dmc_features",
            {"field": field, "initial_difference": mean},
            [
                lf.Quantity("horizontal field", 1e6 * field, "uT", 1e6 * spread / np.sqrt(len(t))),
                lf.Quantity("horizontal field, first and second", 1e6 * each, "uT"),
                lf.Quantity("field, standard deviation", 100.0 * spread / field, "% of the field"),
                lf.Quantity("heading difference", np.degrees(mean), "°", np.degrees(error)),
                lf.Quantity("heading difference, standard deviation", np.degrees(deviation), "°"),
                lf.Quantity("readings", len(t)),
            ],
            notes,
            _differences((t - t[0]) * 1e-9, np.degrees(np.angle(apart)), np.degrees(off)),
        )


class FcmClusters(lf.CalibrationTool):
    """Fuzzy clusters of field errors and heading differences, for fcm_stage.

    Record the features and what threshold_stage says of them, with disturbances as they come
    where the compasses are to be used. Samples that the thresholds refuse are left out.
    `field_error` and `heading_difference` should be the limits of that stage.

    Source: Hao, Yang and Huang, section 4.2.
    """

    Params = FcmLearning

    def calibrate(self, features: lf.CompassFeatures, passed: lf.Credibility) -> lf.Calibration:
        p = self.params
        _, rows, same = np.intersect1d(features.t, passed.t, return_indices=True)
        rows = rows[passed.valid[same] > 0]
        difference = np.abs(features.heading_difference[rows]) / p.heading_difference
        strength = np.abs(features.field_error[rows]) / p.field_error
        if len(rows) and max(difference.max(), strength.max()) > 1.0:
            raise lf.CalibrationError(
                f"passed samples lie up to {strength.max():.3g} field_error and "
                f"{difference.max():.3g} heading_difference off: set both to the limits of the "
                "threshold_stage that was recorded"
            )
        centres, quantities, notes, panels = {}, [], [], []
        for at, name in enumerate(("first", "second")):
            points = np.column_stack([strength[:, at], difference])
            found, moved = self._learned(points)
            centres[f"{name}_centres"] = found.centres
            trusted = found.memberships[:, -TRUSTED:].sum(axis=1)
            panels.append((name, points, trusted, found.centres))
            quantities += [
                lf.Quantity(f"{name} centres, per limit", found.centres),
                lf.Quantity(f"{name} share of the samples", found.memberships.mean(axis=0)),
                lf.Quantity(f"{name} iterations", found.iterations),
                lf.Quantity(f"{name} largest move of a centre from other starts", moved),
            ]
            if moved > SAME:
                notes.append(
                    f"the clusters of the {name} compass are not determined: from another start a "
                    f"centre lies {moved:.2g} away; record more disturbances, or ask for fewer "
                    "clusters"
                )
        shared = {name: getattr(p, name) for name in FcmParams.model_fields}
        return lf.Calibration(
            "fcm_stage",
            {**shared, **centres},
            [*quantities, lf.Quantity("samples", len(rows))],
            notes,
            _clusters(panels),
        )

    def _learned(self, points: np.ndarray) -> tuple[fuzzy_c_means.Clusters, float]:
        """Return the clusters, and how far centres move with other first memberships."""
        p = self.params
        try:
            found, *others = (
                fuzzy_c_means.fit(
                    points, p.clusters, fuzzifier=p.fuzzifier, tolerance=p.tolerance, seed=seed
                )
                for seed in range(p.seed, p.seed + STARTS)
            )
        except ValueError as error:
            raise lf.CalibrationError(
                f"{error}; record more, or open the limits of threshold_stage"
            ) from error
        moved = [
            np.linalg.norm(found.centres[:, None] - other.centres, axis=2).min(axis=1).max()
            for other in others
        ]
        return found, float(max(moved))


def _differences(
    seconds: np.ndarray, before: np.ndarray, after: np.ndarray
) -> Callable[[Any], None]:
    """Heading differences (N,) in degrees before and after, over time."""

    def draw(figure: Any) -> None:
        axes = figure.add_subplot()
        for values, color, label in ((before, BEFORE, "before"), (after, AFTER, "after")):
            axes.plot(seconds, values, ".", ms=3, color=color, label=label)
        axes.axhline(0.0, color="black", lw=0.8)
        axes.set_xlabel("time, s")
        axes.set_ylabel("heading difference, deg")
        axes.legend(fontsize=8)
        axes.grid(alpha=0.3)

    return draw


Panel = tuple[str, np.ndarray, np.ndarray, np.ndarray]
"""A compass: its name, points (N, 2), membership in the trusted clusters (N,), centres (c, 2)."""


def _clusters(panels: list[Panel]) -> Callable[[Any], None]:
    """Samples that the thresholds left, those that the clusters trust, and the centres."""
    credible = FcmStage.Params.model_fields["credible"].default

    def draw(figure: Any) -> None:
        for at, (name, points, trusted, centres) in enumerate(panels):
            axes = figure.add_subplot(1, len(panels), at + 1)
            kept = trusted > credible
            for rows, color, label in ((~kept, BEFORE, "refused"), (kept, AFTER, "credible")):
                axes.plot(*points[rows].T, ".", ms=2, alpha=0.5, color=color, label=label)
            axes.plot(*centres.T, "kx", label="centres")
            axes.set_title(f"{name} compass", fontsize=10)
            axes.set_xlabel("field error / limit")
            axes.set_ylabel("heading difference / limit")
            axes.legend(fontsize=8)
            axes.grid(alpha=0.3)

    return draw
