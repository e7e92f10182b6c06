"""Error models and constants against the golden numbers of Chu et al. 2017, section 3."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from lodeflow_plugins.calibration import chu2017, error_models
from lodeflow_plugins.fusion.tilt_compass import compass

DIP = np.radians(48.0)
ATTITUDE = Rotation.from_euler("ZYX", [30.0, 20.0, -10.0], degrees=True)
FIELD = ATTITUDE.inv().apply([np.cos(DIP), 0.0, np.sin(DIP)])  # FRD, of strength 1


def test_table_1_as_printed_is_not_made_of_unit_vectors():
    squared = np.sum(np.cos(np.radians(chu2017.TABLE_1_AS_PRINTED)) ** 2, axis=1)
    assert squared.round(5).tolist() == [1.00011, 1.0, 0.99755]
    with pytest.raises(ValueError, match="unit vectors"):
        error_models.magnetometer(
            chu2017.MAGNETOMETER_SENSITIVITY,
            np.cos(np.radians(chu2017.TABLE_1_AS_PRINTED)),
            chu2017.MAGNETOMETER_BIAS,
        )


def test_table_1_is_corrected_in_two_places():
    changed = chu2017.TABLE_1 != chu2017.TABLE_1_AS_PRINTED
    assert np.argwhere(changed).tolist() == [[0, 0], [2, 1]]
    assert chu2017.TABLE_1[0, 0] == pytest.approx(0.60495, abs=5e-6)
    assert chu2017.TABLE_1[2, 1] == pytest.approx(87.0451, abs=5e-5)
    m = chu2017.MAGNETOMETER_MISALIGNMENT
    np.testing.assert_allclose(np.linalg.norm(m, axis=1), 1.0, atol=1e-8)
    between = np.degrees(np.arccos([m[2] @ m[0], m[2] @ m[1]]))
    np.testing.assert_allclose(between, [90.23, 88.58], atol=5e-3)


@pytest.mark.parametrize(("place", "angle"), [((2, 1), 92.9549), ((2, 0), 87.0451)])
def test_another_choice_of_the_z_row_costs_degrees_of_heading_when_tilted(place, angle):
    table = chu2017.TABLE_1_AS_PRINTED.copy()
    table[0, 0] = chu2017.TABLE_1[0, 0]
    table[place] = angle
    wrong = error_models.magnetometer(
        chu2017.MAGNETOMETER_SENSITIVITY,
        np.cos(np.radians(table)),
        chu2017.MAGNETOMETER_BIAS,
    )
    worst = []
    for tilt in (0.0, 30.0, 60.0):
        euler = [[heading, tilt, tilt] for heading in range(0, 360, 10)]
        attitude = Rotation.from_euler("ZYX", euler, degrees=True)
        raw = chu2017.MAGNETOMETER(attitude.inv().apply([np.cos(DIP), 0.0, np.sin(DIP)]))
        up = attitude.inv().apply([0.0, 0.0, -1.0])
        angles, _ = compass.measure(compass.swap_body(up), compass.swap_body(wrong.inverse()(raw)))
        error = np.degrees(angles[:, 0]) - np.arange(0, 360, 10)
        worst.append(np.abs((error + 180.0) % 360.0 - 180.0).max())
    assert worst[0] < 0.2
    assert worst[1] > 2.0
    assert worst[2] > 4.0


def test_magnetometer_golden():
    raw = chu2017.MAGNETOMETER(FIELD)
    np.testing.assert_allclose(raw, [582.60845, -975.8843049, 1180.4662998], atol=5e-8)
    np.testing.assert_allclose(chu2017.MAGNETOMETER.inverse()(raw), FIELD, atol=1e-15)


def test_accelerometer_golden():
    raw = chu2017.ACCELEROMETER.inverse()(chu2017.SIX_POSITIONS)
    golden = [
        [-36.2697, 104.0041, 5580.2297],
        [-136.0936, 145.1300, -5522.6253],
        [-136.4276, -5431.9773, 17.4656],
        [-35.9357, 5681.1113, 40.1389],
        [5554.0114, 240.9418, -83.6805],
        [-5726.3747, 8.1923, 141.2850],
    ]
    np.testing.assert_allclose(raw, golden, atol=5.1e-5)
    np.testing.assert_allclose(
        chu2017.ACCELEROMETER.inverse().offset, [-86.18, 124.57, 28.80], atol=5e-3
    )
    sensitivity = 1.0 / np.linalg.norm(chu2017.ACCELEROMETER_GAIN, axis=0)
    np.testing.assert_allclose(sensitivity, [5637.8, 5555.3, 5552.2], atol=5e-2)


def test_gyroscope_golden():
    raw = chu2017.GYROSCOPE.inverse()(30.0 * np.eye(3))
    golden = [
        [-260.4818, -22.0872, -10.2358],
        [-18.5702, 222.9392, -14.8791],
        [-19.9152, -19.8073, -257.8508],
    ]
    np.testing.assert_allclose(raw, golden, atol=5e-5)
    np.testing.assert_allclose(
        chu2017.GYROSCOPE.inverse().offset, [-19.272, -19.571, -16.678], atol=5e-4
    )
    # One scale for each axis; Eq. 12 prints the first three times.
    scale = np.linalg.norm(chu2017.GYROSCOPE_K[:3], axis=1)
    np.testing.assert_allclose(scale, [0.12442, 0.12372, 0.12438], atol=6e-6)
    rate = raw[0] @ chu2017.GYROSCOPE_K[:3] + chu2017.GYROSCOPE_K[3]
    np.testing.assert_allclose(rate, [30.0, 0.0, 0.0], atol=1e-12)


def test_table_2_is_the_specific_force_in_forward_left_up():
    # Attitudes NED <- FRD with z, -z, y, -y, x and -x down.
    attitudes = Rotation.from_euler(
        "ZYX",
        [[0, 0, 0], [0, 0, 180], [0, 0, 90], [0, 0, -90], [0, -90, 0], [0, 90, 0]],
        degrees=True,
    )
    up = attitudes.inv().apply([0.0, 0.0, -1.0])
    np.testing.assert_allclose(compass.swap_body(up), chu2017.SIX_POSITIONS, atol=1e-15)


@pytest.mark.parametrize(
    "model", [chu2017.MAGNETOMETER, chu2017.ACCELEROMETER.inverse(), chu2017.GYROSCOPE.inverse()]
)
def test_inverse_leads_back_for_any_leading_shape(model):
    vectors = np.random.default_rng(1).uniform(-1.0, 1.0, (4, 5, 3))
    raw = model(vectors)
    assert raw.shape == (4, 5, 3)
    np.testing.assert_allclose(model.inverse()(raw), vectors, atol=1e-13)
    assert model(vectors[2, 3]).tobytes() == raw[2, 3].tobytes()


@settings(deadline=None)
@given(st.lists(st.integers(0, 50), max_size=5).map(sorted), st.integers(0, 99))
def test_any_split_into_blocks_gives_the_same_bytes(cuts, seed):
    vectors = np.random.default_rng(seed).standard_normal((50, 3))
    for model in (chu2017.MAGNETOMETER, chu2017.ACCELEROMETER, chu2017.GYROSCOPE):
        pieces = [model(piece) for piece in np.split(vectors, cuts)]
        assert np.concatenate(pieces).tobytes() == model(vectors).tobytes()


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: error_models.gyroscope(np.eye(3)), r"k has to have the shape \(4, 3\)"),
        (lambda: error_models.accelerometer(np.eye(3), [0, 0]), "offset has to have the shape"),
        (lambda: error_models.accelerometer(np.full((3, 3), np.nan), [0, 0, 0]), "gain .* finite"),
        (lambda: error_models.magnetometer([1, 0, 1], np.eye(3), [0, 0, 0]), "sensitivity"),
        (
            lambda: error_models.accelerometer(np.zeros((3, 3)), [0, 0, 0]).inverse(),
            "invertible",
        ),
    ],
)
def test_mistakes_are_named(make, message):
    with pytest.raises(ValueError, match=message):
        make()
