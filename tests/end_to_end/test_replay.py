"""`lodeflow replay`: a recording is enough to run again, to change something, and to check."""

from __future__ import annotations

import json
import random
import shutil
import signal
import time
from pathlib import Path

import numpy as np
import pytest
import yaml
from command_line import CommandLine, InProcess
from mcap.reader import make_reader
from readers import records

from lodeflow.recording.mcap.writer import McapWriter

GRAPHS = Path(__file__).parents[2] / "graphs"
FEW = "record: {to: few.mcap, streams: [heading, score]}\n"
CSV = """\
lodeflow: 1
name: table
nodes:
  sensors:
    use: csv
    allow: [nonfinite]
    params:
      file: sensors.csv
      time: {column: t, unit: ms}
      angular_velocity: {columns: [g, g, g]}
      linear_acceleration: {columns: [a, a, a]}
  compass: {use: imu_combiner, inputs: {force: force, rate: rate}}
  force: {use: "splitting:Force", inputs: {imu: sensors.imu}}
  rate: {use: "splitting:Rate", inputs: {imu: sensors.imu}}
"""
SPLITTING = """\
import lodeflow as lf

class Force(lf.Node):
    def step(self, imu: lf.Imu) -> lf.SpecificForce:
        return lf.SpecificForce(imu.t, imu.linear_acceleration)

class Rate(lf.Node):
    def step(self, imu: lf.Imu) -> lf.AngularRate:
        return lf.AngularRate(imu.t, imu.angular_velocity)
"""


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A recording of 20 seconds of the heading graph, made once."""
    lodeflow = CommandLine(tmp_path_factory.mktemp("recorded"))
    lodeflow("run", GRAPHS / "heading.yaml", "--arg", "duration=20", "--record", "rec.mcap")
    return lodeflow.folder / "rec.mcap"


@pytest.fixture
def recorded(quick: InProcess, recording: Path) -> CommandLine:
    shutil.copy(recording, quick.folder)
    return quick


def test_check_passes_on_a_paced_run_with_a_duration(quick: InProcess, graphs: Path) -> None:
    quick("run", graphs / "heading.yaml", "--realtime", "--duration", 1.5, "--record", "rec.mcap")
    found = json.loads(quick("replay", "rec.mcap", "--check", "--json").stdout)
    assert found["same"]
    assert found["streams"]["fuser"]["counts"] == [150, 150]


def test_a_replay_is_a_recording_with_the_same_streams(recorded: CommandLine) -> None:
    done = recorded("replay", "rec.mcap")
    assert "score: heading rmse" in done.stdout
    (path,) = (recorded.folder / "recordings").glob("heading-replay-*.mcap")
    expected = records(recorded.folder / "rec.mcap")
    assert records(path) == expected
    recorded("replay", path, "--from", "fuser", "--record", "again.mcap")
    assert records(recorded.folder / "again.mcap") == expected
    with (recorded.folder / "again.mcap").open("rb") as file:
        reader = make_reader(file)
        (about,) = [m.metadata for m in reader.iter_metadata() if m.name == "lodeflow.provenance"]
    assert about["replay_of"] == str(path)
    assert "compass.attitude" in json.loads(about["replay_fed"])


def test_a_change_is_computed_and_check_names_the_first_difference(recorded: CommandLine) -> None:
    change = ["--set", "fuser.gyro_noise=0.2"]
    done = recorded(
        "replay", "rec.mcap", "--check", "--json", *change, "--record", "new.mcap", code=1
    )
    found = json.loads(done.stdout)
    assert (found["same"], found["first"]) == (False, "fuser")
    old, new = (records(recorded.folder / name) for name in ("rec.mcap", "new.mcap"))
    assert {name for name in old if old[name] != new[name]} == {"/fuser", "/heading", "/score"}
    pairs = zip(old["/fuser"], new["/fuser"], strict=True)
    first = next(i for i, (was, now) in enumerate(pairs) if was != now)
    difference = found["streams"]["fuser"]["first_difference"]
    assert (difference["message"], difference["t"]) == (first, old["/fuser"][first][0])
    values = [np.frombuffer(side["/fuser"][first][1][-32:]) for side in (old, new)]
    at = "xyzw".index(difference["field"].removeprefix("quaternion."))
    assert [difference["a"], difference["b"]] == [values[0][at], values[1][at]]
    recorded("replay", "new.mcap", "--check")  # the change is in the graph that it holds


def test_a_swap_and_another_graph(recorded: CommandLine) -> None:
    recorded.write(
        "other.yaml",
        "nodes: {fuser: {use: chu_fuser, inputs: {imu: imu, mag: mag_cal, measured: null},"
        " params: null}}\n",
    )
    done = recorded("replay", "rec.mcap", "--with", "other.yaml", "--no-record", "--json")
    assert json.loads(done.stdout)["streams"]["fuser"] == 2000
    recorded.write(
        "small.yaml",
        "lodeflow: 1\nname: small\nnodes:\n"
        "  vehicle: {use: simulated_vehicle}\n"
        "  fuser: {use: chu_fuser, inputs: {imu: vehicle.imu, mag: vehicle.mag}}\n"
        "  score: {use: attitude_score, inputs: {estimate: fuser, truth: vehicle.truth}}\n",
    )
    done = recorded("replay", "rec.mcap", "small.yaml", "--json")
    assert json.loads(done.stdout)["recording"].startswith("recordings/small-replay-")
    assert json.loads(done.stdout)["streams"]["fuser"] == 2000


def test_an_option_without_effect_is_refused(recorded: CommandLine) -> None:
    done = recorded("replay", "rec.mcap", "--set", "vehicle.seed=8", code=2)
    assert "'vehicle' is not computed" in done.stderr
    assert "--from vehicle computes it anew" in done.stderr
    done = recorded("replay", "rec.mcap", "--arg", "seed=8", "--no-record")
    assert "'vehicle' is not what it was when rec.mcap was recorded" in done.stderr
    done = recorded("replay", "rec.mcap", "--from", "vehicle", "--arg", "seed=8", "--check", code=1)
    assert "'vehicle.imu' is the first of" in done.stdout


@pytest.mark.parametrize(
    ("options", "expected"),
    [
        (["--from", "fusr"], "no node 'fusr' in graph 'heading', did you mean 'fuser'?"),
        (["--speed", "fast"], "'fast' is neither 'max' nor a number above 0"),
        (["--speed", "0"], "'0' is neither 'max' nor a number above 0"),
        (["--record", "x", "--no-record"], "exclude each other"),
        (["--set", "fuser.gyro_nois=1"], "did you mean 'gyro_noise'?"),
        (["missing.yaml"], "missing.yaml: cannot be read"),
    ],
)
def test_mistakes_are_told(recorded: CommandLine, options: list[str], expected: str) -> None:
    assert expected in recorded("replay", "rec.mcap", *options, code=2).stderr


def test_a_recording_is_not_overwritten_by_its_replay(recorded: CommandLine) -> None:
    before = (recorded.folder / "rec.mcap").read_bytes()
    done = recorded("replay", "rec.mcap", "--record", "rec.mcap", code=1)
    assert "rec.mcap" in done.stderr
    assert (recorded.folder / "rec.mcap").read_bytes() == before


def test_a_missing_stream_is_told_before_anything_runs(quick: InProcess, graphs: Path) -> None:
    quick.write("some.yaml", "record: {to: some.mcap, streams: [vehicle.imu, fuser]}\n")
    quick("run", graphs / "heading.yaml", "--with", "some.yaml", "--duration", 1)
    done = quick("replay", "some.mcap", code=2)
    assert (
        "some.mcap: 'vehicle.raw_mag' is not recorded, but read by 'mag_cal' (input raw); "
        "--from vehicle computes it anew" in done.stderr
    )
    assert not (quick.folder / "recordings").exists()
    quick("replay", "some.mcap", "--from", "vehicle", "--check")


def test_what_was_lost_at_the_source_stays_out(lodeflow: CommandLine) -> None:
    cells = ["nan" if i % 7 == 3 else str(np.sin(i)) for i in range(100)]
    rows = "".join(f"{10 * i},{cell},9.8\n" for i, cell in enumerate(cells))
    lodeflow.write("sensors.csv", f"t,g,a\n{rows}")
    lodeflow.write("splitting.py", SPLITTING)
    lodeflow.write("graph.yaml", CSV)
    assert "LOST 14 (nonfinite)" in lodeflow("run", "graph.yaml", "--record", "rec.mcap").stdout
    (lodeflow.folder / "sensors.csv").unlink()
    done = lodeflow("replay", "rec.mcap", "--check", "--record", "again.mcap")
    assert "equal to the byte" in done.stdout
    assert records(lodeflow.folder / "again.mcap") == records(lodeflow.folder / "rec.mcap")


@pytest.mark.parametrize("seed", range(4))
def test_check_passes_after_ctrl_c(lodeflow: CommandLine, graphs: Path, seed: int) -> None:
    """Also where the sources were not recorded: they are computed as far as they had come."""
    pace = ["--realtime"] if seed % 2 else []
    few = ["--with", lodeflow.write("few.yaml", FEW)] if seed >= 2 else []
    process = lodeflow.start(
        "run", graphs / "heading.yaml", "--arg", "duration=100000", "--record", "rec.mcap",
        *pace, *few,
    )  # fmt: skip
    path = lodeflow.folder / "rec.mcap"
    behind_a_chunk = 7_000 if few else 30_000  # bytes; what comes before the data is smaller
    while not path.exists() or path.stat().st_size < behind_a_chunk:
        assert process.poll() is None, process.communicate()
        time.sleep(0.01)
    time.sleep(random.Random(seed).uniform(0.0, 0.3))
    process.send_signal(signal.SIGINT)
    _, errors = process.communicate(timeout=20)
    assert process.returncode == 130, errors
    found = json.loads(lodeflow("replay", "rec.mcap", "--check", "--json").stdout)
    assert found["same"]
    assert found["streams"]["heading"]["shared"] > 10


def test_a_changed_source_runs_to_its_own_end(quick: InProcess, graphs: Path) -> None:
    quick.write("few.yaml", FEW)
    graph = graphs / "heading.yaml"
    quick("run", graph, "--with", "few.yaml", "--arg", "duration=20", "--duration", 2)
    quick("replay", "few.mcap", "--check")
    done = quick("replay", "few.mcap", "--arg", "seed=8", "--no-record", "--json")
    assert json.loads(done.stdout)["streams"]["heading"] == 2000


def kill(path: Path, into: Path, ends: dict[str, int]) -> None:
    """Write what is left of a recording if its run is killed: no summary, streams cut."""
    found = records(path)
    with path.open("rb") as file:
        reader = make_reader(file)
        summary = reader.get_summary()
        (graph,) = reader.iter_attachments()
    with McapWriter(into) as writer:
        writer.attachment(graph.name, graph.media_type, graph.data)
        for channel in summary.channels.values():
            schema = summary.schemas[channel.schema_id]
            rows = found[channel.topic]
            rows = rows[: ends.get(channel.topic, len(rows))]
            if channel.topic in ("/score",):
                rows = []
            opened = writer.channel(channel.topic, schema.name, schema.data.decode())
            if rows:
                t, data = zip(*rows, strict=True)
                payloads = np.frombuffer(b"".join(data), np.uint8).reshape(len(t), -1)
                writer.write(opened, np.array(t), payloads)


def test_of_a_killed_run_it_is_told_what_differs_at_the_end(recorded: CommandLine) -> None:
    path = recorded.folder / "rec.mcap"
    kill(path, recorded.folder / "killed.mcap", {"/fuser": 1700, "/heading": 1600})
    done = recorded("replay", "killed.mcap", "--check", code=1)
    assert "fuser: equal to the end of the recording, then 300 more from t=17000000000 ns" in (
        done.stdout
    )
    assert "heading: equal to the end of the recording, then 400 more" in done.stdout
    assert "killed.mcap was not ended by its run, which was killed" in done.stdout
    assert "vehicle.raw_mag t=19990000000 ns" in done.stdout
    cut = {"/vehicle/raw_mag": 1500, "/vehicle/raw_rate": 1500, "/vehicle/raw_force": 1500}
    kill(path, recorded.folder / "short.mcap", cut)
    done = recorded("replay", "short.mcap", "--check", code=1)
    assert (
        "heading: equal to the end of the replay; 500 more are recorded from t=15000000000 ns"
        in done.stdout
    )
    whole = path.read_bytes()
    (recorded.folder / "half.mcap").write_bytes(whole[: len(whole) // 2])
    assert "was not closed" in recorded("replay", "half.mcap", code=1).stderr


def test_a_node_that_failed_fails_again(lodeflow: CommandLine, graphs: Path) -> None:
    lodeflow.write(
        "failing.py",
        "import lodeflow as lf\n\nclass Failing(lf.Node):\n"
        "    def step(self, imu: lf.Imu) -> lf.AngularRate:\n"
        "        if imu.t >= 5_000_000_000:\n            raise ArithmeticError('too late')\n"
        "        return lf.AngularRate(imu.t, imu.angular_velocity)\n",
    )
    graph = {
        "lodeflow": 1,
        "name": "failing",
        "nodes": {
            "vehicle": {"use": "simulated_vehicle"},
            "failing": {"use": "failing:Failing", "inputs": {"imu": "vehicle.imu"}},
        },
    }
    lodeflow.write("graph.yaml", yaml.safe_dump(graph))
    lodeflow("run", "graph.yaml", "--record", "rec.mcap", code=1)
    done = lodeflow("replay", "rec.mcap", "--check", code=1)
    assert "failed at t=5000000000 on imu=vehicle.imu: ArithmeticError: too late" in done.stderr
