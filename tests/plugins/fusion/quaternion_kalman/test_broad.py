"""The filter on six trials of BROAD (Laidig et al. 2021), with and without an acceleration gate.

LODEFLOW_DATA names the folder that holds broad/.
"""

import os
from pathlib import Path

import numpy as np
import pytest
import scipy.io

from lodeflow_plugins.fusion.quaternion_kalman import filter as kalman
from lodeflow_plugins.fusion.quaternion_kalman.fuse import fuse
from lodeflow_plugins.scoring.attitude_score import metric

DATA = os.environ.get("LODEFLOW_DATA")
pytestmark = pytest.mark.skipif(
    DATA is None, reason="LODEFLOW_DATA does not name a folder with broad/"
)

# Measurement to gyro noise of 3 s, a time constant of 6 s; only the ratio counts. The first
# estimate is one measurement, so its variance is that of a measurement.
GYRO_NOISE = 0.01
VARIANCE = (3.0 * GYRO_NOISE) ** 2

# Total, heading and inclination RMSE in degrees, without the gate and with it at 0.5 m/s^2.
EXPECTED = {
    "02_undisturbed_slow_rotation_B": ((2.34, 1.63, 1.67), (2.55, 1.63, 1.96)),
    "18_undisturbed_fast_translation_with_breaks_B": ((34.46, 13.81, 31.69), (9.76, 4.01, 8.90)),
    "25_disturbed_tapping_B": ((6.09, 3.65, 4.88), (10.76, 6.87, 8.28)),
    "27_disturbed_phone_vibration_B": ((12.09, 3.81, 11.47), (18.93, 6.25, 17.88)),
    "31_disturbed_stationary_magnet_D": ((18.44, 4.32, 17.93), (7.69, 3.02, 7.07)),
    "34_disturbed_attached_magnet_3cm": ((7.27, 6.86, 2.42), (5.58, 5.29, 1.78)),
}


@pytest.mark.parametrize("tolerance", [np.inf, 0.5], ids=["free", "gated"])
@pytest.mark.parametrize("trial", EXPECTED)
def test_trial(trial, tolerance):
    data = scipy.io.loadmat(Path(DATA) / "broad" / f"{trial}.mat")
    force = np.ascontiguousarray(data["imu_acc"])
    seconds = np.arange(len(force)) / float(data["sampling_rate"].item())
    first, estimate = fuse(
        np.round(seconds * 1e9).astype(np.int64),
        np.ascontiguousarray(data["imu_gyr"]),
        force,
        np.ascontiguousarray(data["imu_mag"]),
        np.arange(len(force)),
        9.81,
        tolerance,
        kalman.constants(GYRO_NOISE, VARIANCE, VARIANCE),
        kalman.new_state(),
    )
    assert first == 0

    truth = np.ascontiguousarray(data["opt_quat"][:, [1, 2, 3, 0]])  # scalar last
    state = metric.new_state()
    metric.accumulate(estimate, truth, data["movement"].ravel(), state)
    score = metric.score(state)
    figures = np.degrees([score.total_rmse, score.heading_rmse, score.inclination_rmse])
    np.testing.assert_allclose(figures, EXPECTED[trial][tolerance == 0.5], atol=0.02)
