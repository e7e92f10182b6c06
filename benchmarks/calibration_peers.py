"""Calibrations beside imucal (Ferraris) and magcal, on the same simulated sensors.

    pip install ".[bench]" && python benchmarks/calibration_peers.py [--seeds N] [--json]

Sensors are those of Chu et al. 2017. Accelerometer: the same six positions of 200 samples for
both. Gyroscope: at rest in them, and turned by 360 degrees about each axis (imucal), or at six
rates about each axis (lodeflow), 1200 samples of turning for both. Magnetometer: the same 2000
readings, all over the sphere or over its upper two thirds. Figures are the median over seeds of
the largest error.
"""

from __future__ import annotations

import argparse
import json

import imucal
import magcal
import numpy as np

from lodeflow_plugins.calibration import chu2017, ellipsoid, least_squares

ACCEL_NOISE, GYRO_NOISE, MAG_NOISE = 10.0, 1.2, 2.0  # LSB per sample
GRAVITY = 9.80665
FACES = dict(zip(["z_p", "z_a", "y_p", "y_a", "x_a", "x_p"], chu2017.SIX_POSITIONS, strict=True))
RATES = [30.0, 60.0, 90.0, -30.0, -60.0, -90.0]


def counts(model, vectors, noise, rng):
    """What a sensor counts, whole LSB."""
    return np.rint(model(vectors) + rng.normal(0.0, noise, vectors.shape))


def inertial(seed: int) -> dict[str, dict[str, float]]:
    """Errors of gain (part of it) and offset (LSB) of accelerometer and gyroscope."""
    rng = np.random.default_rng(seed)
    force, rate = chu2017.ACCELEROMETER.inverse(), chu2017.GYROSCOPE.inverse()
    at_rest, turns = {}, {}
    for name, face in FACES.items():
        at_rest[f"acc_{name}"] = counts(force, np.tile(face, (200, 1)), ACCEL_NOISE, rng)
        at_rest[f"gyr_{name}"] = counts(rate, np.zeros((200, 3)), GYRO_NOISE, rng)
    for name, axis in zip("xyz", np.eye(3), strict=True):
        # 400 samples at 90 degrees per second and 100 Hz are a full turn
        up = np.tile(FACES[f"{name}_p"], (400, 1))
        turns[f"acc_{name}_rot"] = counts(force, up, ACCEL_NOISE, rng)
        turns[f"gyr_{name}_rot"] = counts(rate, np.tile(90.0 * axis, (400, 1)), GYRO_NOISE, rng)
    peer = imucal.FerrarisCalibration(grav=GRAVITY, expected_angle=360.0).compute(
        imucal.FerrarisSignalRegions(**at_rest, **turns), 100.0, "LSB", "LSB"
    )
    found = {
        "imucal": (
            np.linalg.inv(peer.K_a @ peer.R_a) / GRAVITY, peer.b_a,
            np.linalg.inv(peer.K_g @ peer.R_g), peer.b_g,
        )
    }  # fmt: skip
    accel = least_squares.accelerometer(
        [at_rest[f"acc_{name}"].mean(axis=0) for name in FACES], chu2017.SIX_POSITIONS
    )
    rates = np.vstack([np.outer(RATES, axis) for axis in np.eye(3)])
    means = [counts(rate, np.tile(r, (67, 1)), GYRO_NOISE, rng).mean(axis=0) for r in rates]
    gyro = least_squares.gyroscope(means, rates).model
    found["lodeflow"] = (
        accel.gain, accel.model.inverse().offset, gyro.matrix, gyro.inverse().offset
    )  # fmt: skip
    true = (chu2017.ACCELEROMETER_GAIN, force.offset, chu2017.GYROSCOPE.matrix, rate.offset)
    names = ("accelerometer gain, ppm", "accelerometer offset, LSB", "gyroscope gain, ppm",
             "gyroscope offset, LSB")  # fmt: skip
    return {
        who: {
            name: float(np.abs(a - b).max()) / (1e-6 * np.abs(b).max() if "ppm" in name else 1.0)
            for name, a, b in zip(names, values, true, strict=True)
        }
        for who, values in found.items()
    }


def magnetic(seed: int) -> dict[str, dict[str, float]]:
    """Errors of the centre (LSB) and distance of calibrated readings from the sphere (%)."""
    rng = np.random.default_rng(seed)
    sphere = rng.standard_normal((6000, 3))
    sphere /= np.linalg.norm(sphere, axis=1, keepdims=True)
    found: dict[str, dict[str, float]] = {"magcal": {}, "lodeflow": {}}
    for where, points in (("sphere", sphere), ("two thirds", sphere[sphere[:, 2] > -1 / 3])):
        readings = counts(chu2017.MAGNETOMETER, points[:2000], MAG_NOISE, rng)
        own = ellipsoid.fit(readings)
        peer = magcal.MagnetometerCalibrator().ellipsoid_fit(readings)
        pairs = {"lodeflow": (own.centre, own.shape),
                 "magcal": (peer["center"], peer["transform_matrix"])}  # fmt: skip
        every = chu2017.MAGNETOMETER(sphere)
        for who, (centre, shape) in pairs.items():
            off = np.linalg.norm((every - centre) @ shape.T, axis=1) - 1.0
            error = float(np.abs(centre - chu2017.MAGNETOMETER_BIAS).max())
            found[who][f"magnetometer bias ({where}), LSB"] = error
            found[who][f"off the sphere ({where}), % rms"] = float(100 * np.sqrt(np.mean(off**2)))
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, default=50)
    parser.add_argument("--json", action="store_true")
    args = parser.parse_args()
    medians: dict[str, dict[str, float]] = {}
    for compare in (inertial, magnetic):
        runs = [compare(seed) for seed in range(args.seeds)]
        for who, figures in runs[0].items():
            for name in figures:
                median = float(np.median([run[who][name] for run in runs]))
                medians.setdefault(who, {})[name] = median
    if args.json:
        print(json.dumps(medians, indent=2))
        return
    print("| median of the largest error | lodeflow | peer | |\n|---|---|---|---|")
    for name, figure in medians["lodeflow"].items():
        peer = next(who for who in ("imucal", "magcal") if name in medians.get(who, {}))
        print(f"| {name} | {figure:.3g} | {medians[peer][name]:.3g} | {peer} |")


if __name__ == "__main__":
    main()
