"""A small graph of numpy alone, for tests of processes: it starts quickly, and stops anywhere."""

from __future__ import annotations

MODULE = '''\
import time
from collections.abc import Iterator
import numpy as np
import lodeflow as lf


class Count(lf.Message, ros="toys_msgs/msg/Count"):
    value: lf.Scalar[lf.Dimensionless]


class Ticks(lf.Source):
    """Counts at a rate, from t = 0."""

    class Params(lf.Params):
        rate: float = 200.0
        seconds: float = 3600.0

    def read(self, clock: lf.Clock) -> Iterator[Count]:
        step, total = int(1e9 / self.params.rate), int(self.params.seconds * self.params.rate)
        for first in range(0, total, 100):
            n = np.arange(first, min(first + 100, total), dtype=np.int64)
            yield Count(n * step, n.astype(float))


class Gain(lf.Node):
    class Params(lf.Params):
        gain: float = 2.0
        fail_at: float = float(2**60)
        sleep: float = 0.0

    def step_block(self, x: Count) -> Count:
        if self.params.sleep:
            time.sleep(self.params.sleep * len(x))
        if x.value[-1] >= self.params.fail_at:
            raise ValueError("broken on purpose")
        return Count(x.t, self.params.gain * x.value)


class Total(lf.Node):
    """The sum of all so far: a state that a restart loses."""

    def start(self) -> None:
        self.total = 0.0
        self.log.info("begins")

    def step(self, x: Count) -> Count:
        self.total += x.value
        return Count(x.t, self.total)


class Sum(lf.Node):
    sync = lf.Exact()

    def step(self, a: Count, b: Count) -> Count:
        return Count(a.t, a.value + b.value)


class Display(lf.Node):
    """Only watches, and takes its time."""

    class Params(lf.Params):
        sleep: float = 0.0

    def step(self, x: Count) -> None:
        time.sleep(self.params.sleep)


class Device(lf.Source):
    """A live device: counts in bursts, a thousand a second."""

    max_delay = 200_000_000  # the thread that reads it may wait for a busy machine

    class Params(lf.Params):
        burst: int = 1
        total: int = 2**60

    def read(self, clock: lf.Clock) -> Iterator[Count]:
        n = 0
        while n < self.params.total:
            time.sleep(0.001)
            now = clock.now()
            for i in range(self.params.burst):
                n += 1
                yield Count(now + i, float(n))
'''

GRAPH = """\
lodeflow: 1
name: toy
args: {rate: 200, seconds: 3600}
nodes:
  ticks: {use: "toys:Ticks", params: {rate: "${rate}", seconds: "${seconds}"}}
  double: {use: "toys:Gain", inputs: {x: ticks}}
  triple: {use: "toys:Gain", inputs: {x: ticks}, params: {gain: 3}}
  sum: {use: "toys:Sum", inputs: {a: double, b: triple}}
  total: {use: "toys:Total", inputs: {x: sum}}
processes: {source: [ticks], gains: [double, triple], ends: [sum, total]}
record: {to: out.mcap}
"""
