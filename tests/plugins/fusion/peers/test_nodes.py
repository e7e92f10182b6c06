"""The wrapped filters: the package's own numbers, our frames, and a clear word without it."""

import sys
from pathlib import Path

import broad_figures
import numpy as np
import pytest

import lodeflow as lf
from lodeflow.graph import load_graph
from lodeflow.registry import registry
from lodeflow.supervisor.run import run
from lodeflow.testing import run_node

GRAPHS = Path(__file__).parents[4] / "graphs"
RATE = 100.0

vqf = pytest.importorskip("vqf", reason="the extra 'peers' is not installed")
imufusion = pytest.importorskip("imufusion", reason="the extra 'peers' is not installed")
ahrs_filters = pytest.importorskip("ahrs.filters", reason="the extra 'peers' is not installed")


@pytest.fixture(scope="module")
def data():
    """Half a minute of a body that turns, as an IMU and a magnetometer measure it, with noise."""
    rng = np.random.default_rng(1)
    count = 3000
    t = np.arange(count) * round(1e9 / RATE)
    rate = 0.5 * np.sin(np.outer(t * 1e-9, [0.7, 1.1, 0.4])) + 0.01 * rng.standard_normal(
        (count, 3)
    )
    force = np.tile([0.0, 0.0, 9.81], (count, 1)) + 0.1 * rng.standard_normal((count, 3))
    field = np.tile([0.0, 20e-6, -40e-6], (count, 1)) + 1e-7 * rng.standard_normal((count, 3))
    return lf.Imu(t, rate, force), lf.MagneticField(t, field)


def estimates(name, imu, mag, **params):
    return run_node(registry().load(name), params, imu=imu, mag=mag)["out"]


@pytest.mark.parametrize("params", [{}, {"rate": RATE}])
def test_vqf_gives_what_the_package_gives(data, params):
    imu, mag = data
    direct = vqf.VQF(1 / RATE).updateBatch(
        imu.angular_velocity, imu.linear_acceleration, mag.magnetic_field
    )["quat9D"]
    found = estimates("vqf", imu, mag, **params)
    assert found.t.tolist() == imu.t.tolist()
    # With the rate from the stamps, the first estimate is one at rest.
    first = 0 if params else 1
    np.testing.assert_array_equal(found.quaternion[first:], np.roll(direct, -1, 1)[first:])
    np.testing.assert_allclose(found.quaternion[0], np.roll(direct, -1, 1)[0], atol=0.01)


def test_vqf_takes_a_slower_magnetometer(data):
    imu, mag = data
    slow = mag[::5]
    estimator, expected = vqf.VQF(1 / RATE, magTs=5 / RATE), []
    for k in range(len(imu)):
        field = slow.magnetic_field[k // 5] if k % 5 == 0 else None
        estimator.update(imu.angular_velocity[k], imu.linear_acceleration[k], field)
        expected.append(np.roll(estimator.getQuat9D(), -1))
    found = estimates("vqf", imu, slow, rate=RATE, mag_rate=RATE / 5)
    np.testing.assert_array_equal(found.quaternion, expected)


def test_vqf_is_silent_before_the_first_reading(data):
    imu, mag = data
    late = mag[7:]
    assert estimates("vqf", imu, late).t[0] == late.t[0]


@pytest.mark.parametrize("params", [{}, {"rate": RATE}])
def test_offline_vqf_gives_what_the_package_gives(data, params):
    imu, mag = data
    columns = imu.angular_velocity, imu.linear_acceleration, mag.magnetic_field
    direct = vqf.offlineVQF(*columns, 1 / RATE, {"tauMag": 15.0})["quat9D"]
    found = estimates("offline_vqf", imu, mag, tau_mag=15.0, **params)
    assert found.t.tolist() == imu.t.tolist()
    np.testing.assert_allclose(found.quaternion, np.roll(direct, -1, 1), atol=1e-9)
    assert not len(estimates("offline_vqf", imu[:1], mag[:1]))


def test_imufusion_gives_what_the_package_gives(data):
    imu, mag = data
    settings = imufusion.AhrsSettings()
    settings.convention, settings.gain = imufusion.CONVENTION_ENU, 0.7
    ahrs, expected = imufusion.Ahrs().set_settings(settings), []
    ahrs = ahrs or imufusion.Ahrs()
    for k in range(len(imu)):
        ahrs.update(
            np.degrees(imu.angular_velocity[k]),
            imu.linear_acceleration[k] / lf.STANDARD_GRAVITY,
            mag.magnetic_field[k] * 1e6,
        )
        expected.append(np.roll(ahrs.get_quaternion(), -1))
    found = estimates(
        "imufusion", imu, mag, rate=RATE, gain=0.7, bias=False,
        acceleration_rejection=None, magnetic_rejection=None,
    )  # fmt: skip
    np.testing.assert_array_equal(found.quaternion, np.array(expected, np.float64))


def test_madgwick_and_mahony_give_what_the_package_gives(data):
    imu, mag = data
    for name, package in (
        ("ahrs_madgwick", ahrs_filters.Madgwick(gain=0.041)),
        ("ahrs_mahony", ahrs_filters.Mahony(k_P=1.0, k_I=0.3)),
    ):
        found = estimates(name, imu[:50], mag[:50])
        # From its first estimate on, in the frame of the package: Madgwick's is NWU.
        turn = 0.0 if name == "ahrs_mahony" else -np.pi / 2
        q = _times(np.array([np.cos(turn / 2), 0, 0, np.sin(turn / 2)]), _first(found, 0))
        for k in range(1, 50):
            q = np.array(
                package.updateMARG(
                    q, imu.angular_velocity[k], imu.linear_acceleration[k],
                    mag.magnetic_field[k] * 1e9, dt=1 / RATE,
                )
            )  # fmt: skip
        back = _times(np.array([np.cos(turn / 2), 0, 0, -np.sin(turn / 2)]), q)
        np.testing.assert_allclose(_first(found, -1), back, atol=1e-12)


def _first(found, at):
    return np.roll(found.quaternion[at], 1)


def _times(p, q):
    w, x, y, z = p
    return np.array(
        [[w, -x, -y, -z], [x, w, -z, y], [y, z, w, -x], [z, -y, x, w]]
    ) @ q  # fmt: skip


@pytest.mark.parametrize(
    "name", ["vqf", "offline_vqf", "imufusion", "ahrs_madgwick", "ahrs_mahony"]
)
def test_our_frames(name):
    """Level and at rest, with the body's x axis to magnetic north: a quarter turn from east."""
    count = 2000
    t = np.arange(count) * 10_000_000
    imu = lf.Imu(t, np.full((count, 3), 1e-6), np.tile([0.0, 0.0, 9.81], (count, 1)))
    mag = lf.MagneticField(t, np.tile([20e-6, 0.0, -40e-6], (count, 1)))
    last = estimates(name, imu, mag).quaternion[-1]
    half = np.sqrt(0.5)
    np.testing.assert_allclose(np.abs(last @ [0, 0, half, half]), 1.0, atol=1e-4)


@pytest.fixture(scope="module")
def ride(tmp_path_factory):
    """A recording of the simulated vehicle."""
    path = tmp_path_factory.mktemp("ride") / "ride.mcap"
    graph = load_graph(GRAPHS / "heading.yaml", args=["duration=10"])
    assert run(graph, record=str(path)).exit_code == 0
    return path


@pytest.mark.parametrize(
    ("name", "limit"), [("vqf", 1.5), ("ahrs_madgwick", 4.0), ("ahrs_mahony", 4.0)]
)
def test_in_the_place_of_the_kalman_filter_on_simulated_data(ride, name, limit):
    graph = load_graph(
        GRAPHS / "broad.yaml",
        args=[f"recording={ride}"],
        sets=[f"sensors.{port}=/vehicle/{port}" for port in ("imu", "mag", "truth")],
        swaps=[f"fuser={name}"],
    )
    summary = run(graph, record="")
    assert summary.exit_code == 0, summary.error
    score = summary.scores["score"]
    assert score.missing == 0
    assert np.degrees(score.total_rmse) < limit


# Total, heading and inclination RMSE of VQF in degrees, as measured outside of lodeflow.
PUBLISHED = {
    "02_undisturbed_slow_rotation_B": (1.38, 1.31, 0.43),
    "18_undisturbed_fast_translation_with_breaks_B": (0.81, 0.53, 0.61),
    "25_disturbed_tapping_B": (1.62, 1.57, 0.38),
    "27_disturbed_phone_vibration_B": (6.73, 6.72, 0.37),
    "31_disturbed_stationary_magnet_D": (3.21, 3.00, 1.14),
    "34_disturbed_attached_magnet_3cm": (3.35, 3.29, 0.65),
}


@broad_figures.needs_data
@pytest.mark.parametrize("trial", PUBLISHED)
def test_vqf_on_broad(trial):
    graph = load_graph(
        GRAPHS / "broad.yaml",
        args=[f"recording={broad_figures.path_of(trial)}"],
        swaps=["sensors=broad_trial", "fuser=vqf"],
    )
    summary = run(graph, record="")
    assert summary.exit_code == 0, summary.error
    score = summary.scores["score"]
    found = np.degrees([score.total_rmse, score.heading_rmse, score.inclination_rmse])
    np.testing.assert_allclose(found, PUBLISHED[trial], atol=0.0051)


def test_without_the_package_it_is_told_what_to_do(monkeypatch):
    monkeypatch.setitem(sys.modules, "vqf", None)
    monkeypatch.delitem(sys.modules, "lodeflow_plugins.fusion.peers.vqf", raising=False)
    with pytest.raises(lf.NodeError) as caught:
        registry().load("vqf")
    assert str(caught.value) == (
        "this plugin wraps the package vqf, which cannot be imported (import of vqf halted; None "
        "in sys.modules); install lodeflow with its extra: pip install 'lodeflow[peers]'"
    )
