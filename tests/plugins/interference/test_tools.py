"""`lodeflow calibrate` ellipse, pair and fcm on recordings, and the nodes that read their files."""

from pathlib import Path

import matplotlib as mpl
import numpy as np
import pytest
from matplotlib.figure import Figure

import lodeflow as lf
from lodeflow.graph import load_graph_text
from lodeflow.recording.reader import Recording
from lodeflow.supervisor.calibrate import calibrate
from lodeflow.supervisor.run import run
from lodeflow_plugins.calibration import ellipse
from lodeflow_plugins.calibration.tools.ellipse import EllipseFit
from lodeflow_plugins.interference.tools import FcmClusters, Pair

mpl.use("Agg")
RAW = """\
lodeflow: 1
name: bench
nodes:
  table:
    use: turntable
    params:
      disturbed: {disturbed}
      rotations: {rotations}
      residual: 0
      first_iron: {{centre: [0.15, -0.08], radii: [1.06, 0.97], angle: 20 deg}}
      second_iron: {{centre: [-0.05, 0.12], radii: [1.03, 0.95], angle: -35 deg}}
"""
CALIBRATED = """\
  first: {use: ellipse_calibrator, inputs: {mag: table.first}, params: {file: first.yaml}}
  second: {use: ellipse_calibrator, inputs: {mag: table.second}, params: {file: second.yaml}}
"""
FEATURES = """\
  features: {use: dmc_features, inputs: {first: first, second: second}, params: {file: pair.yaml}}
  stage1: {use: threshold_stage, inputs: {features: features}}
"""
CLUSTERED = """\
  stage2:
    use: fcm_stage
    inputs: {features: features, passed: stage1}
    params: {file: fcm.yaml}
"""


@pytest.fixture(autouse=True)
def _here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


def recorded(*parts, disturbed=0, rotations=5):
    text = RAW.format(disturbed=disturbed, rotations=rotations) + "".join(parts)
    path = Path(f"{len(parts)}-{disturbed}.mcap")
    assert run(load_graph_text(text), record=str(path)).exit_code == 0
    return [path]


def kept(name, kind, *args, **options):
    """Calibrate, draw, and keep the file."""
    done = calibrate(kind, *args, **options)
    figure = Figure()
    done.found.draw(figure)
    assert figure.axes
    Path(name).write_text(done.text)
    return done


def quantity(found, name):
    (value,) = [q for q in found.quantities if q.name == name]
    return value


def test_from_recordings_to_every_stage():
    turn = recorded()
    sets = ["field=33.5 uT"]
    first = kept("first.yaml", "ellipse", turn, streams=["mag=table.first"], sets=sets)
    kept("second.yaml", "ellipse", turn, streams=["mag=table.second"], sets=sets)
    found = first.found
    error = quantity(found, "centre").error
    assert (np.abs(1e6 * np.array(found.params["centre"]) - [5.025, -2.68]) < 4 * error).all()
    error = quantity(found, "radii").error
    assert (np.abs(1e6 * np.array(found.params["radii"]) - [35.51, 32.495]) < 4 * error).all()
    angle = quantity(found, "angle")
    assert abs(angle.value - 20) < 4 * angle.error
    level = recorded(CALIBRATED)
    pair = kept("pair.yaml", "pair", level, streams=["first=first", "second=second"])
    assert pair.found.params["field"] == pytest.approx(33.5e-6, rel=1e-3)
    disturbed = recorded(CALIBRATED, FEATURES, disturbed=0.7, rotations=20)
    fcm = kept("fcm.yaml", "fcm", disturbed, streams=["passed=stage1"])
    centres = fcm.found.params["first_centres"]
    assert centres.shape == (5, 2)
    assert (np.diff(np.linalg.norm(centres, axis=1)) <= 0).all()
    (path,) = recorded(CALIBRATED, FEATURES, CLUSTERED, disturbed=0.7, rotations=20)
    with Recording(path) as recording:
        passed, credible = (
            lf.Credibility.concat(list(recording.stream(f"/{name}", lf.Credibility)))
            for name in ("stage1", "stage2")
        )
    assert 0 < credible.valid.sum() < passed.valid.sum()


def mag(angle, radius=30e-6):
    level = radius * np.column_stack([np.cos(angle), np.sin(angle), np.zeros_like(angle)])
    return lf.MagneticField(np.arange(len(angle)), level)


def test_standard_errors_of_an_ellipse_are_what_repetition_shows():
    true = ellipse.Ellipse((5.0, -3.0), (36.0, 31.0), 0.7)
    angle = np.linspace(0, 2 * np.pi, 120)
    exact = np.column_stack([np.cos(angle), np.sin(angle)]) @ true.from_circle() + true.centre
    fits = [
        ellipse.fit(exact + 0.2 * np.random.default_rng(seed).standard_normal((120, 2)))
        for seed in range(200)
    ]
    found = np.array([[*f.ellipse.centre, *f.ellipse.radii, f.ellipse.angle] for f in fits])
    told = np.array([*fits[0].centre_error, *fits[0].radii_error, fits[0].angle_error])
    np.testing.assert_allclose(found.std(axis=0), told, rtol=0.25)  # 200 show it to 5 percent


def test_an_ellipse_refuses_what_does_not_tell():
    def refused(fields):
        return pytest.raises(lf.CalibrationError, match=fields)

    with refused(r"180°; 270° are needed: turn the body"):
        EllipseFit().calibrate(mag=mag(np.linspace(0, np.pi, 40)))
    angle = np.linspace(0, 2 * np.pi, 60)
    with refused(r"contradict each other: the readings are .* % off .* not level"):
        EllipseFit().calibrate(mag=mag(angle, 30e-6 * (1 + 0.1 * np.sin(3 * angle))[:, None]))
    circle = EllipseFit().calibrate(mag=mag(angle))
    assert any("the angle of the ellipse means nothing" in note for note in circle.notes)


def test_the_initial_difference_of_a_pair():
    angle = np.linspace(0, 6, 50)
    params = Pair().calibrate(first=mag(angle + 0.03), second=mag(angle)).params
    assert params["initial_difference"] == pytest.approx(0.03)
    assert params["field"] == pytest.approx(30e-6)
    unlike = Pair().calibrate(first=mag(angle, 31e-6), second=mag(angle))
    assert any("differ by 3.3 %" in note for note in unlike.notes)
    wrapped = Pair().calibrate(first=mag(angle + 3.1), second=mag(angle - 3.1)).params
    assert wrapped["initial_difference"] == pytest.approx(6.2 - 2 * np.pi)


def test_a_pair_refuses_what_does_not_tell():
    angle = np.linspace(0, 6, 50)
    with pytest.raises(lf.CalibrationError, match="no two stamps in common"):
        Pair().calibrate(first=mag(angle), second=mag(angle).replace(t=np.arange(50) + 1000))
    disturbed = mag(angle + 0.3 * (angle > 3))
    with pytest.raises(lf.CalibrationError, match="something magnetic was near"):
        Pair().calibrate(first=disturbed, second=mag(angle))


def features(field_error, difference):
    n = len(difference)
    zero, two = np.zeros(n), np.zeros((n, 2))
    both = np.column_stack([field_error, field_error])
    t = np.arange(n)
    return (
        lf.CompassFeatures(t, zero, two, difference, zero, both, two, *[np.zeros((n, 3))] * 2),
        lf.Credibility(t, zero + 1, np.ones(n, np.int64)),
    )


def test_clusters_refuse_what_does_not_tell():
    seen, passed = features(np.zeros(3), np.zeros(3))
    with pytest.raises(lf.CalibrationError, match="3 points are too few"):
        FcmClusters().calibrate(features=seen, passed=passed)
    seen, passed = features(np.full(9, 0.3), np.zeros(9))
    with pytest.raises(lf.CalibrationError, match=r"up to 1.75 field_error .* set both"):
        FcmClusters().calibrate(features=seen, passed=passed)


def test_clusters_that_are_not_determined_are_told():
    rng = np.random.default_rng(3)
    seen, passed = features(0.17 * rng.random(12), 0.13 * rng.random(12))
    found = FcmClusters().calibrate(features=seen, passed=passed)
    assert any("are not determined" in note for note in found.notes)
