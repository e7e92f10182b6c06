"""The claim of Chu et al. 2017: calibrated by error separation, heading is good to 0.4 degrees.

A platform is read with 0.05 degrees of uncertainty about each axis, both while calibrating in 96
attitudes and while judging in 36 headings per tilt. A reading is the mean of 9 samples with 2 LSB
of noise (magnetometer), or of 100 samples with 10 LSB (accelerometer).
"""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from lodeflow_plugins.calibration import chu2017, least_squares
from lodeflow_plugins.fusion.tilt_compass import compass

DIP = np.radians(48.0)
EARTH_FIELD = np.array([np.cos(DIP), 0.0, np.sin(DIP)])
CALIBRATION = np.radians(
    [
        [heading, pitch, roll]
        for heading in range(0, 360, 30)
        for pitch in (-60, -20, 20, 60)
        for roll in (-40, 40)
    ]
)
SIGNS = ((1, 1), (1, -1), (-1, 1), (-1, -1))


def heading_errors(seed, reading_error, tilts):
    """Greatest heading error in degrees at each (pitch, roll), calibrated once."""
    rng = np.random.default_rng(seed)

    def magnetometer_reads(attitude):
        noise = rng.normal(0.0, 2.0, (9, len(attitude), 3)).mean(axis=0)
        return chu2017.MAGNETOMETER(attitude.inv().apply(EARTH_FIELD)) + noise

    def accelerometer_reads(specific_force):
        noise = rng.normal(0.0, 10.0, (100, len(specific_force), 3)).mean(axis=0)
        return chu2017.ACCELEROMETER.inverse()(specific_force) + noise

    def true_attitude(read):
        error = rng.normal(0.0, np.radians(reading_error), (len(read), 3))
        return read * Rotation.from_rotvec(error)

    read = Rotation.from_euler("ZYX", CALIBRATION)
    magnetometer = least_squares.magnetometer(
        magnetometer_reads(true_attitude(read)), read.inv().apply(EARTH_FIELD)
    ).model.inverse()
    accelerometer = least_squares.accelerometer(
        accelerometer_reads(chu2017.SIX_POSITIONS), chu2017.SIX_POSITIONS
    ).model

    worst = []
    for tilt in tilts:
        euler = np.array([[heading, *tilt] for heading in range(0, 360, 10)], dtype=float)
        true = true_attitude(Rotation.from_euler("ZYX", euler, degrees=True))
        up = compass.swap_body(true.inv().apply([0.0, 0.0, -1.0]))
        angles, _ = compass.measure(
            accelerometer(accelerometer_reads(up)),
            compass.swap_body(magnetometer(magnetometer_reads(true))),
        )
        error = np.degrees(angles[:, 0]) - euler[:, 0]
        worst.append(np.abs((error + 180.0) % 360.0 - 180.0).max())
    return worst


@pytest.mark.parametrize("seed", range(10))
def test_heading_is_good_to_0_4_degrees_up_to_60_degrees_of_tilt(seed):
    tilts = [(0, 0), *[(a * p, a * r) for a in (30, 60) for p, r in SIGNS]]
    assert max(heading_errors(seed, 0.05, tilts)) <= 0.4


def test_the_error_grows_with_tilt_as_tabled():
    tilts = [(0, 0), (30, 30), (60, 60)]
    mean = np.mean([heading_errors(seed, 0.05, tilts) for seed in range(40)], axis=0)
    np.testing.assert_allclose(mean, [0.146, 0.169, 0.267], rtol=0.1)


def test_the_platform_is_what_limits_it():
    level = [(0, 0)]
    assert np.mean([heading_errors(s, 0.0, level) for s in range(20)]) < 0.1
    assert np.mean([heading_errors(s, 0.2, level) for s in range(20)]) > 0.4
