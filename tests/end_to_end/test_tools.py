"""The other commands: new, import, nodes, explain, schema, graph."""

from __future__ import annotations

import json
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import jsonschema
import numpy as np
import pytest
import scipy.io
import yaml
from command_line import CommandLine
from readers import records


def install(folder: Path, package: Path) -> None:
    """Make a package importable and its entry points known, as pip would, into `folder`."""
    project = tomllib.loads((package / "pyproject.toml").read_text())["project"]
    info = folder / f"{project['name'].replace('-', '_')}-{project['version']}.dist-info"
    info.mkdir()
    (info / "METADATA").write_text(
        f"Metadata-Version: 2.1\nName: {project['name']}\nVersion: {project['version']}\n"
    )
    ((name, target),) = project["entry-points"]["lodeflow"].items()
    (info / "entry_points.txt").write_text(f"[lodeflow]\n{name} = {target}\n")
    (folder / target).symlink_to(package / target)


def test_a_new_node_passes_its_test_and_runs_in_its_graph(lodeflow: CommandLine) -> None:
    lodeflow("new", "node", "low_pass")
    package = lodeflow.folder / "lodeflow-low-pass"
    install(lodeflow.folder, package)
    tested = subprocess.run(
        [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", str(package)],
        cwd=package,
        env=lodeflow.environment,
        capture_output=True,
        text=True,
        check=False,
    )
    assert tested.returncode == 0, tested.stdout
    assert "2 passed" in tested.stdout
    assert "low_pass" in lodeflow("nodes").stdout
    assert "time_constant: float [s], default 0.1" in lodeflow("nodes", "low_pass").stdout
    lodeflow("run", package / "graph.yaml", "--duration", 2, "--record", "out.mcap")
    assert len(records(lodeflow.folder / "out.mcap")["/low_pass"]) == 200


@pytest.mark.parametrize(
    ("name", "why"),
    [
        *((name, "such as 'low_pass'") for name in ("Low", "1st", "a-b", "class", "../up", "")),
        *((name, "such as 'low_pass'") for name in ("low_", "low__pass", "_low")),
        *((name, "take the class for a test") for name in ("test", "tests", "test_me", "testbed")),
        *((name, "the graph in the package") for name in ("vehicle", "on", "null")),
        ("csv", "brings one of that name"),
        ("plugins", "the package lodeflow_plugins exists already"),
    ],
)
def test_a_bad_name_for_a_new_node_is_refused(lodeflow: CommandLine, name: str, why: str) -> None:
    done = lodeflow("new", "node", name, code=2)
    assert f"{name!r} is no name for a plugin: " in done.stderr
    assert why in done.stderr
    assert list(lodeflow.folder.iterdir()) == []


def test_a_new_node_does_not_overwrite(lodeflow: CommandLine) -> None:
    lodeflow("new", "node", "mine")
    assert "lodeflow-mine exists" in lodeflow("new", "node", "mine", code=2).stderr


def test_the_next_steps_install_what_the_test_needs(lodeflow: CommandLine) -> None:
    done = lodeflow("new", "node", "mine", "--into", "packages")
    assert 'pip install -e "packages/lodeflow-mine[test]"\n' in done.stdout


def test_a_folder_that_cannot_be_written_is_told(lodeflow: CommandLine) -> None:
    lodeflow.write("notes.txt", "a file, no folder")
    done = lodeflow("new", "node", "mine", "--into", "notes.txt/inner", code=2)
    assert "notes.txt/inner/lodeflow-mine cannot be written: Not a directory" in done.stderr


def trial(path: Path, rows: int = 3000) -> None:
    """Write a file in the form of BROAD's: a sensor that turns about the vertical."""
    rate = 2000 / 7
    t = np.arange(rows) / rate
    yaw = 0.5 * t
    still = np.zeros(rows)
    truth = np.stack([np.cos(yaw / 2), still, still, np.sin(yaw / 2)], axis=1)
    truth[100:120] = np.nan
    field = np.stack([20 * np.sin(yaw), 20 * np.cos(yaw), still - 40], axis=1)
    scipy.io.savemat(
        path,
        {
            "imu_gyr": np.stack([still, still, still + 0.5], axis=1),
            "imu_acc": np.stack([still, still, still + 9.81], axis=1),
            "imu_mag": field,
            "opt_quat": truth,
            "movement": np.ones((rows, 1)),
            "sampling_rate": rate,
        },
    )


def test_an_imported_trial_is_fused_and_scored(lodeflow: CommandLine, graphs: Path) -> None:
    trial(lodeflow.folder / "turning.mat")
    lodeflow("import", "broad", "turning.mat", "trial.mcap")
    assert {
        topic: len(rows) for topic, rows in records(lodeflow.folder / "trial.mcap").items()
    } == {
        "/broad/imu": 3000,
        "/broad/mag": 3000,
        "/broad/truth": 3000,
    }
    done = lodeflow("run", graphs / "broad.yaml", "--arg", "recording=trial.mcap", "--json")
    score = json.loads(done.stdout)["scores"]["score"]
    assert score["samples"] == 2980
    assert np.degrees(score["total_max"]) < 0.2


def test_import_tells_what_is_wrong(lodeflow: CommandLine) -> None:
    lodeflow.write("junk.mat", "not a MATLAB file")
    done = lodeflow("import", "broad", "junk.mat", "out.mcap", code=1)
    assert "junk.mat: cannot be read as a MATLAB file" in done.stderr
    assert not (lodeflow.folder / "out.mcap").exists()
    assert "did you mean 'broad'?" in lodeflow("import", "brod", "junk.mat", "x", code=2).stderr
    lodeflow("import", "broad", "missing.mat", "x.mcap", code=2)


def test_nodes_lists_and_documents_every_plugin(lodeflow: CommandLine) -> None:
    listed = json.loads(lodeflow("nodes", "--json").stdout)
    assert {"quaternion_kalman", "csv", "simulated_vehicle"} <= listed.keys()
    done = lodeflow("nodes", "quaternion_kalman")
    for expected in ("inputs:", "measured: Attitude", "gyro_noise: float [rad/s]", "Eqs. 18-29"):
        assert expected in done.stdout
    assert "did you mean 'csv'?" in lodeflow("nodes", "cvs", code=2).stderr
    nested = json.loads(lodeflow("nodes", "simulated_vehicle", "--json").stdout)["params"]["roll"]
    assert nested["params"]["slope"]["unit"] == "rad/s"
    assert nested["params"]["sines"]["params"]["frequency"]["unit"] == "Hz"
    assert isinstance(nested["default"]["sines"][0]["amplitude"], float)


def test_explain_schema_and_drawings(lodeflow: CommandLine, graphs: Path) -> None:
    graph = graphs / "heading.yaml"
    told = lodeflow("explain", graph, "fuser.gyro_noise", "--set", "fuser.gyro_noise=1").stdout
    assert "default of 'quaternion_kalman'" in told
    assert re.search(r"heading.yaml:\d+:\d+ +'0.15 deg/s'", told)
    assert re.search(r"--set.*<- in force", told)
    schema = json.loads(lodeflow("schema").stdout)
    jsonschema.validate(yaml.safe_load(graph.read_text()), schema)
    assert "fuser" in lodeflow("graph", graph).stdout
    assert "flowchart" in lodeflow("graph", graph, "--format", "mermaid").stdout
    assert lodeflow("graph", graph, "--format", "dot").stdout.startswith("digraph")


def test_help_and_version(lodeflow: CommandLine) -> None:
    assert "Run a graph and record it." in lodeflow("--help").stdout
    assert "0.1.0" in lodeflow("--version").stdout
