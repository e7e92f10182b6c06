"""Reading walks with a sensor on the foot."""

import numpy as np
import pytest

import lodeflow as lf
from lodeflow.clock import SimClock
from lodeflow_plugins.sources.foot_trial import FootTrial

ROWS = 2500


@pytest.fixture
def walk():
    rng = np.random.default_rng(0)
    return {
        "t": 7.0 + np.arange(ROWS) / 200 + 1e-3 * rng.random(ROWS) * (np.arange(ROWS) % 2499 > 0),
        "imu": rng.standard_normal((ROWS, 6)).astype(np.float32),
        "stride_index": np.array([100, 999, 1000, 2400], np.int32),
        "vicon_xy": rng.standard_normal((ROWS, 2)).astype(np.float32),
    }


def read(path, data, **params):
    np.savez(path, **data)
    return list(FootTrial(FootTrial.Params(file=str(path), **params)).read(SimClock()))


def test_columns_and_axes(tmp_path, walk):
    parts = read(tmp_path / "walk.npz", walk)
    assert len(parts) > 1
    imu, truth, position = (type(b[0]).concat(b) for b in zip(*parts, strict=True))
    for block in (imu, truth, position):
        block.validate()
    flip = [1, -1, -1]
    assert np.array_equal(imu.linear_acceleration, walk["imu"][:, :3].astype(float) * flip)
    assert np.array_equal(imu.angular_velocity, walk["imu"][:, 3:].astype(float) * flip)
    assert np.array_equal(position.position[:, :2], walk["vicon_xy"].astype(float) * [1, -1])
    assert np.isnan(position.position[:, 2]).all()
    # The stamps are even, whatever the jitter, and span what the file spans.
    assert set(np.diff(imu.t)) <= {5_000_000, 4_999_999, 5_000_001}
    assert imu.t[0] == 0
    assert truth.t.tolist() == imu.t[walk["stride_index"]].tolist()
    assert truth.count.tolist() == [0, 1, 2, 3]


def test_other_axes_and_less_truth(tmp_path, walk):
    del walk["stride_index"], walk["vicon_xy"]
    walk["strides_hand"] = np.array(16)
    parts = read(tmp_path / "walk.npz", walk, body_axes="flu")
    assert all(part.position is None for part in parts)
    assert np.array_equal(parts[0].imu.linear_acceleration, walk["imu"][:1000, :3].astype(float))
    truth = lf.StepTruth.concat([part.truth for part in parts])
    assert truth.count.tolist() == [0, 16]


@pytest.mark.parametrize(
    ("change", "problem"),
    [
        ({"imu": None, "stride_index": None}, "has no imu, stride_index or strides_hand"),
        ({"imu": np.zeros((3, 6))}, r"imu has the shape \(3, 6\), not \(2500, 6\)"),
        ({"vicon_xy": np.zeros(9)}, r"vicon_xy has the shape"),
        ({"stride_index": np.array([5, 4])}, "samples that follow each other"),
        ({"stride_index": np.array([-1, 4])}, "samples that follow each other"),
        ({"stride_index": np.array([5, 2500])}, "names sample 2500 of 2500"),
        ({"t": np.zeros(ROWS)}, "the last after the first"),
        ({"t": np.full(ROWS, np.nan)}, "two or more times"),
    ],
)
def test_a_file_that_is_no_walk_is_refused(tmp_path, walk, change, problem):
    data = {name: value for name, value in (walk | change).items() if value is not None}
    with pytest.raises(ValueError, match=problem):
        read(tmp_path / "bad.npz", data)


def test_a_foreign_file_is_refused(tmp_path):
    path = tmp_path / "text.npz"
    path.write_text("no zip")
    with pytest.raises(ValueError, match=r"text\.npz: cannot be read as an \.npz file"):
        list(FootTrial(FootTrial.Params(file=str(path))).read(SimClock()))
