"""Draw docs/figures/attitude.png: a magnet that comes and goes, seen by three filters.

    LODEFLOW_DATA=FOLDER python docs/figures/attitude.py

FOLDER/broad holds trial 34 of BROAD. The filters run as in `lodeflow run graphs/broad.yaml` with
--swap; this needs the packages vqf and matplotlib.
"""

from __future__ import annotations

import os
from pathlib import Path

import matplotlib as mpl
import numpy as np

import lodeflow as lf
from lodeflow.clock import SimClock
from lodeflow.testing import run_node
from lodeflow_plugins.fusion.heading_kalman.node import HeadingKalman
from lodeflow_plugins.fusion.inertial_attitude.node import InertialAttitude
from lodeflow_plugins.fusion.peers.vqf import Vqf
from lodeflow_plugins.fusion.quaternion_kalman.node import ChuFuser
from lodeflow_plugins.sources.broad import BroadTrial

mpl.use("Agg")
import matplotlib.pyplot as plt

HERE = Path(__file__).parent
TRIAL = "34_disturbed_attached_magnet_3cm.mat"


def about_vertical(estimate: np.ndarray, truth: np.ndarray) -> np.ndarray:
    """Signed heading error (N,), degrees, of quaternions (N, 4)."""
    x, y, z, w = estimate.T
    p, q, r, s = truth.T
    vertical = z * s - w * r + y * p - x * q
    angle = 2.0 * np.arctan2(vertical, x * p + y * q + z * r + w * s)
    return np.degrees((angle + np.pi) % (2.0 * np.pi) - np.pi)


def main() -> None:
    """Run, draw."""
    file = Path(os.environ["LODEFLOW_DATA"], "broad", TRIAL)
    source = BroadTrial(BroadTrial.Params(file=str(file)))
    imus, mags, truths = zip(*source.read(SimClock()), strict=True)
    imu, mag = lf.Imu.concat(imus), lf.MagneticField.concat(mags)
    truth = lf.AttitudeTruth.concat(truths).quaternion
    level = run_node(InertialAttitude, imu=imu)["attitude"]
    ours = run_node(HeadingKalman, attitude=level, mag=mag)
    estimates = {
        "Chu filter, gated": run_node(ChuFuser, {"gate": 0.5}, imu=imu, mag=mag)["out"],
        "VQF": run_node(Vqf, imu=imu, mag=mag)["out"],
        "inertial_attitude + heading_kalman": ours["attitude"],
    }
    state = ours["state"]

    figure, axes = plt.subplots(3, 1, figsize=(8, 7.5), sharex=True, layout="constrained")
    norm = np.linalg.norm(mag.magnetic_field, axis=1)
    axes[0].plot(mag.t * 1e-9, norm * 1e6, color="black", lw=0.5)
    axes[0].set_ylabel("field, µT")
    axes[0].set_title("norm of the measured field; a magnet is on the sensor while it is disturbed")
    for (name, estimate), color in zip(estimates.items(), ("C2", "C1", "C0"), strict=True):
        error = about_vertical(estimate.quaternion, truth)
        axes[1].plot(estimate.t * 1e-9, error, color=color, lw=0.8, label=name)
    sigma = np.degrees(np.sqrt(state.variance))
    axes[1].fill_between(state.t * 1e-9, -sigma, sigma, color="C0", alpha=0.15, lw=0)
    axes[1].set_ylim(-16, 16)
    axes[1].set_ylabel("heading error, °")
    axes[1].set_title("heading error, and the standard deviation that heading_kalman gives")
    axes[1].legend(loc="upper left", fontsize=8)
    strength = np.linalg.norm(state.disturbance, axis=1) * 1e6
    iron = np.linalg.norm(state.hard_iron, axis=1) * 1e6
    axes[2].plot(state.t * 1e-9, strength, color="C3", lw=0.6, label="disturbance")
    axes[2].plot(state.t * 1e-9, iron, color="C4", lw=1.5, label="magnet on the body")
    axes[2].set_ylabel("estimated, µT")
    axes[2].set_title("what heading_kalman makes of the field")
    axes[2].legend(loc="upper right", fontsize=8)
    axes[2].set_xlabel("time, s")
    for axis in axes:
        axis.title.set_fontsize(10)
        axis.grid(alpha=0.3)
    figure.savefig(HERE / "attitude.png", dpi=110, metadata={"Software": None})


if __name__ == "__main__":
    main()
