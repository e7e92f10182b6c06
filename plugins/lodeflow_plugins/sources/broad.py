"""Trials of BROAD, the benchmark of Laidig et al. 2021.

Source: Laidig, Caruso, Cereatti, Seel 2021, BROAD - A Benchmark for Robust Inertial Orientation
Estimation, Data 6(7):72, doi 10.3390/data6070072.
"""

from collections.abc import Iterator
from typing import Any, ClassVar, NamedTuple

import numpy as np
import scipy.io

import lodeflow as lf

WIDTHS = {"imu_gyr": 3, "imu_acc": 3, "imu_mag": 3, "opt_quat": 4, "movement": 1}


class Ports(NamedTuple):
    """Ports of `BroadTrial`."""

    imu: lf.Imu
    mag: lf.MagneticField
    truth: lf.AttitudeTruth


class BroadTrial(lf.Source):
    """One trial of BROAD: IMU, magnetometer and optical truth, from its .mat file.

    All in the sensor's own axes, which are the body frame here; the truth is magnetic
    ENU <- body, NaN where the optics lost it, with moving = 1 in the part that is scored. The
    file has no time stamps; t counts from the start of the run at the file's sampling rate.

    Source: Laidig et al. 2021, Data 6(7):72.
    """

    rows: ClassVar[int] = 1000
    """Rows of a block."""

    class Params(lf.Params):
        """Which trial."""

        file: str
        """Path of the trial, such as 02_undisturbed_slow_rotation_B.mat."""

    def read(self, clock: lf.Clock) -> Iterator[Ports]:
        data = _load(self.params.file)
        count = len(data["movement"])
        t = clock.start + np.rint(np.arange(count) * 1e9 / data["rate"]).astype(np.int64)
        quaternion = np.roll(data["opt_quat"], -1, axis=1)  # the file has w first
        for first in range(0, count, self.rows):
            part = slice(first, first + self.rows)
            yield Ports(
                lf.Imu(t[part], data["imu_gyr"][part], data["imu_acc"][part]),
                lf.MagneticField(t[part], data["imu_mag"][part] * 1e-6),
                lf.AttitudeTruth(t[part], quaternion[part], data["movement"][part]),
            )


def _load(file: str) -> dict[str, Any]:
    """The columns that are needed. Raises ValueError for a file that is no trial of BROAD."""
    try:
        found = scipy.io.loadmat(file, variable_names=[*WIDTHS, "sampling_rate"])
    except Exception as error:  # scipy raises whatever its parser stumbles over
        raise ValueError(f"{file}: cannot be read as a MATLAB file: {error}") from None
    missing = [name for name in (*WIDTHS, "sampling_rate") if name not in found]
    if missing:
        raise ValueError(f"{file} is no trial of BROAD: it has no {', '.join(missing)}")
    count = len(found["movement"])
    for name, width in WIDTHS.items():
        if found[name].shape != (count, width):
            raise ValueError(
                f"{file}: {name} has the shape {found[name].shape}, not {(count, width)}"
            )
    rate = found["sampling_rate"]
    if rate.size != 1 or rate.dtype.kind not in "iuf" or not 0 < rate.item() < np.inf:
        raise ValueError(f"{file}: sampling_rate should be one number above 0, not {rate.tolist()}")
    data = {name: np.ascontiguousarray(found[name], float) for name in WIDTHS}
    data["movement"] = found["movement"].ravel().astype(np.int64)
    return {**data, "rate": float(rate.item())}
