"""Count the steps of recorded walks and runs that are played slower or faster.

    LODEFLOW_DATA=FOLDER python benchmarks/gait_speed.py

Time is stretched, and with it the angular rate is divided by the stretch and the acceleration by
its square, in the geographic frame, as if the same way had been walked at another speed. Prints
the errors, summed over all recordings, of two counters that need no threshold for a gait.
"""

from __future__ import annotations

import json
import os
from pathlib import Path

import numpy as np

import lodeflow as lf
from lodeflow.clock import SimClock
from lodeflow.registry import registry
from lodeflow.testing import run_node
from lodeflow_plugins.pedestrian.geographic import rotation

STRETCHES = (0.7, 0.85, 1.0, 1.15, 1.3, 1.5)


def node(name: str, **inputs: lf.Message) -> dict[str, lf.Message]:
    return run_node(registry().load(name), {}, **inputs)


def stretched(imu: lf.Imu, stretch: float) -> lf.Imu:
    """The same motion at 1/stretch of its speed, on the same grid of stamps."""
    quaternion = node("inertial_attitude", imu=imu)["attitude"].quaternion
    a = rotation.by_quaternion(imu.linear_acceleration, quaternion, lf.STANDARD_GRAVITY)
    back = quaternion * [-1.0, -1.0, -1.0, 1.0]
    force = rotation.by_quaternion(
        a / stretch**2 + np.array([0.0, 0.0, lf.STANDARD_GRAVITY]), back, 0.0
    )
    count = int((len(imu) - 1) * stretch)
    at = np.arange(count) / stretch
    index = np.arange(len(imu))
    rate, force = (
        np.column_stack([np.interp(at, index, column) for column in columns.T])
        for columns in (imu.angular_velocity / stretch, force)
    )
    spacing = (imu.t[-1] - imu.t[0]) / (len(imu) - 1)
    return lf.Imu(np.rint(np.arange(count) * spacing).astype(np.int64), rate, force)


def main() -> None:
    folder = Path(os.environ["LODEFLOW_DATA"]) / "steps"
    truth = json.loads((folder / "truth.json").read_text())
    source = registry().load("foot_trial")
    print(f"{'times the speed':<18}{'swing_steps':>14}{'gyro_norm_steps':>18}")
    errors = {stretch: np.zeros(2, int) for stretch in STRETCHES}
    for name, trial in truth.items():
        params = source.Params(file=str(folder / f"{name}.npz"))
        parts = list(source(params).read(SimClock()))
        whole = lf.Imu.concat([part.imu for part in parts])
        for stretch in STRETCHES:
            imu = whole if stretch == 1.0 else stretched(whole, stretch)
            imu = node("imu_decimator", imu=imu)["out"]
            attitude = node("inertial_attitude", imu=imu)["attitude"]
            acceleration = node("to_geographic", imu=imu, attitude=attitude)["out"]
            counted = [
                len(node("swing_steps", imu=imu, acceleration=acceleration)["out"]),
                len(node("gyro_norm_steps", imu=imu)["out"]),
            ]
            errors[stretch] += np.abs(np.array(counted) - trial["true_strides"])
    for stretch, (swing, gyro) in errors.items():
        print(f"{1 / stretch:<18.2f}{swing:>14}{gyro:>18}")


if __name__ == "__main__":
    main()
