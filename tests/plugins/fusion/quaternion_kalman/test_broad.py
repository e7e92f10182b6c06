"""The filter on six trials of BROAD (Laidig et al. 2021), with and without an acceleration gate."""

import broad_figures
import numpy as np
import pytest
import scipy.io

import lodeflow as lf
from lodeflow_plugins.fusion.quaternion_kalman import filter as kalman
from lodeflow_plugins.fusion.quaternion_kalman.fuse import fuse
from lodeflow_plugins.scoring.attitude_score import metric

pytestmark = broad_figures.needs_data

# Measurement to gyro noise of 3 s, a time constant of 6 s; only the ratio counts. The first
# estimate is one measurement, so its variance is that of a measurement.
GYRO_NOISE = 0.01
VARIANCE = (3.0 * GYRO_NOISE) ** 2


@pytest.mark.parametrize("tolerance", [np.inf, 0.5], ids=["free", "gated"])
@pytest.mark.parametrize("trial", broad_figures.FIGURES)
def test_trial(trial, tolerance):
    data = scipy.io.loadmat(broad_figures.path_of(trial))
    force = np.ascontiguousarray(data["imu_acc"])
    seconds = np.arange(len(force)) / float(data["sampling_rate"].item())
    first, estimate = fuse(
        np.round(seconds * 1e9).astype(np.int64),
        np.ascontiguousarray(data["imu_gyr"]),
        force,
        np.ascontiguousarray(data["imu_mag"]),
        np.arange(len(force)),
        lf.STANDARD_GRAVITY,
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
    expected = broad_figures.FIGURES[trial][tolerance == 0.5]
    np.testing.assert_allclose(figures, expected, atol=0.01)
