"""From the platform to the heading, by the commands of the documentation."""

from __future__ import annotations

import json

import numpy as np
import pytest

TOOL = """\
import lodeflow as lf

class Mean(lf.CalibrationTool):
    '''Mean of the raw counts.

    Record the sensor at rest.'''

    class Params(lf.Params):
        factor: float = 2.0
        '''Of the mean.'''

    def calibrate(self, raw: lf.RawField, force: lf.SpecificForce | None = None) -> lf.Calibration:
        if len(raw) > 5000:
            raise lf.CalibrationError("too much; record less")
        mean = self.params.factor * raw.counts.mean(axis=0)
        found = [lf.Quantity("rows", len(raw)), lf.Quantity("mean", mean, "LSB", mean * 0)]
        return lf.Calibration("", {}, found, ["a note"])
"""


@pytest.fixture
def record(lodeflow, graphs):
    def run(graph, name, *options):
        lodeflow("run", graphs / "calibration" / graph, *options, "--record", name)
        return name

    return run


def test_from_the_platform_to_the_heading(quick, graphs):
    lodeflow, arg = quick, "--arg"

    def record(graph, name, *options):
        lodeflow("run", graphs / "calibration" / graph, *options, "--record", name)

    record("platform.yaml", "attitudes.mcap", "--set", "platform.rest=1.5")
    record("platform.yaml", "six.mcap", arg, "programme=six_positions")
    record("platform.yaml", "rates.mcap", arg, "programme=rates")
    record("platform.yaml", "rest.mcap", arg, "programme=rest", arg, "duration=60")
    record("tumble.yaml", "tumble.mcap", arg, "duration=200")
    done = lodeflow("calibrate", "mag", "attitudes.mcap", "--to", "calibration/mag.yaml")
    assert "strength of the field is not observable" in done.stdout
    assert "wrote calibration/mag.yaml" in done.stdout
    mounting = ["--set", "mounting=[-x, -y, z]", "--stream", "attitude="]
    lodeflow("calibrate", "accel", "six.mcap", "--to", "calibration/accel.yaml", *mounting)
    lodeflow("calibrate", "gyro", "rates.mcap", "--to", "calibration/gyro.yaml")
    lodeflow("calibrate", "gyro-bias", "rest.mcap", "--to", "calibration/zero.yaml")
    lodeflow("calibrate", "allan", "rest.mcap", "--to", "calibration/allan.yaml")
    lodeflow("calibrate", "mag", "tumble.mcap", "--to", "calibration/ellipsoid.yaml")
    kept = {path.name for path in (lodeflow.folder / "calibration").iterdir()}
    assert {"mag.yaml", "mag.png", "allan.png"} <= kept
    gyro = "gyro_cal.file=[calibration/gyro.yaml, calibration/zero.yaml]"
    for mag in ("mag", "ellipsoid"):
        files = ["--set", f"mag_cal.file=calibration/{mag}.yaml", "--set", gyro]
        files += ["--set", "accel_cal.file=calibration/accel.yaml"]
        to = ["--record", f"{mag}.mcap", "--json"]
        done = lodeflow("run", graphs / "heading.yaml", *files, *to)
        score = json.loads(done.stdout)["scores"]["score"]
        assert np.degrees(score["heading_rmse"]) < 0.2
    for path in (lodeflow.folder / "calibration").iterdir():
        path.unlink()
    done = lodeflow("replay", "mag.mcap", "--check")  # the recording alone is enough
    assert "equal to the byte" in done.stdout


def test_a_tool_in_a_file(lodeflow, record):
    lodeflow.write("tools.py", TOOL)
    rest = ["--arg", "programme=rest", "--arg", "duration=10"]
    record("platform.yaml", "rest.mcap", *rest)
    shown = lodeflow("calibrate", "tools:Mean", "--help").stdout
    for text in ("Mean of the raw counts.", "raw: RawField", "force: SpecificForce (optional)",
                 "factor: float, default 2.0", "Of the mean."):  # fmt: skip
        assert text in shown
    run = ["calibrate", "tools:Mean", "rest.mcap", "--to", "mean.yaml"]
    done = json.loads(lodeflow(*run, "--set", "factor=1", "--json").stdout)
    assert done["results"]["rows"]["value"] == 1000
    assert done["figure"] is None
    assert done["notes"] == ["a note"]
    twice = json.loads(lodeflow(*run[:3], "rest.mcap", *run[3:], "--json").stdout)
    assert twice["results"]["rows"]["value"] == 2000
    text = (lodeflow.folder / "mean.yaml").read_text()
    for line in (
        "lodeflow_calibration: 1",
        "kind: tools:Mean",
        "sha256: ",
        "raw: platform.raw_mag",
    ):
        assert line in text.replace("'", "")


def test_what_is_said_of_mistakes(lodeflow, record):
    lodeflow.write("tools.py", TOOL)
    record("platform.yaml", "rest.mcap", "--arg", "programme=rest", "--arg", "duration=51")
    to = ["--to", "out/x.yaml"]
    done = lodeflow("calibrate", "tools:Mean", "rest.mcap", *to, code=1)
    assert "lodeflow: calibrate tools:Mean: too much; record less" in done.stderr
    assert not (lodeflow.folder / "out").exists()
    done = lodeflow("calibrate", "mga", "rest.mcap", *to, code=2)
    assert "no kind of calibration is called 'mga', did you mean 'mag'?" in done.stderr
    done = lodeflow("calibrate", "mag", "rest.mcap", *to, "--set", "feild=1 uT", code=2)
    assert "--set feild=1 uT: feild: no such parameter of 'mag', did you mean 'field'?" in (
        done.stderr
    )
    done = lodeflow("calibrate", "iron", "rest.mcap", *to, code=1)
    assert "calibrate iron: rest.mcap: no stream of MagneticField for 'mag'" in done.stderr
    done = lodeflow("calibrate", "mag", "none.mcap", *to, code=1)
    assert "none.mcap" in done.stderr
    done = lodeflow("calibrate", "mag", "rest.mcap", code=2)
    assert "--to" in done.stderr
    lodeflow.write("out", "a file where the folder should be")
    done = lodeflow("calibrate", "gyro-bias", "rest.mcap", *to, code=1)
    assert "out/x.yaml cannot be written" in done.stderr
