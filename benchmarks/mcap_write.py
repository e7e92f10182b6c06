"""Write the same sensor_msgs/Imu messages to MCAP with lodeflow, the mcap package, foxglove-sdk.

    python benchmarks/mcap_write.py [--messages 100000] [--rounds 5] [--block 1000] [--json]

"messages": each begins with message objects, as a program has them: lodeflow with blocks of Imu,
the peers with a ROS 2 message per sample, serialised by the faster of the two packages that do so
in Python (rosbags; mcap-ros2-support takes about three times as long). "bytes": the CDR bytes are
made before the clock starts, and only the writing of MCAP is compared.

All write zstd chunks of 1 MiB with message indexes and chunk CRCs (lodeflow and foxglove-sdk also
a CRC of the whole file): the mcap package and foxglove-sdk by default at level 3, lodeflow at
level 1 with a small table. A time holds opening and closing the file. The writers take turns, and
each round begins with another one, so that a slow spell of the machine hits all alike; the best
round counts. CPU time is shown because a writer may compress in threads of its own.

The messages are random walks sampled at 200 Hz with jittering stamps: noise fills the low bits of
angular velocity and specific force; orientation, covariances and frame_id stay, as in the field.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
import time
import zlib
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import foxglove
import numpy as np
from foxglove.mcap import MCAPWriteOptions
from mcap.writer import Writer
from numpy.typing import NDArray
from rosbags.typesys import Stores, get_typestore

import lodeflow as lf
from lodeflow.messages.cdr import layout_of
from lodeflow.recording.mcap.chunk import Chunk
from lodeflow.recording.mcap.writer import McapWriter

TOPIC, TYPE = "/imu", "sensor_msgs/msg/Imu"
TYPES = get_typestore(Stores.ROS2_HUMBLE)
SCHEMA, _ = TYPES.generate_msgdef(TYPE, ros_version=2)


@dataclass(frozen=True)
class Work:
    """The same N messages in the form that each writer takes; made before the clock starts."""

    imu: lf.Imu
    records: NDArray[np.uint8]
    stamps: list[int]
    payloads: list[bytes]
    objects: list[Any]
    block: int


def make_work(messages: int, block: int, seed: int = 1) -> Work:
    random = np.random.default_rng(seed)
    period = 5_000_000
    t = 1_700_000_000_000_000_000 + period * np.arange(messages)
    t += random.integers(-period // 100, period // 100, messages)

    def walk(step: float) -> NDArray[np.float64]:
        return np.cumsum(random.normal(0.0, step, (messages, 3)), axis=0)

    imu = lf.Imu(t, walk(1e-3), walk(1e-2) + np.array([0.0, 0.0, 9.81]))
    records = layout_of(lf.Imu).encode_block(imu)
    payloads = [row.tobytes() for row in records]
    objects = [TYPES.deserialize_cdr(payload, TYPE) for payload in payloads]
    return Work(imu, records, t.tolist(), payloads, objects, block)


def blocks(work: Work) -> Iterator[slice]:
    for start in range(0, len(work.stamps), work.block):
        yield slice(start, start + work.block)


def lodeflow_from_messages(path: Path, work: Work) -> None:
    layout = layout_of(lf.Imu)
    with McapWriter(path) as writer:
        channel = writer.channel(TOPIC, TYPE, SCHEMA)
        for rows in blocks(work):
            block = work.imu[rows]
            writer.write(channel, block.t, layout.encode_block(block))


def lodeflow_from_bytes(path: Path, work: Work) -> None:
    with McapWriter(path) as writer:
        channel = writer.channel(TOPIC, TYPE, SCHEMA)
        for rows in blocks(work):
            writer.write(channel, work.imu.t[rows], work.records[rows])


def mcap(path: Path, work: Work, payloads: Iterable[bytes]) -> None:
    writer = Writer(str(path))
    writer.start(profile="ros2")
    schema = writer.register_schema(TYPE, "ros2msg", SCHEMA.encode())
    channel = writer.register_channel(TOPIC, "cdr", schema)
    for number, (stamp, payload) in enumerate(zip(work.stamps, payloads, strict=True)):
        writer.add_message(channel, stamp, payload, stamp, number)
    writer.finish()


def foxglove_sdk(path: Path, work: Work, payloads: Iterable[bytes], level: int = 0) -> None:
    context = foxglove.Context()
    options = MCAPWriteOptions(profile="ros2", compression_level=level)
    with foxglove.open_mcap(path, context=context, writer_options=options):
        channel = foxglove.Channel(
            TOPIC,
            schema=foxglove.Schema(name=TYPE, encoding="ros2msg", data=SCHEMA.encode()),
            message_encoding="cdr",
            context=context,
        )
        for stamp, payload in zip(work.stamps, payloads, strict=True):
            channel.log(payload, log_time=stamp)
        channel.close()


def serialised(work: Work) -> Iterator[bytes]:
    for message in work.objects:
        yield bytes(TYPES.serialize_cdr(message, TYPE))


WRITERS: dict[str, Callable[[Path, Work], None]] = {
    "messages: lodeflow": lodeflow_from_messages,
    "messages: mcap package": lambda path, work: mcap(path, work, serialised(work)),
    "messages: foxglove-sdk": lambda path, work: foxglove_sdk(path, work, serialised(work)),
    "bytes: lodeflow": lodeflow_from_bytes,
    "bytes: mcap package": lambda path, work: mcap(path, work, work.payloads),
    "bytes: foxglove-sdk": lambda path, work: foxglove_sdk(path, work, work.payloads),
    "bytes: foxglove-sdk, level 1": lambda path, work: foxglove_sdk(path, work, work.payloads, 1),
}


def measure(work: Work, rounds: int) -> dict[str, dict[str, float]]:
    messages, names = len(work.stamps), list(WRITERS)
    best = {name: {"wall_us": np.inf, "cpu_us": np.inf, "bytes": 0.0} for name in names}
    with tempfile.TemporaryDirectory() as folder:
        for turn in range(rounds):
            for name in names[turn % len(names) :] + names[: turn % len(names)]:
                path = Path(folder, "out.mcap")
                cpu, wall = time.process_time(), time.perf_counter()
                WRITERS[name](path, work)
                wall, cpu = time.perf_counter() - wall, time.process_time() - cpu
                row = best[name]
                row["wall_us"] = min(row["wall_us"], wall / messages * 1e6)
                row["cpu_us"] = min(row["cpu_us"], cpu / messages * 1e6)
                row["bytes"] = path.stat().st_size / messages
                path.unlink()
    for name, row in best.items():
        ours = best[f"{name.partition(':')[0]}: lodeflow"]
        row["ratio"] = row["wall_us"] / ours["wall_us"]
    return best


def parts(work: Work, rounds: int) -> dict[str, float]:
    """Return where the time of lodeflow goes, µs per message, each part alone in warm caches."""
    rows = min(len(work.stamps), Chunk(1 << 20, "").room(work.records.shape[1]))
    t, records = work.imu.t[:rows], work.records[:rows]
    packed, plain = Chunk(1 << 20, "zstd"), Chunk(1 << 20, "")
    raw = bytes(rows * (31 + records.shape[1]))

    def fill() -> None:
        packed.clear()
        packed.fill(1, 0, t, records)

    plain.fill(1, 0, t, records)
    tasks: dict[str, Callable[[], object]] = {
        "fill": fill,
        "crc32": lambda: zlib.crc32(raw),
        "crc32, index and copy": plain.seal,
        "the same with zstd": packed.seal,
    }
    best = dict.fromkeys(tasks, np.inf)
    for _ in range(10 * rounds):
        for name, task in tasks.items():
            start = time.perf_counter()
            task()
            best[name] = min(best[name], (time.perf_counter() - start) / rows * 1e6)
    return best


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--messages", type=int, default=100_000)
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--block", type=int, default=1000, help="messages per write of lodeflow")
    parser.add_argument("--json", action="store_true", help="one JSON object instead of a table")
    options = parser.parse_args()
    work = make_work(options.messages, options.block)
    results = measure(work, options.rounds)
    inside = parts(work, options.rounds)
    if options.json:
        json.dump({**vars(options), "writers": results, "lodeflow_us": inside}, sys.stdout)
        print()
        return
    print(f"{'writer':<30}{'µs/message':>12}{'CPU µs':>9}{'bytes':>8}{'times lodeflow':>16}")
    for name, row in results.items():
        print(
            f"{name:<30}{row['wall_us']:>12.3f}{row['cpu_us']:>9.3f}{row['bytes']:>8.1f}"
            f"{row['ratio']:>16.1f}"
        )
    print("lodeflow: " + ", ".join(f"{name} {us:.3f} µs" for name, us in inside.items()))


if __name__ == "__main__":
    main()
