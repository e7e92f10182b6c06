"""`lodeflow run`: a real graph, a real recording, other people's readers."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from command_line import CommandLine
from mcap.reader import make_reader
from readers import records
from rosbags.highlevel import AnyReader

from lodeflow.graph import load_graph
from lodeflow.messages.cdr import layout_of
from lodeflow.messages.message import by_ros_name
from lodeflow.runtime.engine import Engine
from lodeflow.runtime.plan import Plan


def streams(graph: Path, **overrides: Any) -> dict[str, Any]:
    """Run a graph in this process and return the block of every stream."""
    plan = Plan(load_graph(graph, **overrides))
    blocks: dict[str, list[Any]] = {}
    for wire in plan.taps:
        plan.tap(wire, blocks.setdefault(f"/{wire}".replace(".", "/"), []).append)
    Engine(plan).run()
    return {topic: type(b[0]).concat(b) for topic, b in blocks.items() if b}


@pytest.fixture
def recorded(lodeflow: CommandLine, graphs: Path) -> tuple[Path, dict[str, Any]]:
    done = lodeflow("run", graphs / "heading.yaml", "--arg", "duration=20", "--json")
    summary = json.loads(done.stdout)
    return lodeflow.folder / summary["recording"], summary


def test_every_message_of_the_recording_has_the_values_of_the_run(
    recorded: tuple[Path, dict[str, Any]], graphs: Path
) -> None:
    path, summary = recorded
    expected = streams(graphs / "heading.yaml", args=["duration=20"])
    found = records(path)
    assert found.keys() == expected.keys()
    for topic, block in expected.items():
        stamps, payloads = zip(*found[topic], strict=True)
        assert list(stamps) == block.t.tolist()
        layout = layout_of(type(block))
        encoded = layout.encode_block(block)
        assert list(payloads) == [row.tobytes() for row in encoded]
        assert layout.decode_block(encoded) == block
        name = topic[1:].replace("/", ".")
        assert summary["streams"][name] == len(block)


def test_rosbags_decodes_every_message(recorded: tuple[Path, dict[str, Any]], graphs: Path) -> None:
    path, _ = recorded
    expected = streams(graphs / "heading.yaml", args=["duration=20"])
    rows = dict.fromkeys(expected, 0)
    with AnyReader([path]) as reader:
        for connection, t, data in reader.messages():
            message = reader.deserialize(data, connection.msgtype)
            row = rows[connection.topic]
            sample = expected[connection.topic].row(row)
            rows[connection.topic] += 1
            assert by_ros_name[connection.msgtype] is type(sample)
            assert t == sample.t
            assert message.header.stamp.sec * 10**9 + message.header.stamp.nanosec == t
            for field, value in zip(sample.fields, sample.values(), strict=True):
                theirs = getattr(message, field.name)
                if hasattr(theirs, "x"):
                    parts = ("x", "y", "z", "w")[: field.size]
                    theirs = [getattr(theirs, part) for part in parts]
                assert np.array_equal(np.ravel(theirs), np.ravel(value), equal_nan=True)
    assert rows == {topic: len(block) for topic, block in expected.items()}


def test_the_recording_alone_is_enough_to_run_again(
    recorded: tuple[Path, dict[str, Any]], lodeflow: CommandLine
) -> None:
    path, _ = recorded
    with path.open("rb") as file:
        reader = make_reader(file)
        assert reader.get_header().profile == "ros2"
        (attachment,) = reader.iter_attachments()
        provenance = {m.name: m.metadata for m in reader.iter_metadata()}["lodeflow.provenance"]
    assert json.loads(provenance["args"]) == {"seed": 0, "duration": 20}
    assert "numpy" in json.loads(provenance["versions"])
    again = lodeflow.write("again.yaml", attachment.data.decode())
    lodeflow("run", again, "--record", "again.mcap")
    assert records(lodeflow.folder / "again.mcap") == records(path)


def test_pacing_and_duration_do_not_change_the_bytes(lodeflow: CommandLine, graphs: Path) -> None:
    graph = graphs / "heading.yaml"
    lodeflow("run", graph, "--duration", 1.5, "--record", "fast.mcap")
    lodeflow("run", graph, "--duration", 1.5, "--record", "paced.mcap", "--realtime")
    fast = records(lodeflow.folder / "fast.mcap")
    assert len(fast["/fuser"]) == 150
    assert records(lodeflow.folder / "paced.mcap") == fast


def test_the_summary_shows_streams_scores_and_the_recording(
    lodeflow: CommandLine, graphs: Path
) -> None:
    done = lodeflow("run", graphs / "heading.yaml")
    assert "score: heading rmse" in done.stdout
    assert "score: heading max" in done.stdout
    assert "recorded to recordings/heading-" in done.stdout
    assert len(list((lodeflow.folder / "recordings").glob("heading-*.mcap"))) == 1


def test_no_record_writes_nothing(lodeflow: CommandLine, graphs: Path) -> None:
    done = lodeflow("run", graphs / "heading.yaml", "--duration", 1, "--no-record", "--json")
    assert json.loads(done.stdout)["recording"] is None
    assert list(lodeflow.folder.iterdir()) == []


def test_an_existing_recording_is_not_overwritten(lodeflow: CommandLine, graphs: Path) -> None:
    kept = lodeflow.write("kept.mcap", "mine")
    done = lodeflow(
        "run", graphs / "heading.yaml", "--duration", 1, "--record", "kept.mcap", code=1
    )
    assert "kept.mcap" in done.stderr
    assert kept.read_text() == "mine"
