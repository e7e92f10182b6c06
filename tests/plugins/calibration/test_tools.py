"""The kinds of `lodeflow calibrate` on simulated recordings: golden sensors found, refusals."""

import matplotlib as mpl
import numpy as np
import pytest
from matplotlib.figure import Figure
from scipy.spatial.transform import Rotation

import lodeflow as lf
from lodeflow.clock import SimClock
from lodeflow_plugins.calibration import chu2017
from lodeflow_plugins.calibration.node import AccelCalibrator, GyroCalibrator, MagCalibrator
from lodeflow_plugins.calibration.tools.accel import Accel
from lodeflow_plugins.calibration.tools.allan import Allan
from lodeflow_plugins.calibration.tools.gyro import Gyro, GyroBias
from lodeflow_plugins.calibration.tools.iron import Iron
from lodeflow_plugins.calibration.tools.mag import Mag
from lodeflow_plugins.sources.simulated_platform.node import SimulatedPlatform

mpl.use("Agg")
TO_FLU = np.array([1.0, -1.0, -1.0])
CHIP = {"mounting": ["-x", "-y", "z"]}  # the paper's accelerometer


def platform(programme, **params):
    source = SimulatedPlatform(SimulatedPlatform.Params(programme=programme, **params))
    source.start()
    blocks = list(source.read(SimClock()))
    return {
        name: type(getattr(blocks[0], name)).concat([getattr(block, name) for block in blocks])
        for name in blocks[0]._fields
    }


def calibrated(tool, params=None, **streams):
    """Run a tool; its figure draws, and its parameters are those of its plugin."""
    found = tool(tool.Params(**params or {}), name="tool").calibrate(**streams)
    figure = Figure()
    found.draw(figure)
    assert figure.axes
    return found


def quantity(found, name):
    (value,) = [q for q in found.quantities if q.name == name]
    return value


@pytest.fixture(scope="module")
def attitudes():
    return platform("attitudes", rest=1.5, move=0.5)


@pytest.fixture(scope="module")
def tumble():
    return platform("tumble", duration=200)


def sensor_is_found(params, bias, direction, sensitivity):
    """Compare with the paper's magnetometer: LSB, degrees, part of the sensitivity."""
    MagCalibrator.Params(**params)
    assert np.abs(params["bias"] - chu2017.MAGNETOMETER_BIAS).max() < bias
    true = chu2017.MAGNETOMETER_MISALIGNMENT * TO_FLU
    off = np.arccos(np.sum(params["misalignment"] * true, axis=1).clip(-1, 1))
    assert np.degrees(off).max() < direction
    np.testing.assert_allclose(
        params["sensitivity"], chu2017.MAGNETOMETER_SENSITIVITY, rtol=sensitivity
    )


@pytest.mark.parametrize("dip", [None, "48 deg"])
def test_mag_on_a_platform_separates_the_errors(attitudes, dip):
    found = calibrated(Mag, {"dip": dip}, raw=attitudes["raw_mag"], attitude=attitudes["attitude"])
    assert found.plugin == "mag_calibrator"
    sensor_is_found(found.params, bias=0.2, direction=0.01, sensitivity=2e-4)
    assert quantity(found, "positions").value == 96
    assert quantity(found, "dip").value == pytest.approx(48.0, abs=0.005)
    assert quantity(found, "residual rms").value.max() < 0.5
    assert any("strength of the field is not observable" in note for note in found.notes)


def test_mag_without_a_platform_fits_an_ellipsoid_and_aligns_it(tumble):
    force = chu2017.ACCELEROMETER(tumble["raw_force"].counts) * lf.STANDARD_GRAVITY
    up = lf.SpecificForce(tumble["raw_force"].t, force)
    found = calibrated(Mag, raw=tumble["raw_mag"], force=up)
    sensor_is_found(found.params, bias=0.5, direction=0.03, sensitivity=1e-3)
    assert quantity(found, "dip").value == pytest.approx(48.0, abs=0.02)
    alone = calibrated(Mag, raw=tumble["raw_mag"])
    assert any("a rotation common to all axes is not observable" in note for note in alone.notes)
    np.testing.assert_allclose(alone.params["bias"], found.params["bias"])
    symmetric = np.diag(alone.params["sensitivity"]) @ alone.params["misalignment"]
    np.testing.assert_allclose(symmetric, symmetric.T, rtol=1e-9)


def test_mag_refuses_what_does_not_tell(attitudes, tumble):
    few = attitudes["raw_mag"].t < 4 * 2_000_000_000
    raw = attitudes["raw_mag"][few]
    with pytest.raises(lf.CalibrationError, match=r"4 positions; at least 10 .* record 20 or more"):
        calibrated(Mag, raw=raw, attitude=attitudes["attitude"][few])
    with pytest.raises(lf.CalibrationError, match=r"field varies .* found 4 positions"):
        calibrated(Mag, {"dip": 0.8}, raw=raw, attitude=attitudes["attitude"][few])
    with pytest.raises(lf.CalibrationError, match=r"open .* each pointing up and down"):
        calibrated(Mag, raw=tumble["raw_mag"][:800])
    with pytest.raises(lf.CalibrationError, match="nothing holds still for 100 samples"):
        calibrated(Mag, raw=tumble["raw_mag"], attitude=tumble["attitude"])


def test_mag_tells_which_position_contradicts_the_others(attitudes):
    counts = attitudes["raw_mag"].counts.copy()
    counts[2_010:2_140] += [150.0, 0.0, 0.0]  # iron came near in position 11
    raw = attitudes["raw_mag"].replace(counts=counts)
    with pytest.raises(lf.CalibrationError, match=r"contradict .* position 11 of 96, at 20\.\d s"):
        calibrated(Mag, raw=raw, attitude=attitudes["attitude"])


def test_an_ellipsoid_in_a_field_that_changes_is_refused(tumble):
    counts = tumble["raw_mag"].counts.copy()
    counts[8_000:16_000] *= 1.2
    with pytest.raises(lf.CalibrationError, match=r"contradict .* % off the ellipsoid"):
        calibrated(Mag, raw=tumble["raw_mag"].replace(counts=counts))


def test_iron_in_tesla(tumble):
    t = tumble["attitude"].t
    earth = 50e-6 * np.array([0.0, np.cos(0.8), -np.sin(0.8)])
    true = Rotation.from_quat(tumble["attitude"].quaternion).inv().apply(earth)
    soft = np.array([[1.05, 0.02, 0.01], [0.0, 0.97, -0.03], [0.02, 0.0, 1.01]])
    noise = np.random.default_rng(0).normal(0.0, 1e-7, true.shape)
    mag = lf.MagneticField(t, true @ soft.T + [4e-6, -9e-6, 2e-6] + noise)
    force = Rotation.from_quat(tumble["attitude"].quaternion).inv().apply([0, 0, 9.8])
    imu = lf.Imu(t, np.zeros_like(force), force)
    found = calibrated(Iron, {"field": "50 uT"}, mag=mag, imu=imu)
    assert found.plugin == "iron_calibrator"
    np.testing.assert_allclose(found.params["hard_iron"], [4e-6, -9e-6, 2e-6], atol=3e-8)
    np.testing.assert_allclose(found.params["soft_iron"], np.linalg.inv(soft), atol=1e-3)
    # How far it is turned is within what it says itself: no reading is taken for its noise.
    left = found.params["soft_iron"] @ soft
    turned = np.degrees([left[2, 1] - left[1, 2], left[0, 2] - left[2, 0], left[1, 0] - left[0, 1]])
    error = quantity(found, "alignment, standard error about x y z").value
    assert (np.abs(turned) / 2 < 4 * error).all()
    alone = calibrated(Iron, mag=mag)
    assert np.linalg.det(alone.params["soft_iron"]) == pytest.approx(1.0)


@pytest.fixture(scope="module")
def faces():
    return platform("six_positions")


def test_accel_finds_six_positions_in_any_order(faces):
    for order in (range(6), (3, 0, 5, 1, 4, 2)):
        counts = np.concatenate([faces["raw_force"].counts[k * 300 :][:300] for k in order])
        raw = faces["raw_force"].replace(counts=counts)
        found = calibrated(Accel, CHIP, raw=raw)
        assert found.plugin == "accel_calibrator"
        AccelCalibrator.Params(**found.params)
        np.testing.assert_allclose(found.params["gain"], chu2017.ACCELEROMETER_GAIN, atol=1.5e-7)
        np.testing.assert_allclose(found.params["offset"], chu2017.ACCELEROMETER_OFFSET, atol=5e-4)
        assert quantity(found, "positions").value == 6


def test_accel_takes_the_attitudes_of_a_platform(attitudes):
    found = calibrated(Accel, raw=attitudes["raw_force"], attitude=attitudes["attitude"])
    np.testing.assert_allclose(found.params["gain"], chu2017.ACCELEROMETER_GAIN, atol=1e-7)
    assert quantity(found, "positions").value == 96


def test_accel_refuses_what_does_not_tell(faces, attitudes):
    with pytest.raises(lf.CalibrationError, match="no rest of 100 samples with x up, x down"):
        calibrated(Accel, CHIP, raw=faces["raw_force"][:1_100])
    with pytest.raises(lf.CalibrationError, match="nothing holds still"):
        calibrated(Accel, CHIP, raw=faces["raw_force"][:50])
    with pytest.raises(lf.CalibrationError, match=r"degrees from the nearest face"):
        calibrated(Accel, CHIP, raw=attitudes["raw_force"])
    counts = faces["raw_force"].counts.copy()
    counts[:300] *= 1.15
    with pytest.raises(lf.CalibrationError, match=r"contradict .* g off the fit"):
        calibrated(Accel, CHIP, raw=faces["raw_force"].replace(counts=counts))
    with pytest.raises(ValueError, match="name each of x, y and z once"):
        Accel.Params(mounting=["x", "-x", "z"])


def test_gyro_on_a_turntable_finds_eq_17():
    rates = platform("rates", gyro_noise="0.05 deg/s")
    found = calibrated(Gyro, raw=rates["raw_rate"], rate=rates["rate"])
    assert found.plugin == "gyro_calibrator"
    GyroCalibrator.Params(**found.params)
    np.testing.assert_allclose(found.params["k"][:3], chu2017.GYROSCOPE_K[:3] * TO_FLU, atol=3e-5)
    np.testing.assert_allclose(found.params["k"][3], chu2017.GYROSCOPE_K[3] * TO_FLU, atol=5e-3)
    assert quantity(found, "steady rates").value == 18
    one = rates["rate"].t < 18_000_000_000
    with pytest.raises(lf.CalibrationError, match="about each of the three axes"):
        calibrated(Gyro, raw=rates["raw_rate"][one], rate=rates["rate"][one])
    backward = rates["rate"].replace(angular_rate=np.abs(rates["rate"].angular_rate))
    with pytest.raises(lf.CalibrationError, match="contradict"):
        calibrated(Gyro, raw=rates["raw_rate"], rate=backward)


def test_gyro_bias_at_rest_replaces_the_bias_of_the_gyro_file():
    rest = platform("rest", duration=60)
    found = calibrated(GyroBias, raw=rest["raw_rate"])
    zero = chu2017.GYROSCOPE.inverse().offset
    np.testing.assert_allclose(found.params["zero_rate"], zero, atol=0.1)
    (line,) = [q for q in found.quantities if q.name == "zero-rate output"]
    assert (np.abs(line.value - zero) < 5 * line.error).all()
    params = GyroCalibrator.Params(**{**GyroCalibrator.example, **found.params})
    node = GyroCalibrator(params, name="gyro")
    node.start()
    at_rest = node.step(lf.RawRate.of(0, counts=found.params["zero_rate"]))
    np.testing.assert_allclose(at_rest.angular_rate, 0.0, atol=1e-12)
    turning = platform("rates")
    with pytest.raises(lf.CalibrationError, match="look like rest differ"):
        calibrated(GyroBias, {"samples": 150}, raw=turning["raw_rate"])
    with pytest.raises(lf.CalibrationError, match="nothing lies still for 1000"):
        calibrated(GyroBias, raw=turning["raw_rate"])


def test_allan_finds_the_noise_and_the_walk_of_the_simulated_sensors():
    rest = platform("rest", duration=1200, gyro_walk=4e-5)
    found = calibrated(Allan, raw_rate=rest["raw_rate"])
    scale = np.radians(np.linalg.norm(chu2017.GYROSCOPE_K[:3], axis=1))  # rad/s per LSB
    white = quantity(found, "raw_rate: white noise N").value * scale
    np.testing.assert_allclose(white, np.radians(0.15) / 10.0, rtol=0.05)
    walk = quantity(found, "raw_rate: rate random walk K").value * scale
    assert np.nanmedian(walk) == pytest.approx(4e-5, rel=0.5)
    assert found.plugin == ""


def test_allan_refuses_gaps_and_nothing():
    rest = platform("rest", duration=10)["raw_rate"]
    t = rest.t.copy()
    t[500:] += 10**9
    with pytest.raises(lf.CalibrationError, match=r"1 gaps .* the first after 4\.990 s"):
        calibrated(Allan, raw_rate=rest.replace(t=t))
    with pytest.raises(lf.CalibrationError, match="no stream of a sensor"):
        calibrated(Allan)
    with pytest.raises(lf.CalibrationError, match="100 samples; at least 200"):
        calibrated(Allan, raw_rate=rest[:100])
