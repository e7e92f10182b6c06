"""The corrections on lines of an airborne survey, in the folder that LODEFLOW_DATA names."""

import os
from pathlib import Path

import numpy as np
import pytest

from lodeflow.clock import SimClock
from lodeflow.testing import run_node
from lodeflow_plugins.gravimetry.earth.node import (
    Eotvos,
    HorizontalCoriolis,
    KinematicAcceleration,
)
from lodeflow_plugins.gravimetry.tilt.node import GravityLowPass, TiltCorrection
from lodeflow_plugins.sources.airborne_line import AirborneLine

DATA = os.environ.get("LODEFLOW_DATA")
pytestmark = pytest.mark.skipif(
    DATA is None, reason="LODEFLOW_DATA does not name a folder with gravity/"
)
MGAL = 1e-5
# Line: horizontal C, and mean of classical - modified, in mGal.
LINES = {"04": ((338, -446), 0.10), "05": ((-301, 397), 0.14)}


def flight(line):
    source = AirborneLine.Params(file=str(Path(DATA) / "gravity" / f"EastVicTest_8001.{line}.npz"))
    parts = list(AirborneLine(source).read(SimClock()))
    return [type(blocks[0]).concat(blocks) for blocks in zip(*parts, strict=True)]


@pytest.mark.parametrize("line", LINES)
def test_eotvos_is_the_contractors_to_0_01_mgal(line):
    _, motion, reference = flight(line)
    found = run_node(Eotvos, motion=motion)["out"]
    assert len(found) > 1500
    assert np.abs(found.correction - reference.correction).max() / MGAL < 0.0075


@pytest.mark.parametrize("line", LINES)
def test_the_platform_senses_the_coriolis_acceleration(line):
    force, motion, _ = flight(line)
    c = run_node(HorizontalCoriolis, motion=motion)["out"].acceleration.mean(axis=0) / MGAL
    np.testing.assert_allclose(c[:2], LINES[line][0], atol=3)
    a = run_node(KinematicAcceleration, motion=motion)["out"].acceleration
    excess = (force.specific_force[1:-1] - a).mean(axis=0) / MGAL
    assert np.sign(excess[:2]).tolist() == np.sign(c[:2]).tolist()
    assert np.abs(excess[:2] - c[:2]).max() < 120  # the tilt of the platform


@pytest.mark.parametrize("line", LINES)
def test_tilt_correction(line):
    _, omitted = LINES[line]
    means = corrections(line, 60.0)
    assert means["classical"] - means["modified"] == pytest.approx(omitted, abs=0.02)
    assert means["modified"] == pytest.approx(means["exact"], abs=1e-3)
    assert abs(means["modified"]) < 0.1 < means["classical"] < 0.3


def test_squares_of_what_was_not_filtered_blow_up():
    means = {period: corrections("04", period)["modified"] for period in (5.0, 20.0, 60.0)}
    assert means[5.0] > 10 * abs(means[20.0])
    assert abs(means[20.0]) > 2 * abs(means[60.0])


def corrections(line, period):
    """Means in mGal, low-passed."""
    force, motion, _ = flight(line)
    out = run_node(
        TiltCorrection,
        {"period": period},
        force=force,
        acceleration=run_node(KinematicAcceleration, motion=motion)["out"],
        coriolis=run_node(HorizontalCoriolis, motion=motion)["out"],
    )
    smooth = {name: run_node(GravityLowPass, raw=raw)["out"] for name, raw in out.items()}
    return {name: float(s.correction.mean()) / MGAL for name, s in smooth.items()}
