"""Read sensor_msgs/Imu messages out of MCAP with lodeflow, rosbags and the mcap package.

    python benchmarks/mcap_read.py [--messages 100000] [--rounds 5] [--json]

All read the same file, and give all numbers of each message: lodeflow as columns, rosbags and the
mcap package (with the decoder of mcap-ros2-support) as an object per message. "bytes" stops before
the decoding: only the messages' CDR bytes are looked up. "file by": who wrote the file, so that
none reads only what suits it: lodeflow writes a message index per block, the mcap package, in the
manner of a live recorder, one entry after the other; both with zstd in chunks of 1 MiB.

A time holds opening and closing the file. The readers take turns, and each round begins with
another one, so that a slow spell of the machine hits all alike; the best round counts, and the
ratio is the median over the rounds. What is read is compared before: the sums of all columns.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from mcap_write import TOPIC, TYPES, Work, lodeflow_from_bytes, make_work, mcap
from rosbags.rosbag2 import Reader

import lodeflow as lf
from lodeflow.recording.mcap.file import McapFile
from lodeflow.recording.mcap.raw import parts, topics
from lodeflow.recording.reader import Recording

Read = Callable[[Path], tuple[int, float]]
"""Gives how many messages there are, and the sum of all their numbers."""


def by_lodeflow(path: Path) -> tuple[int, float]:
    count, total = 0, 0.0
    with Recording(path) as recording:
        for block in recording.stream(TOPIC, lf.Imu):
            count += len(block)
            total += float(block.angular_velocity.sum() + block.linear_acceleration.sum())
    return count, total


def _numbers(message: object) -> float:
    rate, force = message.angular_velocity, message.linear_acceleration  # type: ignore[attr-defined]
    total: float = rate.x + rate.y + rate.z + force.x + force.y + force.z
    return total


def by_mcap(path: Path) -> tuple[int, float]:
    count, total = 0, 0.0
    with path.open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        for *_, message in reader.iter_decoded_messages():
            count += 1
            total += _numbers(message)
    return count, total


def by_rosbags(path: Path) -> tuple[int, float]:
    count, total = 0, 0.0
    with Reader(path) as reader:
        for connection, _, data in reader.messages():
            count += 1
            total += _numbers(TYPES.deserialize_cdr(data, connection.msgtype))
    return count, total


def bytes_by_lodeflow(path: Path) -> tuple[int, float]:
    with McapFile(path) as file:
        wanted = {TOPIC: [channel.id for channel in topics(file)[TOPIC]]}
        return sum(len(p[TOPIC].rows(file, TOPIC).t) for p in parts(file, wanted)), 0.0


def bytes_by_mcap(path: Path) -> tuple[int, float]:
    with path.open("rb") as file:
        return sum(1 for _ in make_reader(file).iter_messages()), 0.0


def bytes_by_rosbags(path: Path) -> tuple[int, float]:
    with Reader(path) as reader:
        return sum(1 for _ in reader.messages()), 0.0


READERS: dict[str, Read] = {
    "numbers: lodeflow": by_lodeflow,
    "numbers: rosbags": by_rosbags,
    "numbers: mcap package": by_mcap,
    "bytes: lodeflow": bytes_by_lodeflow,
    "bytes: rosbags": bytes_by_rosbags,
    "bytes: mcap package": bytes_by_mcap,
}


def files(work: Work, folder: Path) -> dict[str, Path]:
    """Write the same messages twice, and check that all readers find the same in them."""
    made = {"lodeflow": folder / "lodeflow.mcap", "mcap package": folder / "mcap.mcap"}
    lodeflow_from_bytes(made["lodeflow"], work)
    mcap(made["mcap package"], work, work.payloads)
    expected = float(work.imu.angular_velocity.sum() + work.imu.linear_acceleration.sum())
    for path in made.values():
        for name, read in READERS.items():
            count, total = read(path)
            same = name.startswith("bytes") or np.isclose(total, expected)
            if count != len(work.stamps) or not same:
                sys.exit(f"{name} reads {count} messages, sum {total}; written: {expected}")
    return made


def measure(work: Work, rounds: int) -> dict[str, dict[str, dict[str, float]]]:
    """Return µs per message and times lodeflow of each reader, for each file."""
    names, found = list(READERS), {}
    with tempfile.TemporaryDirectory() as folder:
        for writer, path in files(work, Path(folder)).items():
            times: dict[str, list[float]] = {name: [] for name in names}
            for turn in range(rounds):
                for name in names[turn % len(names) :] + names[: turn % len(names)]:
                    begin = time.perf_counter()
                    READERS[name](path)
                    times[name].append((time.perf_counter() - begin) / len(work.stamps) * 1e6)
            found[writer] = {}
            for name, seen in times.items():
                ours = times[f"{name.partition(':')[0]}: lodeflow"]
                ratio = float(np.median(np.array(seen) / np.array(ours)))
                found[writer][name] = {"us": min(seen), "ratio": ratio}
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--messages", type=int, default=100_000)
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--json", action="store_true", help="one JSON object instead of a table")
    options = parser.parse_args()
    results = measure(make_work(options.messages, block=1000), options.rounds)
    if options.json:
        json.dump({**vars(options), "files": results}, sys.stdout)
        print()
        return
    print(f"{'file by':<15}{'reader':<24}{'µs/message':>12}{'times lodeflow':>16}")
    for writer, rows in results.items():
        for name, row in rows.items():
            print(f"{writer:<15}{name:<24}{row['us']:>12.3f}{row['ratio']:>16.1f}")


if __name__ == "__main__":
    main()
