"""Looking into running graphs: every command, at any time, in one process and in one per node."""

from __future__ import annotations

import json
import os
import re
import shutil
import signal
import socket
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import pytest
import split_toys
import zenoh
from command_line import CommandLine
from processes import gone

from lodeflow.transport.onlooker import Onlooker
from lodeflow.transport.session import open_session
from lodeflow.transport.viewing import StreamView

DOCS = Path(__file__).parents[2] / "docs"
STEP = 5_000_000
"""Nanoseconds between two messages of the toy graph."""


@pytest.fixture
def toy(lodeflow: CommandLine) -> CommandLine:
    lodeflow.write("toys.py", split_toys.MODULE)
    lodeflow.write("toy.yaml", split_toys.GRAPH)
    return lodeflow


def run_dirs(toy: CommandLine) -> list[Path]:
    return sorted(Path(toy.environment["XDG_RUNTIME_DIR"], "lodeflow").glob("toy-*/run.json"))


def start(
    toy: CommandLine, way: str, *arguments: object, pace: tuple[str, ...] = ("--realtime",)
) -> subprocess.Popen[str]:
    """Start the toy graph, and wait until it can be found."""
    process = toy.start("run", "toy.yaml", "--processes", way, *pace, "--json", *arguments)
    until = time.monotonic() + 60
    while not any(str(process.pid) in str(path) for path in run_dirs(toy)):
        assert process.poll() is None, process.communicate()
        assert time.monotonic() < until
        time.sleep(0.01)
    return process


def endpoints(toy: CommandLine) -> list[str]:
    (path,) = run_dirs(toy)
    count = len(json.loads(path.read_text())["groups"])
    return [f"unixsock-stream/{path.parent}/w{index}" for index in range(count)]


def parsed(text: str) -> Any:
    return json.loads(text)


NODES = ["ticks", "double", "triple", "sum", "total"]


def test_every_command_of_one_process_for_people(toy: CommandLine) -> None:
    process = start(toy, "one")
    text = toy("echo", "ticks", "-n", 2).stdout
    assert re.fullmatch(r"(ticks  \d+\.\d{9}  value=[\d.e+]+\n){2}", text)
    by_key = toy("echo", "lodeflow/toy/*/out", "-n", 10).stdout.splitlines()
    assert len({line.split()[0] for line in by_key}) > 1
    listing = toy("ls", "-l").stdout
    assert re.search(rf"toy +{process.pid} +5 +.* s +main", listing)
    assert re.search(r"sum +toys_msgs/msg/Count +[0-9.]+ Hz +main", listing)
    assert re.search(r"ticks +\d+ +.* Hz +200 Hz", toy("hz", "--once").stdout)
    table = toy("top", "--once").stdout
    assert re.search(r"main +\d+ +[\d.]+% +\d+ MiB", table)
    assert re.search(r"ticks +total +[\d.]+ (µs|ms) +[\d.]+ (µs|ms)", table)
    drawing = toy("graph", "--live").stdout
    assert re.search(r"out     Count  recorded  \d+(\.\d+)? Hz", drawing)
    assert "stopped 'toy'" in toy("stop").stderr
    output, errors = process.communicate(timeout=20)
    assert process.returncode == 130, errors
    assert parsed(output)["lossless"]


def test_every_command_of_one_process_per_node_for_programs(toy: CommandLine) -> None:
    process = start(toy, "split")
    groups = [*NODES, "recorder"]

    lines = [json.loads(x) for x in toy("echo", "toy/sum", "-n", 20, "--json").stdout.splitlines()]
    stamps = [line["t"] for line in lines]
    assert stamps == list(range(stamps[0], stamps[0] + 20 * STEP, STEP))
    for line in lines:
        assert line["stream"] == "sum"
        assert line["fields"] == {"value": {"value": 5 * line["t"] / STEP, "unit": ""}}

    (found,) = parsed(toy("ls", "--json").stdout)
    assert (found["graph"], found["pid"]) == ("toy", process.pid)
    assert list(found["processes"]) == groups
    (found,) = parsed(toy("ls", "toy", "--json").stdout)
    assert [stream["name"] for stream in found["streams"]] == NODES
    assert {stream["type"] for stream in found["streams"]} == {"toys_msgs/msg/Count"}
    assert found["streams"][0]["rate"] == pytest.approx(200, rel=0.05)
    assert found["silent"] == []

    pulses = parsed(toy("hz", "sum", "ticks", "--once", "--window", "0.5", "--json").stdout)
    assert list(pulses["streams"]) == ["sum", "ticks"]
    assert pulses["streams"]["sum"]["messages"] > 1
    assert pulses["streams"]["sum"]["stamp_rate"] == pytest.approx(200)
    assert pulses["streams"]["sum"]["missed"] == 0

    vitals = parsed(toy("top", "--once", "--json").stdout)
    assert list(vitals["nodes"]) == NODES
    assert list(vitals["processes"]) == groups
    assert vitals["paced"]
    assert all(node["sent"][name] > 0 for name, node in vitals["nodes"].items())
    assert all(it["memory"] > 2**20 and it["cpu"] >= 0 for it in vitals["processes"].values())
    (path,) = vitals["paths"]
    assert (path["source"], path["end"]) == ("ticks", "total")
    assert path["count"] > 10
    assert 0 < path["p50"] <= path["p99"]
    assert vitals["silent"] == []

    assert " Hz" in toy("graph", "--live", "toy", "--format", "mermaid").stdout
    assert "stopped 'toy'" in toy("stop").stderr
    output, errors = process.communicate(timeout=20)
    assert process.returncode == 130, errors
    told = parsed(output)
    assert told["lossless"]
    assert told["stopped"]
    assert "losses: none" in toy("info", told["recording"]).stdout


def test_ctrl_c_ends_an_echo_and_not_the_run(toy: CommandLine) -> None:
    process = start(toy, "one")
    echo = toy.start("echo", "total")
    assert first_line(echo).startswith("total  ")
    echo.send_signal(signal.SIGINT)
    _, errors = echo.communicate(timeout=20)
    assert echo.returncode == 130
    assert errors.strip() == ""
    assert process.poll() is None


def test_who_reads_no_further_ends_an_echo(toy: CommandLine) -> None:
    start(toy, "one")
    echo = toy.start("echo", "total")
    assert first_line(echo).startswith("total  ")
    assert echo.stdout is not None
    echo.stdout.close()
    assert echo.wait(timeout=20) == 0
    assert echo.stderr is not None
    assert echo.stderr.read() == ""


def first_line(process: subprocess.Popen[str]) -> str:
    assert process.stdout is not None
    line = process.stdout.readline()
    assert line, process.communicate()
    return line


def stop(process: subprocess.Popen[str]) -> dict[str, Any]:
    """End a run by Ctrl-C; return its summary."""
    process.send_signal(signal.SIGINT)
    output, errors = process.communicate(timeout=60)
    assert process.returncode == 130, errors
    assert "Traceback" not in errors
    found: dict[str, Any] = json.loads(output)
    return found


@pytest.mark.parametrize("how", ["end", "kill"])
def test_an_echo_ends_with_the_run(toy: CommandLine, how: str) -> None:
    process = start(toy, "one")
    echo = toy.start("echo", "total", "--json")
    first = first_line(echo)
    assert json.loads(first)["stream"] == "total"
    if how == "kill":
        process.kill()
    else:
        told = stop(process)
    assert echo.stdout is not None
    assert echo.stderr is not None
    lines = [first, *echo.stdout]  # what the first read has buffered counts too
    assert echo.stderr.read() == "total: the run has ended\n"
    assert echo.wait(timeout=30) == 0
    if how == "end":
        assert json.loads(lines[-1])["t"] == (told["streams"]["total"] - 1) * STEP


@pytest.mark.parametrize("way", ["one", "split"])
def test_a_frozen_onlooker_holds_nobody_up(toy: CommandLine, way: str) -> None:
    process = start(toy, way, "--arg", "rate=1000")
    echo = toy.start("echo", "lodeflow/toy/**")
    first_line(echo)
    echo.send_signal(signal.SIGSTOP)
    other, view = Onlooker(endpoints(toy)), StreamView("lodeflow/toy/total/out")
    other.watch(view.key)
    while view.rows < 3000:  # beyond what the sockets to the frozen one hold
        for sighting in other.take(1.0):
            view.see(sighting)
    other.close()
    told = stop(process)
    assert told["lossless"]
    assert set(told["streams"].values()) == {told["streams"]["ticks"]}
    echo.send_signal(signal.SIGCONT)
    _, errors = echo.communicate(timeout=60)
    assert echo.returncode == 0, errors


@pytest.mark.parametrize("way", ["one", "split"])
def test_garbage_on_its_keys_does_a_run_no_harm(toy: CommandLine, way: str) -> None:
    process, meeting = start(toy, way), f"tcp/127.0.0.1:{free_port()}"
    stranger = open_session(connect=endpoints(toy), listen=[meeting])
    echo = toy.start("echo", "sum", *connected(toy), "--connect", meeting)
    first_line(echo)
    for _ in range(10):
        for data in (b"", b"\0" * 32, b"\xff" * 500, b'{"ask": "change", "sets": 3}'):
            for key in ("lodeflow/toy/sum/out", "lodeflow/toy/none/at/all"):
                stranger.put(key, data, attachment=data[:32], encoding="application/cdr;x")
            for group in ("main", "sum", "recorder"):
                stranger.put(f"@lodeflow/toy/control/{group}", data)
                stranger.put(f"@lodeflow/toy/to/{group}/ticks", data, attachment=bytes(32))
                stranger.put(f"@lodeflow/toy/to/{group}/ticks", data)
            replies = list(stranger.get("@lodeflow/toy/control/*", payload=data, timeout=5.0))
            assert all(b"error" in reply.ok.payload.to_bytes() for reply in replies)
    stranger.close()  # type: ignore[no-untyped-call]
    told = stop(process)
    assert told["lossless"]
    assert set(told["streams"].values()) == {told["streams"]["ticks"]}
    shown, _ = echo.communicate(timeout=60)
    assert all(line.startswith("sum  ") for line in shown.splitlines())


def connected(toy: CommandLine) -> list[str]:
    return [text for endpoint in endpoints(toy) for text in ("--connect", endpoint)]


def free_port() -> int:
    with socket.socket() as found:
        found.bind(("127.0.0.1", 0))
        port: int = found.getsockname()[1]
        return port


def test_a_run_on_another_host_is_looked_into_by_its_endpoint(toy: CommandLine) -> None:
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    process = start(toy, "one", "--zenoh-listen", endpoint)
    shutil.move(run_dirs(toy)[0], toy.folder / "hidden.json")  # as if it were not on this host
    assert "no graph is running here" in toy("echo", "sum", code=1).stderr
    there = ("--connect", endpoint)
    assert toy("echo", "toy/sum", "-n", 3, *there).stdout.count("sum  ") == 3
    (found,) = parsed(toy("ls", "--json", *there).stdout)
    assert (found["graph"], found["pid"]) == ("toy", None)
    assert parsed(toy("top", "--once", "--json", *there).stdout)["nodes"]["sum"]["stepped"] > 0
    toy("stop", "toy", *there)
    assert gone(process.pid)


def test_names_that_are_none_are_told(toy: CommandLine) -> None:
    assert toy("ls").stderr == "no graph is running here\n"
    for command in (["echo", "sum"], ["graph", "--live"]):
        told = toy(*command, code=1).stderr
        assert told.startswith("lodeflow: no graph is running here; 'lodeflow run' starts one")
    start(toy, "one")
    assert "did you mean 'total'?" in toy("echo", "totl", code=1).stderr
    assert "no graph 'tyo' is running, did you mean 'toy'?" in toy("stop", "tyo", code=1).stderr
    assert "no key expression" in toy("echo", "lodeflow/toy/**/**", code=1).stderr
    assert "--connect" in toy("echo", "robot/1/mag", code=1).stderr
    start(toy, "one", "--no-record")
    assert re.search(r"several graphs run: toy@\d+, toy@\d+; name", toy("top", code=1).stderr)
    name = f"toy@{toy.started[0].pid}"
    assert toy("echo", f"{name}/sum", "-n", 1).stdout.startswith("sum  ")
    toy("stop", name)
    assert gone(toy.started[0].pid)
    assert toy.started[1].poll() is None


def test_a_node_that_does_not_come_back_is_stopped(toy: CommandLine) -> None:
    process = start(toy, "one", "--set", "double.sleep=3600")
    toy("ls", "-l")
    assert "stopped 'toy'" in toy("stop").stderr
    assert gone(process.pid)


def test_a_run_without_pace_has_no_latencies(toy: CommandLine) -> None:
    start(toy, "one", "--arg", "seconds=1000000", "--no-record", pace=())
    vitals = parsed(toy("top", "--once", "--json").stdout)
    assert not vitals["paced"]
    assert vitals["paths"] == []
    assert vitals["nodes"]["sum"]["sent"]["sum"] > 0
    (line, *_) = toy("echo", "sum", "-n", 5, "--json").stdout.splitlines()
    assert json.loads(line)["stream"] == "sum"


def test_another_program_decodes_a_stream_without_lodeflow(toy: CommandLine) -> None:
    page = (DOCS / "live.md").read_text()
    (program,) = re.findall(r"```python\n(import struct.*?)```", page, flags=re.S)
    assert len(program.strip().splitlines()) <= 12
    assert "lodeflow" not in re.sub(r'"lodeflow/[^"]*"', "", program)
    toy.write("listen.py", program.replace("lodeflow/heading/heading/out", "lodeflow/toy/sum/out"))
    start(toy, "one")
    where = toy("ls", "--endpoints").stdout.split()
    listener = subprocess.Popen(
        [sys.executable, "listen.py", *where],
        cwd=toy.folder,
        env={**os.environ, "PYTHONUNBUFFERED": "1"},
        stdout=subprocess.PIPE,
        text=True,
    )
    toy.started.append(listener)
    for _ in range(5):
        seconds, value = map(float, first_line(listener).split())
        assert value == pytest.approx(5 * round(seconds * 200))


def test_zenoh_itself_sees_the_type_of_a_stream(toy: CommandLine) -> None:
    start(toy, "one")
    session = open_session(connect=endpoints(toy))
    subscriber = session.declare_subscriber("lodeflow/toy/sum/out", zenoh.handlers.RingChannel(9))
    sample = subscriber.recv()
    session.close()  # type: ignore[no-untyped-call]
    assert str(sample.encoding) == "application/cdr;toys_msgs/msg/Count"
    assert len(sample.attachment.to_bytes()) == 32
