"""The smoother on BROAD, in a simulated world, and as a node."""

import broad_figures
import numpy as np
import pytest

import lodeflow as lf
from lodeflow.clock import SimClock
from lodeflow.testing import check_node, run_node
from lodeflow_plugins.fusion.attitude_fuser.node import AttitudeFuser
from lodeflow_plugins.fusion.offline_attitude import smoother
from lodeflow_plugins.fusion.offline_attitude.node import OfflineAttitude
from lodeflow_plugins.scoring.attitude_score import metric
from lodeflow_plugins.sources.broad import BroadTrial
from lodeflow_plugins.sources.simulated_vehicle import model

# Total, heading and inclination RMSE in degrees, with the defaults.
FIGURES = {
    "02_undisturbed_slow_rotation_B": (1.08, 1.03, 0.35),
    "18_undisturbed_fast_translation_with_breaks_B": (0.73, 0.44, 0.58),
    "25_disturbed_tapping_B": (1.40, 1.35, 0.36),
    "27_disturbed_phone_vibration_B": (6.56, 6.55, 0.37),
    "31_disturbed_stationary_magnet_D": (1.04, 0.60, 0.85),
    "34_disturbed_attached_magnet_3cm": (1.35, 1.28, 0.44),
}


def rmse(estimate, truth, moving):
    state = metric.new_state()
    metric.accumulate(estimate, truth, moving, state)
    score = metric.score(state)
    return np.degrees([score.total_rmse, score.heading_rmse, score.inclination_rmse])


@broad_figures.needs_data
@pytest.mark.parametrize("trial", FIGURES)
def test_broad(trial):
    source = BroadTrial(BroadTrial.Params(file=str(broad_figures.path_of(trial))))
    imus, mags, truths = zip(*source.read(SimClock()), strict=True)
    truth = lf.AttitudeTruth.concat(truths)
    out = run_node(OfflineAttitude, imu=lf.Imu.concat(imus), mag=lf.MagneticField.concat(mags))
    found = rmse(out["out"].quaternion, truth.quaternion, truth.moving)
    np.testing.assert_allclose(found, FIGURES[trial], atol=0.01)


def sensors(seconds, hertz=50):
    t = np.arange(seconds * hertz, dtype=np.int64) * (10**9 // hertz)
    truth = model.truth(model.Vehicle(), t * 1e-9)
    bias = model.SensorError(0.003, (0.003, -0.002, 0.004))
    read = model.readings(truth, model.Errors(bias, model.SensorError(0.05)), 0, 0)
    slow = np.arange(1, len(t), 3)
    mag = lf.MagneticField(t[slow] + 7_000_000, np.ascontiguousarray(read.magnetic_field[slow]))
    return lf.Imu(t, read.angular_velocity, read.specific_force), mag, truth


def test_it_is_better_than_what_it_smooths_above_all_behind_a_disturbance():
    imu, mag, truth = sensors(120)
    disturbed = (mag.t > 30 * 10**9) & (mag.t < 60 * 10**9)
    field = mag.magnetic_field + disturbed[:, None] * np.array([3e-6, 1e-5, -6e-6])
    mag = mag.replace(magnetic_field=field)
    everywhere = np.ones(len(imu), np.int64)
    live, offline = [
        rmse(run_node(node, imu=imu, mag=mag)["out"].quaternion, truth.quaternion, everywhere)
        for node in (AttitudeFuser, OfflineAttitude)
    ]
    assert (offline < 0.9 * live).all()


def test_any_split_gives_the_same_bytes():
    imu, mag, _ = sensors(8)
    params = {"start_duration": 0.5, "output_advance": 0.002}
    check_node(OfflineAttitude, params, inputs={"imu": imu, "mag": mag})


def test_recordings_without_a_field_and_without_samples():
    imu, mag, truth = sensors(20)
    out = run_node(OfflineAttitude, imu=imu, mag=mag[:0])["out"]
    assert out.t.tolist() == imu.t.tolist()
    everywhere = np.ones(len(imu), np.int64)
    assert rmse(out.quaternion, truth.quaternion, everywhere)[2] < 2.0
    assert len(run_node(OfflineAttitude, imu=imu[:0], mag=mag)["out"]) == 0
    assert len(run_node(OfflineAttitude, imu=imu[:1], mag=mag)["out"]) == 1


def test_upright():
    rng = np.random.default_rng(0)
    q = smoother.product(rng.standard_normal((50, 4)), np.tile([0.0, 0.0, 0.0, 1.0], (50, 1)))
    up = rng.standard_normal((50, 3))
    up[0] = -smoother.vertical(q[:1])[0]
    turned = smoother.product(smoother.upright(q, up), q)
    expected = up / np.linalg.norm(up, axis=1)[:, None]
    np.testing.assert_allclose(smoother.vertical(turned)[1:], expected[1:], atol=1e-12)
    assert np.isfinite(turned).all()
