"""Bulk over a narrow network: how long it takes, beside what its bytes alone take.

    python benchmarks/narrow.py                      10 and 100 Mbit/s
    python benchmarks/narrow.py --rate 2             another rate, Mbit/s

Two groups of a graph, linked by TCP over a loopback that is slowed down: in a network namespace of
its own, which needs Linux, root, and `ip` and `tc` (iproute2).
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

PORT = 7447
RECORD = 324  # bytes of an Imu in CDR
GRAPH = """\
lodeflow: 1
name: narrow
nodes:
  bulk: {use: "narrow_nodes:Bulk", params: {count: COUNT}}
  end: {use: "narrow_nodes:End", inputs: {imu: bulk}}
processes: {near: [bulk], far: [end]}
"""
NODES = """\
from collections.abc import Iterator
from pathlib import Path

import numpy as np

import lodeflow as lf


class Bulk(lf.Source):
    class Params(lf.Params):
        count: int

    def read(self, clock: lf.Clock) -> Iterator[lf.Imu]:
        for first in range(0, self.params.count, 1000):
            t = np.arange(first, first + 1000, dtype=np.int64)
            yield lf.Imu(t, np.ones((1000, 3)), np.ones((1000, 3)))


class End(lf.Node):
    def start(self) -> None:
        self.count = 0

    def step_block(self, imu: lf.Imu) -> None:
        if not self.count:
            Path("begun").touch()
        self.count += len(imu)

    def finish(self) -> None:
        Path("ended").write_text(str(self.count))
"""


@contextmanager
def narrow(rate: float) -> Iterator[str]:
    """Make a network namespace whose loopback carries so many Mbit/s; give its name."""
    name = f"narrow{os.getpid()}"
    inside = ["ip", "netns", "exec", name]
    limit = ["tbf", "rate", f"{rate}mbit", "burst", "256kb", "latency", "400ms"]
    subprocess.run(["ip", "netns", "add", name], check=True)
    try:
        subprocess.run([*inside, "ip", "link", "set", "lo", "up"], check=True)
        subprocess.run([*inside, "tc", "qdisc", "add", "dev", "lo", "root", *limit], check=True)
        yield name
    finally:
        subprocess.run(["ip", "netns", "del", name], check=True)


def run(rate: float, count: int) -> float:
    """Return the seconds from the first record that arrives to the last."""
    with narrow(rate) as name, tempfile.TemporaryDirectory(prefix="nb") as folder:
        Path(folder, "graph.yaml").write_text(GRAPH.replace("COUNT", str(count)))
        Path(folder, "narrow_nodes.py").write_text(NODES)
        command = ["ip", "netns", "exec", name, sys.executable, "-m", "lodeflow.cli", "run"]
        sides = [
            ["--only", "near", "--listen", f"tcp/127.0.0.1:{PORT}"],
            ["--only", "far", "--connect", f"tcp/127.0.0.1:{PORT}"],
        ]
        processes = [
            subprocess.Popen(
                [*command, "graph.yaml", *side],
                cwd=folder,
                env={**os.environ, "XDG_RUNTIME_DIR": tempfile.mkdtemp(dir=folder)},
                stdout=subprocess.DEVNULL,
            )
            for side in sides
        ]
        codes = [process.wait() for process in processes]
        if codes != [0, 0] or Path(folder, "ended").read_text() != str(count):
            raise RuntimeError(f"exit codes {codes}")
        ends = [Path(folder, name).stat().st_mtime for name in ("begun", "ended")]
        return ends[1] - ends[0]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--rate", type=float, action="append", help="Mbit/s")
    parser.add_argument("--seconds", type=float, default=20.0, help="what the bytes alone take")
    options = parser.parse_args()
    print(time.strftime("%Y-%m-%d"), "bulk over a narrow network")
    for rate in options.rate or [10.0, 100.0]:
        count = int(rate * 1e6 / 8 * options.seconds / RECORD) // 1000 * 1000
        least = count * RECORD / (rate * 1e6 / 8)
        took = run(rate, count)
        size = count * RECORD / 1e6
        print(f"{rate:6g} Mbit/s  {size:6.1f} MB  {took:6.1f} s  {took / least:.2f} of its bytes")


if __name__ == "__main__":
    main()
