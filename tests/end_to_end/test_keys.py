"""Wires by Zenoh key: graphs that were launched apart, and programs that are none of ours."""

from __future__ import annotations

import json
import struct
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import split_toys
import zenoh
from command_line import CommandLine
from processes import free_port
from readers import records

MAKER = """\
lodeflow: 1
name: maker
nodes:
  device: {use: "toys:Device", params: {burst: 3}, keys: {out: robot/1/count}}
"""
READER = """\
lodeflow: 1
name: reader
nodes:
  total: {use: "toys:Total", inputs: {x: {key: "robot/*/count", max_delay: 0.3%s}}}
"""


@pytest.fixture
def toy(lodeflow: CommandLine) -> CommandLine:
    lodeflow.write("toys.py", split_toys.MODULE)
    lodeflow.write("maker.yaml", MAKER)
    lodeflow.write("reader.yaml", READER % "")
    return lodeflow


@pytest.fixture
def endpoint() -> str:
    return f"tcp/127.0.0.1:{free_port()}"


@pytest.fixture
def program(endpoint: str) -> Iterator[zenoh.Session]:
    """A Zenoh program that knows nothing of lodeflow."""
    config = zenoh.Config()
    config.insert_json5("listen/endpoints", json.dumps([endpoint]))
    config.insert_json5("scouting/multicast/enabled", "false")
    config.insert_json5("transport/shared_memory/enabled", "false")
    with zenoh.open(config) as session:
        yield session


def count(t: int, value: float) -> bytes:
    """Encode a Count as any ROS 2 program would: stamp, empty frame_id, value."""
    return b"\0\1\0\0" + struct.pack("<iII4xd", t // 10**9, t % 10**9, 1, value)


def values(path: Path, topic: str) -> list[tuple[int, float]]:
    return [
        (t, struct.unpack_from("<d", data, len(data) - 8)[0]) for t, data in records(path)[topic]
    ]


def test_two_graphs_launched_apart_connect(toy: CommandLine, endpoint: str) -> None:
    """Whoever starts first."""
    reader = toy.start("run", "reader.yaml", "--zenoh-connect", endpoint, "--duration", 2,
                       "--record", "reader.mcap", "--json")  # fmt: skip
    maker = toy.start("run", "maker.yaml", "--zenoh-listen", endpoint, "--no-record")
    output, errors = reader.communicate(timeout=60)
    assert reader.returncode == 0, errors
    told = json.loads(output)
    assert 1.0 < told["event_seconds"] <= 2.0
    maker.terminate()
    output, errors = maker.communicate(timeout=30)
    assert maker.returncode == 130, output + errors
    came = [value for _, value in values(toy.folder / "reader.mcap", "/total_x")]
    assert len(came) > 100
    assert came == [came[0] + n for n in range(len(came))]  # all of them, in order
    toy("replay", "reader.mcap", "--check")


def test_any_program_can_feed_a_graph(
    toy: CommandLine, program: zenoh.Session, endpoint: str
) -> None:
    """Publishers on one wildcard are merged by stamp; what does not decode is counted."""
    reader = toy.start("run", "reader.yaml", "--zenoh-connect", endpoint, "--duration", 3,
                       "--record", "reader.mcap", "--json")  # fmt: skip
    publishers = [program.declare_publisher(f"robot/{name}/count") for name in "ab"]
    until = time.monotonic() + 60
    while not publishers[0].matching_status.matching and time.monotonic() < until:
        time.sleep(0.01)
    program.put("robot/a/count", b"no CDR at all")
    sent: list[tuple[int, float]] = []
    number = 0
    while reader.poll() is None and time.monotonic() < until:
        t = time.time_ns()
        # The second has an older stamp than the first, but comes later.
        for publisher, stamp in zip(publishers, (t, t - 1_000_000), strict=True):
            publisher.put(count(stamp, float(number)))
            sent.append((stamp, float(number)))
            number += 1
        time.sleep(0.01)
    output, errors = reader.communicate(timeout=60)
    told: dict[str, Any] = json.loads(output)
    assert told["nodes"]["total_x"]["lost"] == {"undecodable": 1}
    assert reader.returncode == 1, errors
    came = values(toy.folder / "reader.mcap", "/total_x")
    first = next(i for i, one in enumerate(sorted(sent)) if one == came[0])
    assert came == sorted(sent)[first : first + len(came)]
    assert len(came) > 50
    toy("replay", "reader.mcap", "--check")


def test_what_comes_too_late_is_counted(
    toy: CommandLine, program: zenoh.Session, endpoint: str
) -> None:
    toy.write("reader.yaml", READER % ", allow: [late]")
    reader = toy.start("run", "reader.yaml", "--zenoh-connect", endpoint, "--duration", 1.5,
                       "--record", "reader.mcap", "--json")  # fmt: skip
    publisher = program.declare_publisher("robot/a/count")
    until = time.monotonic() + 60
    while not publisher.matching_status.matching and time.monotonic() < until:
        time.sleep(0.01)
    late = 0
    while reader.poll() is None and time.monotonic() < until:
        t = time.time_ns()
        publisher.put(count(t, 1.0))
        if late < 5 and (late := late + 1):
            publisher.put(count(t - 5 * 10**9, -1.0))
        time.sleep(0.01)
    output, errors = reader.communicate(timeout=60)
    told = json.loads(output)
    assert told["nodes"]["total_x"]["lost"]["late"] == 5, errors
    assert -1.0 not in [value for _, value in values(toy.folder / "reader.mcap", "/total_x")]
