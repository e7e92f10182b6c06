"""A graph on two hosts with a cable between them, which is cut and mended."""

from __future__ import annotations

import json
import signal
import subprocess
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import split_toys
from command_line import CommandLine
from namespaces import Hosts, why_not
from readers import records

NOT_HERE = why_not()
pytestmark = pytest.mark.skipif(NOT_HERE is not None, reason=str(NOT_HERE))

LIVE = split_toys.GRAPH.replace("name: toy", "name: live").replace(
    '{use: "toys:Ticks", params: {rate: "${rate}", seconds: "${seconds}"}}',
    '{use: "toys:Device", params: {burst: "${burst}", total: "${total}"}}',
).replace("args: {rate: 200, seconds: 3600}", "args: {burst: 1, total: 1000000000}")  # fmt: skip
HERE = ("--only", "ends,recorder")
THERE = ("--only", "source,gains")


@pytest.fixture
def hosts() -> Iterator[Hosts]:
    with Hosts() as made:
        yield made


@pytest.fixture
def toy(lodeflow: CommandLine) -> CommandLine:
    lodeflow.write("toys.py", split_toys.MODULE)
    lodeflow.write("toy.yaml", split_toys.GRAPH)
    lodeflow.write("live.yaml", LIVE)
    return lodeflow


class Spread:
    """A run on two hosts: the sources on the second, the recorder on the first."""

    def __init__(self, toy: CommandLine, hosts: Hosts, *words: str, port: int = 7447) -> None:
        self._toy, self._hosts = toy, hosts
        self._words = ("run", *words, "--json")
        self._ends = [f"tcp/{hosts.addresses[0]}:{port + index}" for index in (0, 1)]

    def first(self) -> subprocess.Popen[str]:
        """Start the groups that end on the first host."""
        listen = [f"--listen={name}={end}" for name, end in zip(("ends", "recorder"), self._ends,
                                                                strict=True)]  # fmt: skip
        return self._toy.start(*self._words, *HERE, *listen, before=self._hosts.on(0))

    def second(self) -> subprocess.Popen[str]:
        """Start the sources on the second host."""
        connect = [f"--connect={end}" for end in self._ends]
        return self._toy.start(*self._words, *THERE, *connect, before=self._hosts.on(1))


def told(process: subprocess.Popen[str], code: int = 0) -> dict[str, Any]:
    """Wait for the end of a run; return its summary."""
    output, errors = process.communicate(timeout=60)
    assert process.returncode == code, errors
    found: dict[str, Any] = json.loads(output)
    return found


def wait_for_growth(path: Path, size: int = 0) -> None:
    until = time.monotonic() + 60
    while not path.exists() or path.stat().st_size <= size:
        assert time.monotonic() < until, f"{path} does not grow"
        time.sleep(0.02)


def counts(path: Path) -> Any:
    """Return the values of the device's stream in a recording: 1, 2, 3, ... if none is missing."""
    payloads = b"".join(payload[-8:] for _, payload in records(path)["/ticks"])
    return np.frombuffer(payloads, dtype="<f8")


@pytest.mark.parametrize("order", ["first", "second"])
def test_hosts_start_in_any_order(toy: CommandLine, hosts: Hosts, order: str) -> None:
    toy("run", "toy.yaml", "--processes", "one", "--arg", "seconds=5", "--record", "one.mcap")
    spread = Spread(toy, hosts, "toy.yaml", "--arg", "seconds=5", "--record", "hosts.mcap")
    starts = [spread.first, spread.second]
    if order == "second":
        starts.reverse()
    one = starts[0]()
    time.sleep(1.5)
    assert one.poll() is None
    other = starts[1]()
    told(one)
    told(other)
    assert "the same" in toy("compare", "one.mcap", "hosts.mcap").stdout


def test_a_cable_cut_for_five_seconds_loses_nothing(toy: CommandLine, hosts: Hosts) -> None:
    """Neither of data at rest, which waits, nor of a device at 1 kHz, which its inbox holds."""
    args = ("--arg", "seconds=3", "--arg", "rate=500")
    toy("run", "toy.yaml", "--processes", "one", *args, "--record", "one.mcap")
    rest = Spread(toy, hosts, "toy.yaml", *args, "--realtime", "--record", "rest.mcap")
    live = Spread(toy, hosts, "live.yaml", "--record", "live.mcap", port=7457)
    runs = [rest.first(), live.first(), rest.second(), live.second()]
    for name in ("rest.mcap", "live.mcap"):
        wait_for_growth(toy.folder / name, 6000)
    hosts.cut()
    time.sleep(5.0)
    size = (toy.folder / "live.mcap").stat().st_size
    hosts.mend()
    wait_for_growth(toy.folder / "live.mcap", size)
    for run in (runs[0], runs[2]):
        assert told(run)["lossless"]
    assert "the same" in toy("compare", "one.mcap", "rest.mcap").stdout
    runs[3].send_signal(signal.SIGINT)
    there = told(runs[3], 130)
    assert there["lossless"]
    assert told(runs[1])["lossless"]
    n = counts(toy.folder / "live.mcap")
    assert there["event_seconds"] > 5.0
    assert len(n) == there["streams"]["ticks"]
    assert (np.diff(n) == 1).all()


def test_a_cut_beyond_what_a_device_can_hold_is_counted(toy: CommandLine, hosts: Hosts) -> None:
    words = ("--arg", "burst=40", "--arg", "total=80000", "--record", "live.mcap")
    live = Spread(toy, hosts, "live.yaml", *words)
    here, there = live.first(), live.second()
    path = toy.folder / "live.mcap"
    wait_for_growth(path, 6000)
    hosts.cut()
    time.sleep(2.0)
    hosts.mend()
    summary = told(there, 1)
    told(here)
    n = counts(path)
    lost = summary["nodes"]["ticks"]["lost"]
    assert lost["overflow"] > 1000
    assert len(n) == summary["streams"]["ticks"] == 80_000 - sum(lost.values())
    assert (np.diff(n) > 0).all()
