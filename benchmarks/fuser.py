"""Time the quaternion Kalman filter beside vqf, imufusion and ahrs (Madgwick) on one record.

    python benchmarks/fuser.py [--samples 40960] [--rounds 7] [--block 8192] [--json]

The record is the simulated vehicle at 100 Hz with noise on all sensors. A filter takes it in
blocks, or sample by sample through Python, as a live node does; each time holds the quaternions
that come out. The filters take turns, and each round begins with another one, so that a slow spell
of the machine hits all alike; the median round counts, in time of the processor. Ratios are to vqf
in the same form.

The nodes are driven as in a run: "node quaternion_kalman" gets IMU and measured attitude, "node
chu_fuser" IMU and field, two messages in and one out, through the driver of blocks or of samples;
"source alone" brings the same two messages into a graph without the node.

"kalman" is the filter alone, with the measured quaternions given; "compass + kalman" makes them
from accelerometer and magnetometer first, which is what the others do too; "fused" does the same
in one compiled call. "two stages" are inertial_attitude and heading_kalman, "node attitude_fuser"
both in one.
"""

from __future__ import annotations

import argparse
import json
import math
import statistics
import time
from collections.abc import Callable, Iterator
from typing import NamedTuple

import ahrs
import imufusion
import numpy as np
import vqf

import lodeflow as lf
from lodeflow.graph.model import Graph, GraphNode, Wire
from lodeflow.runtime.blocks import BlockDriver
from lodeflow.runtime.plan import Plan
from lodeflow.runtime.samples import SampleDriver
from lodeflow_plugins.fusion.attitude_fuser.node import AttitudeFuser
from lodeflow_plugins.fusion.heading_kalman.node import HeadingKalman
from lodeflow_plugins.fusion.inertial_attitude.node import InertialAttitude
from lodeflow_plugins.fusion.quaternion_kalman import filter as kalman
from lodeflow_plugins.fusion.quaternion_kalman.fuse import fuse
from lodeflow_plugins.fusion.quaternion_kalman.node import ChuFuser, QuaternionKalman
from lodeflow_plugins.fusion.tilt_compass import compass
from lodeflow_plugins.sources.simulated_vehicle import model

RATE = 100  # Hz
GYRO_NOISE = np.radians(0.15)  # rad/s


class Piece(NamedTuple):
    """Consecutive rows of the record, in the units of each filter."""

    t: np.ndarray  # ns
    rate: np.ndarray  # rad/s
    force: np.ndarray  # m/s^2
    field: np.ndarray  # tesla
    measured: np.ndarray  # quaternions of the compass
    rate_in_degrees: np.ndarray
    force_in_g: np.ndarray
    field_in_microtesla: np.ndarray


def measured_in(piece: Piece) -> lf.Attitude:
    return lf.Attitude(piece.t, piece.measured)


class Sensors(NamedTuple):
    imu: lf.Imu
    mag: lf.MagneticField
    attitude: lf.Attitude


class Hand(lf.Source):
    """Pushed by hand."""

    def read(self, clock: lf.Clock) -> Iterator[Sensors]:
        yield from ()


class Pieces:
    """A record cut into pieces of equal length."""

    def __init__(self, samples: int, length: int) -> None:
        t = np.arange(samples, dtype=np.int64) * (1_000_000_000 // RATE)
        errors = model.Errors(
            gyroscope=model.SensorError(GYRO_NOISE),
            accelerometer=model.SensorError(0.05),
            magnetometer=model.SensorError(2e-7),
        )
        readings = model.readings(model.truth(model.Vehicle(), t * 1e-9), errors, 1, 0)
        rate, force = readings.angular_velocity, readings.specific_force
        field = readings.magnetic_field
        _, measured = compass.measure(force, field)
        columns = (t, rate, force, field, measured, np.degrees(rate), force / 9.81, field * 1e6)
        self.samples = samples
        self.pieces = [
            Piece(*(column[k : k + length].copy() for column in columns))
            for k in range(0, samples, length)
        ]
        blocks = length > 1
        self.imu, self.mag, self.attitude = [
            [m if blocks else m.row(0) for m in messages]
            for messages in zip(
                *[
                    (lf.Imu(p.t, p.rate, p.force), lf.MagneticField(p.t, p.field), measured_in(p))
                    for p in self.pieces
                ],
                strict=True,
            )
        ]
        self.index = np.arange(length)

    def __iter__(self) -> Iterator[Piece]:
        return iter(self.pieces)


def run_kalman(pieces: Pieces) -> None:
    constants = kalman.constants(GYRO_NOISE, 1e-3, 1e-3)
    state = kalman.new_state()
    for piece in pieces:
        out = np.empty((len(piece.t), 4))
        index = pieces.index[: len(piece.t)]
        kalman.run(piece.t, piece.rate, piece.measured, index, constants, state, out)


def run_compass_kalman(pieces: Pieces) -> None:
    constants = kalman.constants(GYRO_NOISE, 1e-3, 1e-3)
    state = kalman.new_state()
    for piece in pieces:
        _, measured = compass.measure(piece.force, piece.field)
        out = np.empty((len(piece.t), 4))
        index = pieces.index[: len(piece.t)]
        kalman.run(piece.t, piece.rate, measured, index, constants, state, out)


def run_fused(pieces: Pieces) -> None:
    constants = kalman.constants(GYRO_NOISE, 1e-3, 1e-3)
    state = kalman.new_state()
    for piece in pieces:
        index = pieces.index[: len(piece.t)]
        fuse(piece.t, piece.rate, piece.force, piece.field, index, 9.81, math.inf, constants, state)


def started(plugin: type[lf.Node], second: str) -> tuple[Plan, list]:
    """A graph of one node, and what it sends."""
    first, other = [port.name for port in plugin.spec.inputs]
    inputs = {first: Wire("hand", "imu"), other: Wire("hand", second)}
    nodes = {
        "hand": GraphNode("hand", "Hand", Hand, Hand.Params()),
        "node": GraphNode("node", plugin.__name__, plugin, plugin.Params(), inputs),
    }
    plan = Plan(Graph("bench", nodes))
    sent: list = []
    plan.tap(Wire("node", "out"), sent.append)
    plan.start()
    return plan, sent


def two_stages() -> tuple[Plan, list]:
    """The graph of the two attitude stages, and what it sends."""
    nodes = {
        "hand": GraphNode("hand", "Hand", Hand, Hand.Params()),
        "inclination": GraphNode(
            "inclination",
            "InertialAttitude",
            InertialAttitude,
            InertialAttitude.Params(),
            {"imu": Wire("hand", "imu")},
        ),
        "heading": GraphNode(
            "heading",
            "HeadingKalman",
            HeadingKalman,
            HeadingKalman.Params(),
            {"attitude": Wire("inclination", "attitude"), "mag": Wire("hand", "mag")},
        ),
    }
    plan = Plan(Graph("bench", nodes))
    sent: list = []
    plan.tap(Wire("heading", "attitude"), sent.append)
    plan.start()
    return plan, sent


def stages_in_blocks(pieces: Pieces) -> None:
    plan, sent = two_stages()
    push = BlockDriver(plan).push
    for imu, mag in zip(pieces.imu, pieces.mag, strict=True):
        push("hand", [(0, imu), (1, mag)], int(imu.t[-1]) + 1)
    assert sum(map(len, sent)) == pieces.samples


def stages_by_samples(pieces: Pieces) -> None:
    plan, sent = two_stages()
    push = SampleDriver(plan).push
    for imu, mag in zip(pieces.imu, pieces.mag, strict=True):
        push("hand", 0, imu)
        push("hand", 1, mag)
    assert len(sent) == pieces.samples


def stages_alone(pieces: Pieces) -> None:
    """Both kernels, without nodes."""
    fuser = AttitudeFuser()
    fuser.start()
    index = pieces.index
    for imu, mag in zip(pieces.imu, pieces.mag, strict=True):
        rows = index[: len(imu)]
        fuser.step_block(lf.Sparse(imu, rows, imu.t), lf.Sparse(mag, rows, imu.t))


def node_in_blocks(plugin: type[lf.Node], second: str) -> Callable[[Pieces], None]:
    port = Sensors._fields.index(second)

    def through(pieces: Pieces) -> None:
        plan, sent = started(plugin, second)
        push = BlockDriver(plan).push
        for imu, other in zip(pieces.imu, getattr(pieces, second), strict=True):
            push("hand", [(0, imu), (port, other)], int(imu.t[-1]) + 1)
        assert sum(map(len, sent)) == pieces.samples

    return through


def node_by_samples(plugin: type[lf.Node], second: str) -> Callable[[Pieces], None]:
    port = Sensors._fields.index(second)

    def through(pieces: Pieces) -> None:
        plan, sent = started(plugin, second)
        push = SampleDriver(plan).push
        for imu, other in zip(pieces.imu, getattr(pieces, second), strict=True):
            push("hand", 0, imu)
            push("hand", port, other)
        assert len(sent) == pieces.samples

    return through


def source_by_samples(pieces: Pieces) -> None:
    plan = Plan(Graph("bench", {"hand": GraphNode("hand", "Hand", Hand, Hand.Params())}))
    push = SampleDriver(plan).push
    for imu, other in zip(pieces.imu, pieces.mag, strict=True):
        push("hand", 0, imu)
        push("hand", 1, other)


def run_vqf_blocks(pieces: Pieces) -> None:
    estimator = vqf.VQF(1.0 / RATE)
    for piece in pieces:
        _ = estimator.updateBatch(piece.rate, piece.force, piece.field)["quat9D"]


def run_vqf_samples(pieces: Pieces) -> None:
    estimator = vqf.VQF(1.0 / RATE)
    for piece in pieces:
        estimator.update(piece.rate[0], piece.force[0], piece.field[0])
        _ = estimator.getQuat9D()


def run_imufusion(pieces: Pieces) -> None:
    estimator = imufusion.Ahrs()
    estimator.set_sample_period(1.0 / RATE)
    for piece in pieces:
        estimator.update(
            piece.rate_in_degrees[0], piece.force_in_g[0], piece.field_in_microtesla[0]
        )
        _ = estimator.get_quaternion()


def run_madgwick(pieces: Pieces) -> None:
    estimator = ahrs.filters.Madgwick(frequency=RATE)
    q = np.array([1.0, 0.0, 0.0, 0.0])
    for piece in pieces:
        q = estimator.updateMARG(q, piece.rate[0], piece.force[0], piece.field_in_microtesla[0])


def compete(
    contenders: dict[str, Callable[[Pieces], None]], pieces: Pieces, rounds: int
) -> dict[str, float]:
    """Median time in µs per sample."""
    names = list(contenders)
    times: dict[str, list[float]] = {name: [] for name in names}
    for name in names:
        contenders[name](pieces)  # compiles, fills caches
    for turn in range(rounds):
        for k in range(len(names)):
            name = names[(k + turn) % len(names)]
            start = time.process_time()
            contenders[name](pieces)
            times[name].append(time.process_time() - start)
    return {name: 1e6 * statistics.median(t) / pieces.samples for name, t in times.items()}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--samples", type=int, default=40_960)
    parser.add_argument("--rounds", type=int, default=7)
    parser.add_argument("--block", type=int, default=8192)  # as a run gathers
    parser.add_argument("--json", action="store_true")
    args = parser.parse_args()

    blocks = Pieces(args.samples, args.block)
    samples = Pieces(min(args.samples, 10_000), 1)
    results = {
        f"blocks of {args.block}": compete(
            {
                "vqf": run_vqf_blocks,
                "kalman": run_kalman,
                "compass + kalman": run_compass_kalman,
                "fused": run_fused,
                "node quaternion_kalman": node_in_blocks(QuaternionKalman, "attitude"),
                "node chu_fuser": node_in_blocks(ChuFuser, "mag"),
                "two stages, plain calls": stages_alone,
                "two stages, two nodes": stages_in_blocks,
                "node attitude_fuser": node_in_blocks(AttitudeFuser, "mag"),
            },
            blocks,
            args.rounds,
        ),
        "single samples": compete(
            {
                "vqf": run_vqf_samples,
                "kalman": run_kalman,
                "compass + kalman": run_compass_kalman,
                "fused": run_fused,
                "source alone": source_by_samples,
                "node quaternion_kalman": node_by_samples(QuaternionKalman, "attitude"),
                "node chu_fuser": node_by_samples(ChuFuser, "mag"),
                "two stages, two nodes": stages_by_samples,
                "node attitude_fuser": node_by_samples(AttitudeFuser, "mag"),
                "imufusion": run_imufusion,
                "ahrs madgwick": run_madgwick,
            },
            samples,
            args.rounds,
        ),
    }
    if args.json:
        print(json.dumps({"unit": "microseconds per sample", **results}))
        return
    for form, figures in results.items():
        print(f"{form:<26}{'µs/sample':>10}{'of vqf':>10}")
        for name, figure in figures.items():
            print(f"  {name:<24}{figure:>10.3f}{figure / figures['vqf']:>10.2f}")


if __name__ == "__main__":
    main()
