"""Graphs in several processes: the same bytes, failures that are told, and policies that hold."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import time
from typing import Any

import pytest
import split_toys
from command_line import CommandLine
from processes import children, free_port, gone, wait_for_recording
from readers import records

ALL = ("one", "graph", "split")
DISPLAY = """\
nodes:
  display: {use: "toys:Display", inputs: {x: total}, params: {sleep: 0.005}}
processes:
  display: {nodes: [display], latest: true}
"""

LATE = """\
import time
import lodeflow as lf
from toys import Count

class Late(lf.Node):
    class Params(lf.Params):
        seconds: float = 0.0

    def start(self) -> None:
        time.sleep(self.params.seconds)

    def step(self, x: Count) -> Count:
        return x
"""
HARD = """\
import signal
import time
import lodeflow as lf
from toys import Count

class Hard(lf.Node):
    def step(self, x: Count) -> Count:
        signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGTERM, signal.SIGALRM})
        time.sleep(60)
        return x
"""
CHAIN = """\
lodeflow: 1
name: chain
nodes:
  ticks: {use: "toys:Ticks"}
  first: {use: "toys:Total", inputs: {x: ticks}}
  second: {use: "toys:Total", inputs: {x: first}}
  third: {use: "toys:Total", inputs: {x: second}}
  last: {use: "late:Late", inputs: {x: third}}
"""


@pytest.fixture
def toy(lodeflow: CommandLine) -> CommandLine:
    lodeflow.write("toys.py", split_toys.MODULE)
    lodeflow.write("toy.yaml", split_toys.GRAPH)
    return lodeflow


def summary(text: str) -> dict[str, Any]:
    found: dict[str, Any] = json.loads(text)
    return found


def with_groups(toy: CommandLine, groups: str) -> None:
    toy.write("groups.yaml", f"processes: {groups}\n")


@pytest.mark.parametrize("pace", [(), ("--realtime", "--arg", "seconds=1")])
def test_one_some_or_many_processes_record_the_same(
    toy: CommandLine, pace: tuple[str, ...]
) -> None:
    counts = []
    for way in ALL:
        run = ("run", "toy.yaml", "--processes", way, "--record", f"{way}.mcap", "--json")
        told = summary(toy(*run, "--arg", "seconds=30", *pace).stdout)
        counts.append({name: told[name] for name in ("streams", "nodes", "event_seconds")})
    assert counts[0] == counts[1] == counts[2]
    for way in ALL[1:]:
        assert "the same" in toy("compare", "one.mcap", f"{way}.mcap").stdout
        toy("replay", f"{way}.mcap", "--check")


def test_the_recording_has_the_logs_and_the_summary_of_all_groups(toy: CommandLine) -> None:
    toy("run", "toy.yaml", "--arg", "seconds=1")
    told = toy("info", "out.mcap", "--json").stdout
    assert "rosout" in told
    assert "total" in told


@pytest.mark.parametrize("way", ["graph", "split"])
def test_who_only_watches_holds_nobody_up(toy: CommandLine, way: str) -> None:
    toy.write("display.yaml", DISPLAY)
    told = summary(toy("run", "toy.yaml", "--with", "display.yaml", "--processes", way, "--json",
                       "--realtime", "--arg", "rate=1000",
                       "--arg", "seconds=2").stdout)  # fmt: skip
    missed = told["links"]["ends" if way == "graph" else "total"]["display"]["missed"]
    seen = told["nodes"]["display"]["stepped"]
    assert told["streams"]["total"] == seen + missed == 2000
    assert missed > 0 < seen
    assert told["lossless"]
    toy("replay", "out.mcap", "--check")


def test_a_failing_node_is_told_with_its_group_and_ends_the_run(toy: CommandLine) -> None:
    done = toy("run", "toy.yaml", "--set", "double.fail_at=150", "--json", code=1)
    error = summary(done.stdout)["error"]
    assert error.startswith("group 'gains' failed: node 'double' (Gain.step_block) failed at t=")
    assert "ValueError: broken on purpose (toys.py:" in error
    toy("info", "out.mcap")


def test_the_others_go_on_where_the_graph_says_so(toy: CommandLine) -> None:
    with_groups(toy, "{source: [ticks], gains: {nodes: [double], on_crash: continue}, "
                     "rest: [triple], ends: [sum, total]}")  # fmt: skip
    done = toy("run", "toy.yaml", "--with", "groups.yaml", "--set", "double.fail_at=150",
               "--arg", "seconds=30", "--json", code=1)  # fmt: skip
    told = summary(done.stdout)
    assert told["streams"]["triple"] == 6000
    assert told["streams"]["sum"] == told["streams"]["double"] < 6000
    assert told["links"]["ends"]["gains"]["gaps"] == 1
    assert "the others go on" in done.stderr
    toy("info", "out.mcap")


def test_a_killed_group_is_started_again(toy: CommandLine) -> None:
    with_groups(toy, "{source: [ticks], gains: {nodes: [double, triple], restart: on-failure}, "
                     "ends: [sum, total]}")  # fmt: skip
    process = toy.start("run", "toy.yaml", "--with", "groups.yaml", "--realtime", "--json",
                        "--arg", "seconds=3")  # fmt: skip
    wait_for_recording(toy.folder / "out.mcap")
    time.sleep(0.7)
    victim = children(process.pid)[2]  # behind the janitor and the source
    os.kill(victim, signal.SIGKILL)
    output, errors = process.communicate(timeout=60)
    told = summary(output)
    assert process.returncode == 1, errors  # the run was not what it should have been
    assert told["restarts"] == {"gains": 1}
    assert "'gains' was ended by SIGKILL; starting it again, without its state" in errors
    assert told["links"]["ends"]["gains"]["restarts"] == 1
    assert told["error"] is None
    assert told["streams"]["ticks"] == 600
    # Nothing is missing behind it: what it had not taken came again, and Sum has no state.
    assert told["streams"]["sum"] == 600
    assert gone(process.pid)


@pytest.mark.parametrize("policy", ["restart: on-failure", "on_crash: continue"])
def test_a_crash_does_not_fail_the_run_where_the_graph_allows_it(
    toy: CommandLine, policy: str
) -> None:
    with_groups(toy, f"{{source: [ticks], gains: {{nodes: [double, triple], {policy}, "
                     "allow_gaps: true}, ends: [sum, total]}")  # fmt: skip
    process = toy.start("run", "toy.yaml", "--with", "groups.yaml", "--realtime", "--json",
                        "--arg", "seconds=3")  # fmt: skip
    wait_for_recording(toy.folder / "out.mcap")
    time.sleep(0.7)
    os.kill(children(process.pid)[2], signal.SIGKILL)  # behind the janitor and the source
    output, errors = process.communicate(timeout=60)
    assert process.returncode == 0, output + errors
    told = summary(output)
    assert told["lossless"]
    for reader in ("ends", "recorder"):  # counted all the same
        losses = told["links"][reader]["gains"]
        assert losses["gaps"] or losses["restarts"]
    assert "was ended by SIGKILL" in errors
    toy("replay", "out.mcap", "--check")


def test_no_source_begins_before_all_have_started(toy: CommandLine) -> None:
    """However far they are from each other, and without a recorder that knows them all."""
    toy.write("late.py", LATE)
    toy.write("chain.yaml", CHAIN)
    run = ("run", "chain.yaml", "--realtime", "--json", "--processes", "split")
    process = toy.start(*run, "--set", "last.seconds=60")
    time.sleep(4.0)
    process.send_signal(signal.SIGINT)
    output, errors = process.communicate(timeout=20)
    assert process.returncode == 130, output + errors
    assert set(summary(output)["streams"].values()) == {0}
    told = summary(toy(*run, "--duration", "0.5").stdout)
    assert set(told["streams"].values()) == {100}


def test_a_group_that_always_fails_is_given_up(toy: CommandLine) -> None:
    with_groups(toy, "{source: [ticks], gains: {nodes: [double, triple], restart: on-failure, "
                     "limit: 2}, ends: [sum, total]}")  # fmt: skip
    done = toy("run", "toy.yaml", "--with", "groups.yaml", "--set", "double.fail_at=0", "--json",
               code=1)  # fmt: skip
    told = summary(done.stdout)
    assert told["restarts"] == {"gains": 2}
    assert "it was started again 2 times" in told["error"]


def test_a_slow_reader_holds_the_sources_back(toy: CommandLine) -> None:
    """Nothing is dropped between nodes, and nobody keeps more than a window."""
    done = toy("run", "toy.yaml", "--set", "double.sleep=0.0001", "--arg", "seconds=60", "--json")
    told = summary(done.stdout)
    assert told["streams"]["total"] == 12000
    assert told["lossless"]


def test_a_slow_reader_makes_a_live_device_overflow_and_that_is_counted(toy: CommandLine) -> None:
    toy.write("live.yaml", split_toys.GRAPH.replace(
        '{use: "toys:Ticks", params: {rate: "${rate}", seconds: "${seconds}"}}',
        '{use: "toys:Device", params: {burst: 20}}').replace(
        "args: {rate: 200, seconds: 3600}\n", ""))  # fmt: skip
    process = toy.start("run", "live.yaml", "--set", "double.sleep=0.01", "--json")  # fmt: skip
    wait_for_recording(toy.folder / "out.mcap")
    lost: dict[str, int] = {}
    until = time.monotonic() + 60
    while lost.get("overflow", 0) <= 1000 and time.monotonic() < until:
        lost = summary(toy("top", "toy", "--once", "--json").stdout)["nodes"]["ticks"]["lost"]
    process.send_signal(signal.SIGINT)
    output, errors = process.communicate(timeout=30)
    told = summary(output)
    lost = told["nodes"]["ticks"]["lost"]
    assert process.returncode == 1, errors
    assert set(lost) <= {"overflow", "late"}  # late on a busy machine
    assert lost["overflow"] > 1000


@pytest.mark.parametrize("other", [("--no-record",), ("--duration", "3"), ("--arg", "rate=100")])
def test_hosts_with_other_options_refuse_each_other(
    toy: CommandLine, other: tuple[str, ...]
) -> None:
    port = free_port()
    here = toy.start("run", "toy.yaml", "--only", "ends,recorder", "--listen",
                     f"ends=tcp/127.0.0.1:{port}")  # fmt: skip
    there = toy.start("run", "toy.yaml", "--only", "source,gains", "--connect",
                      f"tcp/127.0.0.1:{port}", *other)  # fmt: skip
    for process in (here, there):
        _, errors = process.communicate(timeout=30)
        assert process.returncode == 1
        assert "start all groups with the same file and options (--arg, --set, --swap," in errors


def two_hosts(toy: CommandLine, *options: str) -> dict[str, subprocess.Popen[str]]:
    """Start the graph: on the first host what reads and records, on the second what sends."""
    ports = [free_port(), free_port()]
    run = ("run", "toy.yaml", "--realtime", "--record", "hosts.mcap", "--json", *options)
    started = {
        "here": toy.start(
            *(*run, "--only", "ends,recorder", "--listen", f"ends=tcp/127.0.0.1:{ports[0]}"),
            *("--listen", f"recorder=tcp/127.0.0.1:{ports[1]}"),
        ),
        "there": toy.start(
            *(*run, "--only", "source,gains", "--connect", f"tcp/127.0.0.1:{ports[0]}"),
            *("--connect", f"tcp/127.0.0.1:{ports[1]}"),
        ),
    }
    wait_for_recording(toy.folder / "hosts.mcap")
    time.sleep(0.5)
    return started


@pytest.mark.parametrize("stopped", ["here", "there"])
def test_ctrl_c_on_one_host_ends_the_other_too(toy: CommandLine, stopped: str) -> None:
    """And all that the sources have sent by then arrives."""
    hosts = two_hosts(toy)
    hosts[stopped].send_signal(signal.SIGINT)
    said = {name: process.communicate(timeout=20) for name, process in hosts.items()}
    assert hosts[stopped].returncode == 130, said[stopped]
    sent = json.loads(said["there"][0])["streams"]
    assert sent["ticks"] == sent["double"] > 0
    there = {f"/{name}": count for name, count in sent.items()}
    kept = {topic: len(rows) for topic, rows in records(toy.folder / "hosts.mcap").items()}
    assert there.items() <= kept.items()
    assert kept["/total"] == sent["ticks"]


def test_who_is_interrupted_leaves_nobody_waiting(toy: CommandLine) -> None:
    """A node that does not come back: its streams have no end, and the other host hears so."""
    hosts = two_hosts(toy, "--set", "double.sleep=30")
    hosts["there"].send_signal(signal.SIGINT)
    said = {name: process.communicate(timeout=20) for name, process in hosts.items()}
    told = summary(said["here"][0])
    assert hosts["here"].returncode == 1, said["here"]
    assert not told["lossless"]
    assert told["links"]["ends"]["gains"]["gaps"] == 2
    toy("info", "hosts.mcap")


def test_what_only_the_recorder_misses_fails_its_run(toy: CommandLine) -> None:
    with_groups(toy, "{source: [ticks], gains: [double, triple], "
                     "ends: {nodes: [sum, total], on_crash: continue}}")  # fmt: skip
    port = free_port()
    run = ("run", "toy.yaml", "--with", "groups.yaml", "--realtime", "--json")
    run = (*run, "--record", "hosts.mcap", "--arg", "seconds=3")
    here = toy.start(*run, "--only", "recorder", "--listen", f"tcp/127.0.0.1:{port}")
    there = toy.start(*run, "--only", "source,gains,ends", "--connect", f"tcp/127.0.0.1:{port}")
    wait_for_recording(toy.folder / "hosts.mcap")
    time.sleep(0.5)
    os.kill(children(there.pid)[3], signal.SIGKILL)  # behind the janitor, the source and the gains
    there.communicate(timeout=60)
    output, errors = here.communicate(timeout=60)
    told = summary(output)
    assert here.returncode == 1, output + errors
    assert not told["lossless"]
    assert told["links"]["recorder"]["ends"]["gaps"] == 2
    kept = {topic: len(rows) for topic, rows in records(toy.folder / "hosts.mcap").items()}
    assert kept["/double"] == 600 > kept["/sum"] > 0


def test_a_node_that_is_interrupted_takes_no_other_group_with_it(toy: CommandLine) -> None:
    """Who waits for it is given what it has left, and ends in order."""
    with_groups(toy, "{source: [ticks], gains: [double, triple], ends: [sum], last: [total]}")
    process = toy.start("run", "toy.yaml", "--with", "groups.yaml", "--realtime", "--json",
                        "--set", "double.sleep=30")  # fmt: skip
    wait_for_recording(toy.folder / "out.mcap")
    time.sleep(0.7)
    process.send_signal(signal.SIGINT)
    output, errors = process.communicate(timeout=20)
    assert process.returncode == 1, output + errors
    assert "node 'double' (Gain.step_block) did not end when it was to stop" in errors
    links = summary(output)["links"]
    assert {reader: set(peers) for reader, peers in links.items()} == {
        "ends": {"gains"},
        "recorder": {"gains"},
    }
    missing = summary(toy("info", "out.mcap", "--json").stdout)["missing"]
    assert {(gap["stream"], gap["reader"]) for gap in missing} == {
        (stream, reader) for stream in ("double", "triple") for reader in ("ends", "recorder")
    }
    toy("replay", "out.mcap", "--check", "--set", "double.sleep=0")


def test_a_node_that_cannot_be_interrupted_is_killed(toy: CommandLine) -> None:
    """Its group alone is named, and the recording is closed by then."""
    toy.write("hard.py", HARD)
    toy.write("hard.yaml", CHAIN.replace("late:Late", "hard:Hard"))
    process = toy.start("run", "hard.yaml", "--realtime", "--json", "--processes", "split",
                        "--record", "out.mcap")  # fmt: skip
    wait_for_recording(toy.folder / "out.mcap")
    process.send_signal(signal.SIGINT)
    output, errors = process.communicate(timeout=20)
    assert process.returncode == 1, output + errors
    assert summary(output)["error"] == "group 'last' was ended by SIGKILL"
    missing = summary(toy("info", "out.mcap", "--json").stdout)["missing"]
    assert [(gap["stream"], gap["reader"]) for gap in missing] == [("last", "recorder")]


@pytest.mark.parametrize("policy", ["stop", "continue"])
def test_other_hosts_are_told_of_a_group_that_is_given_up(toy: CommandLine, policy: str) -> None:
    """It has been killed, and cannot say so itself."""
    with_groups(toy, "{source: [ticks], gains: {nodes: [double, triple], restart: on-failure, "
                     f"limit: 1, on_crash: {policy}}}, ends: [sum, total]}}")  # fmt: skip
    hosts = two_hosts(toy, "--with", "groups.yaml", "--arg", "seconds=4")
    for _ in range(2):
        victim = children(hosts["there"].pid)[-1]  # behind the source, or started anew
        os.kill(victim, signal.SIGKILL)
        time.sleep(0.7)
    said = {name: process.communicate(timeout=20) for name, process in hosts.items()}
    there, here = summary(said["there"][0]), summary(said["here"][0])
    assert [process.returncode for process in hosts.values()] == [1, 1], said
    assert there["restarts"] == {"gains": 1}
    assert here["links"]["ends"]["gains"]["gaps"] >= 2
    assert 0 < here["streams"]["sum"] < 800
    kept = {topic: len(rows) for topic, rows in records(toy.folder / "hosts.mcap").items()}
    assert (kept["/ticks"] == 800) == (policy == "continue")


def test_unknown_groups_and_ambiguous_endpoints_are_told(toy: CommandLine) -> None:
    done = toy("run", "toy.yaml", "--only", "gain", code=1)
    assert done.stderr == ("lodeflow: no group 'gain' in graph 'toy', did you mean 'gains'?\n")
    done = toy("run", "toy.yaml", "--listen", "tcp/127.0.0.1:0", code=2)
    assert "several groups run here; say whose it is: GROUP=tcp/127.0.0.1:0" in done.stderr
