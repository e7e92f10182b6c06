"""Calibrators."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

import lodeflow as lf
from family_rows import Blocks, Reference, Row, imu_and_field, stamps, stateless
from lodeflow.registry import registry


def counts(port: str, kind: type[lf.Message]) -> Callable[[int], Blocks]:
    """Random triples at 100 Hz for one port."""
    return lambda n: {port: kind(stamps(n, 100.0), np.random.default_rng(0).normal(size=(n, 3)))}


def affine(plugin: str, kind: type[lf.Message], port: str, member: str, matrix: str) -> Row:
    """A calibrator: matrix x + offset."""
    node = registry().load(plugin)
    live = node(node.Params(**node.example))
    live.start()
    model = getattr(live, matrix)
    transposed = model.matrix.T.copy()
    reference = stateless(lambda blocks: getattr(blocks[port], member) @ transposed + model.offset)
    return Row(plugin, reference, counts(port, kind))


def ellipse(blocks: Blocks) -> np.ndarray:
    return (blocks["mag"].magnetic_field - [2e-6, -1e-6, 0.0]) @ np.diag([0.9, 1.1, 1.0])


def combined(n: int) -> Blocks:
    rng, t = np.random.default_rng(0), stamps(n, 100.0)
    return {
        "force": lf.SpecificForce(t, rng.normal(size=(n, 3))),
        "rate": lf.AngularRate(t, rng.normal(size=(n, 3))),
    }


def combine(blocks: Blocks) -> tuple[np.ndarray, np.ndarray]:
    return blocks["rate"].angular_rate.copy(), blocks["force"].specific_force.copy()


def online_by_numpy() -> Reference:
    """The sums of the online estimator over a segment, row by row with numpy's small matrices."""
    turn, sums = np.eye(3), [np.zeros((3, 3)), np.zeros(3), np.zeros(3), 0.0]

    def run(blocks: Blocks) -> None:
        nonlocal turn
        rates, fields = blocks["imu"].angular_velocity, blocks["mag"].magnetic_field
        for rate, m in zip(rates, fields, strict=True):
            x, y, z = 0.01 * rate
            cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
            angle = np.sqrt(x * x + y * y + z * z)
            turn = turn @ (
                np.eye(3)
                + np.sin(angle) / angle * cross
                + (1.0 - np.cos(angle)) / angle**2 * (cross @ cross)
            )
            sums[0] = sums[0] + turn
            sums[1] = sums[1] + m
            sums[2] = sums[2] + turn @ m
            sums[3] = sums[3] + m @ m

    return run


ROWS = [
    affine("mag_calibrator", lf.RawField, "raw", "counts", "field"),
    affine("accel_calibrator", lf.RawForce, "raw", "counts", "force"),
    affine("gyro_calibrator", lf.RawRate, "raw", "counts", "rate"),
    affine("iron_calibrator", lf.MagneticField, "mag", "magnetic_field", "field"),
    Row("ellipse_calibrator", stateless(ellipse), counts("mag", lf.MagneticField)),
    Row("imu_combiner", stateless(combine), combined),
    Row("online_mag_calibrator", online_by_numpy, imu_and_field, params={}),
]
