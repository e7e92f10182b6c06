"""The front door: complete, sorted, light, and enough for a plugin."""

from __future__ import annotations

import re
import subprocess
import sys
import types
from importlib import metadata
from pathlib import Path

import lodeflow as lf

FRAMEWORK = Path(lf.__file__).parent

HEAVY = {"numba", "scipy", "zenoh", "mcap", "yaml", "click", "rich", "rosbags", "zstandard"}


def exported() -> set[str]:
    return {
        name
        for name, value in vars(lf).items()
        if not name.startswith("_") and not isinstance(value, types.ModuleType)
    }


def natural(name: str) -> tuple[object, ...]:
    """Return a key by which constants come first, then classes, then functions; UInt8 < UInt32."""
    parts = [part.zfill(9) if part.isdigit() else part for part in re.split(r"(\d+)", name)]
    return (not name.isupper(), not name[0].isupper(), parts)


def test_all_is_complete() -> None:
    assert set(lf.__all__) == exported()
    assert len(lf.__all__) == len(set(lf.__all__))


def test_all_is_sorted() -> None:
    assert lf.__all__ == sorted(lf.__all__, key=natural)


def test_the_version_is_that_of_the_distribution() -> None:
    assert metadata.version("lodeflow") == lf.__version__


def test_every_public_message_unit_and_error_is_at_the_door() -> None:
    from lodeflow import errors
    from lodeflow.messages import fields, units, vocabulary

    for module in (errors, units, vocabulary, fields):
        for name, value in vars(module).items():
            own = isinstance(value, type) and value.__module__ == module.__name__
            if own and not name.startswith("_") and name not in {"Kind", "FieldSpec"}:
                assert getattr(lf, name) is value


def test_importing_it_brings_in_nothing_heavy_and_no_inner_layer() -> None:
    code = "import sys, lodeflow; print(*sys.modules)"
    found = subprocess.run(
        [sys.executable, "-c", code],
        env={"PYTHONPATH": str(FRAMEWORK.parent)},
        capture_output=True,
        text=True,
        check=True,
    )
    modules = set(found.stdout.split())
    assert not {module.partition(".")[0] for module in modules} & HEAVY
    inner = ("graph", "runtime", "recording", "transport", "supervisor", "study", "cli", "testing")
    assert not modules & {f"lodeflow.{name}" for name in inner}


def test_the_door_is_all_that_a_plugin_needs() -> None:
    """The example in the docstring is a plugin."""
    _, example = lf.__doc__.split("\n\n", 1)
    names: dict[str, object] = {"__name__": "example"}
    exec(example, names)
    plugin = names["Doubler"]
    assert plugin.spec.input("rate").type is lf.AngularRate
    out = plugin().step(lf.AngularRate.of(7, angular_rate=[1, 2, 3]))
    assert out == lf.AngularRate.of(7, angular_rate=[2, 4, 6])
