"""Time the nodes of pedestrian/ and gravimetry/, in µs per sample, beside numpy and scipy.

    python benchmarks/families_walking.py [--samples 20000] [--rounds 5] [--block 1000] [--json]

A node is driven as in a run, by the driver of blocks and by that of single samples; the time holds
the messages that come in and go out. The reference does the same over the whole record at once,
as one would write it with numpy and scipy, which is allowed to look ahead. All take turns; the
best round counts.
"""

from __future__ import annotations

import argparse
import json
import math
import time
from collections.abc import Callable, Iterator, Mapping
from types import MappingProxyType
from typing import NamedTuple

import numpy as np
import scipy.signal
from numpy.lib.stride_tricks import sliding_window_view
from scipy.spatial.transform import Rotation

import lodeflow as lf
from lodeflow.graph.model import Graph, GraphNode, Wire
from lodeflow.registry import registry
from lodeflow.runtime.blocks import BlockDriver
from lodeflow.runtime.plan import Plan
from lodeflow.runtime.samples import SampleDriver
from lodeflow_plugins.filtering import smoothing
from lodeflow_plugins.gravimetry.earth import rotation

RATE = 50  # Hz
G = lf.STANDARD_GRAVITY


class Streams(NamedTuple):
    """What the nodes take."""

    imu: lf.Imu
    attitude: lf.Attitude
    acceleration: lf.Acceleration
    coriolis: lf.Acceleration
    force: lf.SpecificForce
    motion: lf.GeodeticMotion


class Hand(lf.Source):
    """Pushed by hand."""

    def read(self, clock: lf.Clock) -> Iterator[Streams]:
        yield from ()


def record(n: int) -> Streams:
    """A foot that swings once a second, and a vehicle that sways."""
    rng = np.random.default_rng(0)
    t = np.arange(n, dtype=np.int64) * (10**9 // RATE)
    phase = t * 1e-9 % 1.0
    swing = np.where(phase > 0.4, np.sin(np.pi * (phase - 0.4) / 0.6), 0.0)[:, None]
    acceleration = swing * [15.0, 3.0, 8.0] + 0.1 * rng.standard_normal((n, 3))
    rate = swing * [1.0, 6.0, 1.0] + 0.02 * rng.standard_normal((n, 3))
    quaternion = rng.standard_normal((n, 4)) * 0.05 + [0.0, 0.0, 0.0, 1.0]
    quaternion /= np.linalg.norm(quaternion, axis=1, keepdims=True)
    force = acceleration + np.array([0.0, 0.0, G])
    full = np.full(n, 0.5)
    motion = lf.GeodeticMotion(t, full, full, 300.0 * full, 60.0 + rng.standard_normal((n, 3)))
    return Streams(
        lf.Imu(t, rate, force),
        lf.Attitude(t, quaternion),
        lf.Acceleration(t, acceleration),
        lf.Acceleration(t, 1e-3 * acceleration),
        lf.SpecificForce(t, force),
        motion,
    )


def still_runs(still: np.ndarray) -> np.ndarray:
    edges = np.flatnonzero(np.diff(np.concatenate([[0], still.view(np.int8), [0]])))
    return edges[::2][np.diff(edges)[::2] >= 5]


def norm(vectors: np.ndarray) -> np.ndarray:
    return np.sqrt((vectors * vectors).sum(axis=1))


def to_geographic(s: Streams) -> np.ndarray:
    return Rotation.from_quat(s.attitude.quaternion).apply(s.imu.linear_acceleration) - [0, 0, G]


def shoe(s: Streams) -> np.ndarray:
    force = sliding_window_view(s.imu.linear_acceleration, 3, axis=0)
    mean = force.mean(axis=2)
    rest = force - (G * mean / norm(mean)[:, None])[:, :, None]
    turning = sliding_window_view((s.imu.angular_velocity**2).sum(axis=1), 3)
    value = ((rest**2).sum(axis=1) / 1e-4 + turning / 3e-6).mean(axis=1)
    return still_runs(value < 2e5)


def gyro_norm(s: Streams) -> np.ndarray:
    low = scipy.signal.filtfilt(*scipy.signal.butter(2, 2.0, fs=RATE), norm(s.imu.angular_velocity))
    return scipy.signal.find_peaks(low, prominence=1.0, distance=20)[0]


def swing(s: Streams) -> np.ndarray:
    motion = np.hypot(norm(s.acceleration.acceleration), 2.5 * norm(s.imu.angular_velocity))
    level = np.convolve(np.log(np.maximum(motion, 0.5)), smoothing.hann(0.2, RATE), "same")
    return scipy.signal.find_peaks(level, prominence=math.log(2.2))[0]


def autocorrelation(s: Streams) -> list[int]:
    windows = sliding_window_view(norm(s.imu.linear_acceleration), 200)[::25]
    windows = windows - windows.mean(axis=1, keepdims=True)
    repeated = [np.correlate(window, window, "full")[229:300] for window in windows]
    return [30 + int(np.argmax(part)) for part in repeated]


def eotvos(s: Streams) -> np.ndarray:
    m, w = s.motion, rotation.EARTH_RATE
    root = 1.0 - rotation.ECCENTRICITY_SQUARED * np.sin(m.latitude) ** 2
    n = rotation.SEMI_MAJOR_AXIS / np.sqrt(root)
    meridian = n * (1.0 - rotation.ECCENTRICITY_SQUARED) / root
    east, north = m.velocity[:, 0], m.velocity[:, 1]
    turning = 2.0 * w * np.cos(m.latitude) * east
    return turning + east**2 / (n + m.height) + north**2 / (meridian + m.height)


def tilt(s: Streams) -> np.ndarray:
    weights = smoothing.low_pass(1.0 / 5.0, RATE)
    f, a, c = (
        np.stack([np.convolve(column, weights, "valid") for column in columns.T])
        for columns in (s.force.specific_force, s.acceleration.acceleration[:, :2],
                        s.coriolis.acceleration[:, :2])
    )  # fmt: skip
    excess = f[0] ** 2 + f[1] ** 2 - ((a + c) ** 2).sum(axis=0)
    return np.stack(
        [f[0] ** 2 + f[1] ** 2 - (a**2).sum(axis=0), excess, np.sqrt(f[2] ** 2 + excess)]
    )


class Row(NamedTuple):
    """A node, what it is wired to where the port is not called alike, and its reference."""

    plugin: str
    reference: Callable[[Streams], object]
    params: Mapping[str, object] = MappingProxyType({})


ROWS = [
    Row("to_geographic", to_geographic),
    Row("zero_velocity_steps", lambda s: still_runs(norm(s.acceleration.acceleration) < 2.5)),
    Row("shoe_steps", shoe),
    Row("gyro_norm_steps", gyro_norm),
    Row("swing_steps", swing),
    Row("autocorrelation_steps", autocorrelation),
    Row("eotvos", eotvos),
    Row("tilt_correction", tilt, {"sample_rate": 50.0, "period": 5.0}),
]


def plan_of(row: Row) -> Plan:
    plugin = registry().load(row.plugin)
    wired = [port.name for port in plugin.spec.inputs if port.name in Streams._fields]
    inputs = {name: Wire("hand", name) for name in wired}
    nodes = {
        "hand": GraphNode("hand", "Hand", Hand, Hand.Params()),
        "node": GraphNode("node", row.plugin, plugin, plugin.Params(**row.params), inputs),
    }
    plan = Plan(Graph("bench", nodes))
    for port in plugin.spec.outputs:
        plan.tap(Wire("node", port.name), [].append)
    plan.start()
    return plan


def ports_of(row: Row) -> list[int]:
    names = [port.name for port in registry().load(row.plugin).spec.inputs]
    return [Streams._fields.index(name) for name in names if name in Streams._fields]


def in_blocks(row: Row, streams: Streams, block: int) -> Callable[[], object]:
    ports = ports_of(row)
    n = len(streams.imu)
    pieces = [[(port, streams[port][k : k + block]) for port in ports] for k in range(0, n, block)]

    def run() -> None:
        push = BlockDriver(plan_of(row)).push
        for piece in pieces:
            push("hand", piece, int(piece[0][1].t[-1]) + 1)

    return run


def by_samples(row: Row, streams: Streams) -> Callable[[], object]:
    ports = ports_of(row)
    samples = [[(port, streams[port].row(k)) for port in ports] for k in range(len(streams.imu))]

    def run() -> None:
        push = SampleDriver(plan_of(row)).push
        for sample in samples:
            for port, message in sample:
                push("hand", port, message)

    return run


def best_times(forms: dict[str, tuple[Callable[[], object], int]], rounds: int) -> dict[str, float]:
    """µs per sample of each form, by turns."""
    times: dict[str, list[float]] = {name: [] for name in forms}
    for turn in range(rounds + 1):  # the first round warms up
        for name, (run, count) in forms.items():
            start = time.perf_counter()
            run()
            if turn:
                times[name].append((time.perf_counter() - start) / count * 1e6)
    return {name: min(found) for name, found in times.items()}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--samples", type=int, default=20_000)
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--block", type=int, default=1000)
    parser.add_argument("--json", action="store_true")
    args = parser.parse_args()
    whole = record(args.samples)
    few = record(min(args.samples, 3000))
    results = {}
    for row in ROWS:
        forms = {
            "blocks": (in_blocks(row, whole, args.block), args.samples),
            "samples": (by_samples(row, few), len(few.imu)),
            "numpy": (lambda row=row: row.reference(whole), args.samples),
        }
        results[row.plugin] = best_times(forms, args.rounds)
    if args.json:
        print(json.dumps({"unit": "microseconds per sample", **results}))
        return
    print(
        f"{'µs per sample':<24}{f'blocks of {args.block}':>16}{'single samples':>16}{'numpy':>10}"
    )
    for name, found in results.items():
        print(f"{name:<24}{found['blocks']:>16.3f}{found['samples']:>16.2f}{found['numpy']:>10.3f}")


if __name__ == "__main__":
    main()
