"""lodeflow plot, as a user calls it."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest
from command_line import CommandLine

PNG = b"\x89PNG\r\n"


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("plot")
    graph = Path(__file__).parents[2] / "graphs" / "heading.yaml"
    CommandLine(folder)("run", graph, "--arg", "duration=5", "--record", "run.mcap")
    return folder / "run.mcap"


def test_an_overview_and_named_streams_of_two_recordings(
    lodeflow: CommandLine, recording: Path
) -> None:
    shutil.copy(recording, lodeflow.folder / "a.mcap")
    shutil.copy(recording, lodeflow.folder / "b.mcap")
    done = lodeflow("plot", "a.mcap", "--to", "overview.png")
    assert done.stdout == "overview.png\n"
    assert "not shown: vehicle.raw_rate" in done.stderr
    assert (lodeflow.folder / "overview.png").read_bytes().startswith(PNG)
    done = lodeflow(
        "plot", "a.mcap", "b.mcap", "heading", "fuser.heading", "vehicle.imu.angular_velocity.z",
        "--from", "1", "--until", "3", "--to", "figures/both.svg",
    )  # fmt: skip
    assert not done.stderr
    text = (lodeflow.folder / "figures" / "both.svg").read_text()
    assert "<svg" in text


@pytest.mark.parametrize(
    ("arguments", "code", "said"),
    [
        (["run.mcap", "fusr"], 1, "run.mcap: no stream 'fusr', did you mean 'fuser'?"),
        (["heading"], 2, "no recording among heading; name a file (.mcap)"),
        (["none.mcap"], 1, "none.mcap: cannot be read: No such file or directory"),
        (["cut.mcap"], 1, "mend it with: lodeflow recover cut.mcap"),
        (["run.mcap", "--from", "3", "--until", "2"], 2, "--from 3 must lie before --until 2"),
        (["run.mcap", "--from", "30"], 1, "there are 4.99 s of data"),
    ],
)
def test_mistakes_are_told(
    lodeflow: CommandLine, recording: Path, arguments: list[str], code: int, said: str
) -> None:
    shutil.copy(recording, lodeflow.folder / "run.mcap")
    (lodeflow.folder / "cut.mcap").write_bytes(recording.read_bytes()[:-100])
    done = lodeflow("plot", *arguments, "--to", "out.png", code=code)
    assert said in done.stderr
    assert not (lodeflow.folder / "out.png").exists()


def test_without_a_display_the_window_is_told(lodeflow: CommandLine, recording: Path) -> None:
    lodeflow.environment |= {"MPLBACKEND": "agg"}
    done = lodeflow("plot", recording, "heading", code=1)
    assert done.stderr == (
        "lodeflow: there is no display to open a window on; write a file with --to plot.png\n"
    )


def test_a_format_that_is_none_is_told(lodeflow: CommandLine, recording: Path) -> None:
    done = lodeflow("plot", recording, "--to", "a.mcap", code=1)
    assert "a.mcap: no figure is written as '.mcap' (.png, .svg, .pdf)" in done.stderr


def test_without_matplotlib_one_error_says_how_to_get_it(
    lodeflow: CommandLine, recording: Path
) -> None:
    lodeflow.write("matplotlib.py", "raise ImportError('not here')\n")
    done = lodeflow("plot", recording, "--to", "a.png", code=1)
    assert done.stderr == (
        "lodeflow: figures need the package matplotlib; install lodeflow with its extra: "
        "pip install 'lodeflow[plot]'\n"
    )
