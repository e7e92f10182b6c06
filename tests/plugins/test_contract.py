"""Every installed plugin keeps the contract, and says what its parameters are."""

import numpy as np
import pytest
import scipy.io

from lodeflow.graph import load_graph_text
from lodeflow.params import docs_of
from lodeflow.registry import registry
from lodeflow.supervisor.run import run
from lodeflow.testing import check_node
from lodeflow_plugins.sources import airborne_line

BUNDLED = {
    "accel_calibrator", "acceleration_peak_steps", "airborne_line", "amvd_steps",
    "ared_steps", "attitude_fuser", "attitude_heading_estimator", "attitude_score",
    "autocorrelation_steps", "broad_trial",
    "chu_fuser", "csv", "disturbing_gravity", "dmc_features", "ellipse_calibrator", "eotvos",
    "euler_to_geographic", "fcm_score", "fcm_stage", "foot_trial", "gated_kalman",
    "gravity_low_pass", "gravity_score", "gyro_calibrator", "gyro_norm_steps",
    "heading_estimator", "heading_from_attitude", "heading_kalman", "heading_score",
    "hmr3300", "horizontal_coriolis", "imu_combiner", "imu_decimator", "inertial_attitude",
    "integrated_heading", "iron_calibrator", "kinematic_acceleration", "mag_calibrator",
    "mag_steps", "mode_switch", "nmea_heading", "offline_attitude", "online_mag_calibrator",
    "quaternion_kalman", "raw_norm_steps", "recognition_score", "recorded_sensors", "shoe_steps",
    "simulated_platform", "simulated_vehicle", "stance_track", "step_score", "step_track",
    "swing_steps", "threshold_stage", "tilt_compass", "tilt_correction", "tilt_error_budget",
    "tilting_platform", "to_geographic", "track_score", "turntable", "vehicle_in_city",
    "zero_velocity_steps",
}  # fmt: skip
PEERS = {
    "ahrs_madgwick": "ahrs", "ahrs_mahony": "ahrs", "imufusion": "imufusion",
    "offline_vqf": "vqf", "vqf": "vqf",
}  # fmt: skip
"""Plugins that wrap a package of the extra `peers`, and the package."""

CSV = """\
t,gx,gy,gz,ax,ay,az,mx,my,mz
0,1,2,3,0,0,1,20,0,-40
10,1,2,3,0,0.1,1,,,
20.5,4,5,6,0,0,0.9,21,1,-41
"""

WALK = {
    "t": np.arange(3000) / 200,
    "imu": np.random.default_rng(1).standard_normal((3000, 6)),
    "stride_index": np.array([10, 999, 1000, 2999]),
    "vicon_xy": np.zeros((3000, 2)),
}
LINE = {name: np.linspace(1.0, 2.0, 1200) for name in airborne_line.COLUMNS}

RECORDED = """\
lodeflow: 1
name: small
nodes: {vehicle: {use: simulated_vehicle, params: {duration: 3}}}
"""


@pytest.fixture(scope="session")
def files(tmp_path_factory):
    """Parameters of the sources that read a file."""
    folder = tmp_path_factory.mktemp("files")
    (folder / "sensors.csv").write_text(CSV)
    rng = np.random.default_rng(0)
    trial = {name: rng.standard_normal((3000, 3)) for name in ("imu_gyr", "imu_acc", "imu_mag")}
    quaternion = np.tile([1.0, 0.0, 0.0, 0.0], (3000, 1))
    quaternion[::50] = np.nan
    scipy.io.savemat(
        folder / "trial.mat",
        {
            **trial,
            "opt_quat": quaternion,
            "movement": np.ones((3000, 1), np.uint8),
            "sampling_rate": 2000 / 7,
        },
    )
    np.savez(folder / "walk.npz", **WALK)
    np.savez(folder / "line.npz", **LINE)
    summary = run(load_graph_text(RECORDED), record=str(folder / "small.mcap"))
    assert summary.exit_code == 0
    topics = {name: f"/vehicle/{name}" for name in ("imu", "mag", "truth")}
    return {
        "csv": {**registry().load("csv").example, "file": str(folder / "sensors.csv")},
        "foot_trial": {"file": str(folder / "walk.npz")},
        "airborne_line": {"file": str(folder / "line.npz")},
        "broad_trial": {"file": str(folder / "trial.mat")},
        "recorded_sensors": {"file": str(folder / "small.mcap"), **topics},
    }


def test_the_bundled_plugins_are_installed():
    assert set(registry().nodes) >= BUNDLED | PEERS.keys()


def load(name):
    if name in PEERS:
        pytest.importorskip(PEERS[name], reason="the extra 'peers' is not installed")
    return registry().load(name)


@pytest.mark.parametrize("name", sorted(registry().nodes))
def test_contract(name, files):
    check_node(load(name), files.get(name))


@pytest.mark.parametrize("name", sorted(registry().nodes))
def test_it_is_documented(name):
    plugin = load(name)
    assert plugin.__doc__
    assert plugin.Params.model_fields.keys() - docs_of(plugin.Params).keys() == set()
