"""Counters of steps, tracks, and what they take."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import scipy.signal
from numpy.lib.stride_tricks import sliding_window_view
from scipy.spatial.transform import Rotation

import lodeflow as lf
from family_rows import Blocks, Reference, Row, norm, stamps, stateless
from lodeflow_plugins.filtering import smoothing

RATE = 50.0  # Hz
G = lf.STANDARD_GRAVITY


def walk(n: int) -> dict[str, lf.Message]:
    """A foot that swings once a second."""
    rng = np.random.default_rng(0)
    t = stamps(n, RATE)
    phase = t * 1e-9 % 1.0
    swing = np.where(phase > 0.4, np.sin(np.pi * (phase - 0.4) / 0.6), 0.0)[:, None]
    acceleration = swing * [15.0, 3.0, 8.0] + 0.1 * rng.standard_normal((n, 3))
    rate = swing * [1.0, 6.0, 1.0] + 0.02 * rng.standard_normal((n, 3))
    quaternion = rng.standard_normal((n, 4)) * 0.05 + [0.0, 0.0, 0.0, 1.0]
    quaternion /= np.linalg.norm(quaternion, axis=1, keepdims=True)
    angle = 0.1 * rng.standard_normal((3, n))
    steps = t[:: int(RATE)].copy()
    return {
        "imu": lf.Imu(t, rate, acceleration + np.array([0.0, 0.0, G])),
        "attitude": lf.Attitude(t, quaternion),
        "euler": lf.EulerAngles(t, angle[0] % (2.0 * np.pi), angle[1], angle[2]),
        "acceleration": lf.Acceleration(t, acceleration),
        "steps": lf.Step(steps, np.arange(1, len(steps) + 1), steps),
    }


def take(*ports: str) -> Callable[[int], Blocks]:
    """Make the streams of the walk that a node takes."""
    return lambda n: {port: block for port, block in walk(n).items() if port in ports}


def by_stillness(value: Callable[[Blocks], np.ndarray], limit: float) -> Callable[[], Reference]:
    """A counter of runs of still samples."""
    return stateless(lambda s: still_runs(value(s) < limit))


def decimated(s: Blocks) -> list[np.ndarray]:
    n = len(s["imu"]) // 4 * 4
    columns = s["imu"].angular_velocity, s["imu"].linear_acceleration
    return [column[:n].reshape(-1, 4, 3).mean(axis=1) for column in columns]


def still_runs(still: np.ndarray) -> np.ndarray:
    edges = np.flatnonzero(np.diff(np.concatenate([[0], still.view(np.int8), [0]])))
    return edges[::2][np.diff(edges)[::2] >= 5]


def to_geographic(s: Blocks) -> np.ndarray:
    return Rotation.from_quat(s["attitude"].quaternion).apply(s["imu"].linear_acceleration) - [
        0,
        0,
        G,
    ]


def gyro_norm_peaks(s: Blocks) -> np.ndarray:
    low = scipy.signal.filtfilt(
        *scipy.signal.butter(2, 2.0, fs=RATE), norm(s["imu"].angular_velocity)
    )
    return scipy.signal.find_peaks(low, prominence=1.0, distance=20)[0]


def swings(s: Blocks) -> np.ndarray:
    motion = np.hypot(norm(s["acceleration"].acceleration), 2.5 * norm(s["imu"].angular_velocity))
    level = np.convolve(np.log(np.maximum(motion, 0.5)), smoothing.hann(0.2, RATE), "same")
    return scipy.signal.find_peaks(level, prominence=math.log(2.2))[0]


def autocorrelation(s: Blocks) -> list[int]:
    windows = sliding_window_view(norm(s["imu"].linear_acceleration), 200)[::25]
    windows = windows - windows.mean(axis=1, keepdims=True)
    repeated = [np.correlate(window, window, "full")[229:300] for window in windows]
    return [30 + int(np.argmax(part)) for part in repeated]


def euler(s: Blocks) -> np.ndarray:
    angles = np.column_stack([-s["euler"].heading, s["euler"].pitch, s["euler"].roll])
    return Rotation.from_euler("ZXY", angles).apply(s["imu"].linear_acceleration) - [0, 0, G]


def windows(values: np.ndarray) -> np.ndarray:
    return sliding_window_view(values, 3, axis=0)


def shoe(s: Blocks) -> np.ndarray:
    force = windows(s["imu"].linear_acceleration)
    mean = force.mean(axis=2)
    rest = force - (G * mean / norm(mean)[:, None])[:, :, None]
    turning = windows((s["imu"].angular_velocity ** 2).sum(axis=1))
    return ((rest**2).sum(axis=1) / 1e-4 + turning / 3e-6).mean(axis=1)


def ared(s: Blocks) -> np.ndarray:
    return windows((s["imu"].angular_velocity ** 2).sum(axis=1)).mean(axis=1)


def amvd(s: Blocks) -> np.ndarray:
    force = windows(s["imu"].linear_acceleration)
    return ((force - force.mean(axis=2, keepdims=True)) ** 2).sum(axis=1).mean(axis=1)


def mag(s: Blocks) -> np.ndarray:
    return windows((norm(s["imu"].linear_acceleration) - G) ** 2).mean(axis=1)


def force_peaks(s: Blocks) -> np.ndarray:
    low = scipy.signal.butter(2, 3.0, fs=RATE)
    smooth = scipy.signal.filtfilt(*low, norm(s["imu"].linear_acceleration))
    return scipy.signal.find_peaks(smooth, prominence=1.0, distance=40)[0]


def step_track(s: Blocks) -> np.ndarray:
    at = np.searchsorted(s["attitude"].t, s["steps"].t, side="right") - 1
    forward = Rotation.from_quat(s["attitude"].quaternion[at]).apply([1.0, 0.0, 0.0])[:, :2]
    return np.cumsum(1.4 * forward / np.hypot(*forward.T)[:, None], axis=0)


def stance_track(s: Blocks) -> np.ndarray:
    """Velocity between two stances less a ramp, integrated twice."""
    a = s["acceleration"].acceleration
    velocity = np.cumsum(a, axis=0) / RATE
    moving = np.hypot(norm(a), 2.5 * norm(s["imu"].angular_velocity))
    still = still_runs(moving < 2.5)
    rows = np.arange(len(a))
    ramp = np.column_stack([np.interp(rows, still, v[still]) for v in velocity.T])
    return np.cumsum(velocity - ramp, axis=0) / RATE


IMU, BOTH = take("imu"), take("imu", "acceleration")
ROWS = [
    Row("imu_decimator", stateless(decimated), IMU, whole=True),
    Row("to_geographic", stateless(to_geographic), take("imu", "attitude")),
    Row("euler_to_geographic", stateless(euler), take("imu", "euler")),
    Row(
        "zero_velocity_steps",
        by_stillness(lambda s: norm(s["acceleration"].acceleration), 2.5),
        take("acceleration"),
        whole=True,
    ),
    Row(
        "raw_norm_steps",
        by_stillness(lambda s: np.abs(norm(s["imu"].linear_acceleration) - G), 0.4),
        IMU,
        whole=True,
    ),
    Row("shoe_steps", by_stillness(shoe, 2e5), IMU, whole=True),
    Row("ared_steps", by_stillness(ared, 1.0), IMU, whole=True),
    Row("amvd_steps", by_stillness(amvd, 1.0), IMU, whole=True),
    Row("mag_steps", by_stillness(mag, 1.0), IMU, whole=True),
    Row("gyro_norm_steps", stateless(gyro_norm_peaks), IMU, whole=True),
    Row("acceleration_peak_steps", stateless(force_peaks), IMU, whole=True),
    Row("autocorrelation_steps", stateless(autocorrelation), IMU, whole=True),
    Row("swing_steps", stateless(swings), BOTH, whole=True),
    Row("step_track", stateless(step_track), take("steps", "attitude"), whole=True),
    Row("stance_track", stateless(stance_track), BOTH, whole=True),
]
