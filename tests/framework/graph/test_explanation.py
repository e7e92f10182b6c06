"""explain: the value in force, what it means, and who set it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from lodeflow.errors import GraphError
from lodeflow.graph.explanation import explain

WALK = (Path(__file__).parent / "walk.yaml").read_text()


@pytest.fixture(autouse=True)
def _files(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path("walk.yaml").write_text(WALK)
    Path("field.yaml").write_text(
        "nodes:\n  fuser: {params: {gyro_noise: 0.1}}\n  vehicle: {params: {seed: null}}\n"
    )


def test_the_whole_ladder() -> None:
    options: dict[str, Any] = {"overlays": ["field.yaml"], "sets": ["fuser.gyro_noise=0.2"]}
    expected = """\
fuser.params.gyro_noise = 0.2 rad/s
  Standard deviation of the angular rate.
  Units: rad/s | deg/s | °/s | deg/h | rpm; a plain number is in rad/s.

  default of 'toys:Fuser'     0.01
  walk.yaml:13:26             '0.5 deg/s'
  field.yaml:2:32             0.1
  --set fuser.gyro_noise=0.2  0.2   <- in force"""
    for target in ("fuser.params.gyro_noise", "fuser.gyro_noise", "nodes.fuser.params.gyro_noise"):
        assert explain("walk.yaml", target, **options) == expected


def test_the_last_of_many_sets() -> None:
    shown = explain(
        "walk.yaml", "fuser.iterations", sets=["fuser.iterations=2", "fuser.iterations=3"]
    )
    assert (
        shown
        == """\
fuser.params.iterations = 3

  default of 'toys:Fuser'   1
  --set fuser.iterations=2  2
  --set fuser.iterations=3  3   <- in force"""
    )


def test_an_arg_is_followed_to_its_value() -> None:
    assert (
        explain("walk.yaml", "vehicle.seed", args=["seed=9"])
        == """\
vehicle.params.seed = 9
  Seed of all noise.

  default of 'toys:Vehicle'  0
  walk.yaml:5:47             '${seed}' (seed = 9 from --arg seed=9)   <- in force"""
    )


def test_what_an_overlay_removes() -> None:
    assert (
        explain("walk.yaml", "vehicle.seed", overlays=["field.yaml"])
        == """\
vehicle.params.seed = 0
  Seed of all noise.

  default of 'toys:Vehicle'  0   <- in force
  walk.yaml:5:47             '${seed}' (seed = 7 from walk.yaml:3:14)
  field.yaml:3:28            null, removes it"""
    )
    Path("all.yaml").write_text("nodes: {fuser: {params: null}}")
    assert explain("walk.yaml", "fuser.gyro_noise", overlays=["all.yaml"]).splitlines()[4:] == [
        "  default of 'toys:Fuser'  0.01   <- in force",
        "  walk.yaml:13:26          '0.5 deg/s'",
        "  all.yaml:1:25            removes nodes.fuser.params",
    ]


def test_without_default_and_nested() -> None:
    assert explain("walk.yaml", "cal.bias").splitlines() == [
        "cal.params.bias = [1.0, 2.0, 3.0] LSB",
        "  Output at zero field.",
        "  Units: LSB; a plain number is in LSB.",
        "",
        "  default of 'toys:Calibrator'  none, it must be given",
        "  walk.yaml:9:20                [1, 2, 3]   <- in force",
    ]
    shown = explain("walk.yaml", "show.limits.high", sets=["show.limits={low: 0}"])
    assert shown.splitlines()[0] == "show.params.limits.high = 1.0 rad"


def test_a_swap() -> None:
    options: dict[str, Any] = {"swaps": ["fuser=toys:OtherFuser"]}
    assert (
        explain("walk.yaml", "fuser.use", **options)
        == """\
fuser.use

  walk.yaml:11:10               'toys:Fuser'
  --swap fuser=toys:OtherFuser  'toys:OtherFuser'   <- in force"""
    )
    assert "default of 'toys:OtherFuser'  0.02" in explain(
        "walk.yaml", "fuser.gyro_noise", **options
    )


def test_wires() -> None:
    shown = explain("walk.yaml", "fuser.inputs.mag", sets=["fuser.inputs.mag=cal.out"])
    assert shown.splitlines()[2:] == [
        "  walk.yaml:12:37                 'cal'",
        "  --set fuser.inputs.mag=cal.out  'cal.out'   <- in force",
    ]
    assert explain("walk.yaml", "cal.when") == "cal.when\n\n  not set"


@pytest.mark.parametrize(
    ("target", "expected"),
    [
        ("fuser", "write node.param, such as fuser.gain"),
        ("fuser.", "write node.param, such as fuser.gain"),
        ("fuzer.gain", "no node 'fuzer', did you mean 'fuser'?"),
        ("fuser.gian", "no such parameter of 'toys:Fuser', did you mean 'gain'?"),
        ("vehicle.x", "no such parameter of 'toys:Vehicle' (it has seed, trial, rate)"),
        ("show.limits.x", "no such parameter of 'toys:Display' (it has low, high)"),
    ],
)  # fmt: skip
def test_mistakes(target: str, expected: str) -> None:
    with pytest.raises(GraphError) as caught:
        explain("walk.yaml", target)
    assert str(caught.value) == f"explain {target}: {expected}"
