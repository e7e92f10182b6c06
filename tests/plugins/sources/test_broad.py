"""Reading trials of BROAD."""

import numpy as np
import pytest
import scipy.io

from lodeflow.clock import SimClock
from lodeflow_plugins.sources.broad import BroadTrial

ROWS = 2500
RATE = 2000 / 7


@pytest.fixture
def trial():
    rng = np.random.default_rng(0)
    quaternion = rng.standard_normal((ROWS, 4))
    quaternion[100:200] = np.nan
    return {
        "imu_gyr": rng.standard_normal((ROWS, 3)),
        "imu_acc": rng.standard_normal((ROWS, 3)),
        "imu_mag": rng.standard_normal((ROWS, 3)),
        "opt_quat": quaternion,
        "movement": (np.arange(ROWS)[:, None] > 300).astype(np.uint8),
        "sampling_rate": RATE,
    }


def read(path, data):
    scipy.io.savemat(path, data)
    return list(BroadTrial(BroadTrial.Params(file=str(path))).read(SimClock()))


def test_columns_units_and_stamps(tmp_path, trial):
    parts = read(tmp_path / "trial.mat", trial)
    assert len(parts) > 1
    imu, mag, truth = (type(blocks[0]).concat(blocks) for blocks in zip(*parts, strict=True))
    for block in (imu, mag, truth):
        block.validate()
        assert block.t.tolist() == [round(i * 1e9 / RATE) for i in range(ROWS)]
    assert np.array_equal(imu.angular_velocity, trial["imu_gyr"])
    assert np.array_equal(imu.linear_acceleration, trial["imu_acc"])
    np.testing.assert_allclose(mag.magnetic_field, trial["imu_mag"] * 1e-6, rtol=1e-15)
    expected = trial["opt_quat"][:, [1, 2, 3, 0]]
    assert np.array_equal(truth.quaternion, expected, equal_nan=True)
    assert truth.moving.tolist() == trial["movement"].ravel().tolist()


def test_a_file_that_is_no_trial_is_refused(tmp_path, trial):
    del trial["opt_quat"]
    with pytest.raises(ValueError, match=r"trial\.mat is no trial of BROAD: it has no opt_quat"):
        read(tmp_path / "trial.mat", trial)
    short = {**trial, "opt_quat": np.zeros((7, 4))}
    with pytest.raises(ValueError, match=r"opt_quat has the shape \(7, 4\), not \(2500, 4\)"):
        read(tmp_path / "short.mat", short)
    text = tmp_path / "text.mat"
    text.write_text("this is no MATLAB file, although it is longer than its header\n" * 9)
    with pytest.raises(ValueError, match=r"text\.mat: cannot be read as a MATLAB file"):
        list(BroadTrial(BroadTrial.Params(file=str(text))).read(SimClock()))


@pytest.mark.parametrize("rate", [0.0, -1.0, np.nan, np.inf, "fast", [100.0, 200.0], []])
def test_a_sampling_rate_that_makes_no_stamps_is_refused(tmp_path, trial, rate):
    with pytest.raises(ValueError, match=r"trial\.mat: sampling_rate should be one number above 0"):
        read(tmp_path / "trial.mat", {**trial, "sampling_rate": rate})
