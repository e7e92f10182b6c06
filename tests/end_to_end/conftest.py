"""The modules beside the tests are imported by name."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parent))

from command_line import CommandLine, InProcess

ROOT = Path(__file__).parents[2]


@pytest.fixture
def lodeflow(tmp_path: Path) -> Iterator[CommandLine]:
    command_line = CommandLine(tmp_path)
    yield command_line
    command_line.end()


@pytest.fixture
def graphs() -> Path:
    return ROOT / "graphs"


@pytest.fixture
def quick(tmp_path: Path) -> InProcess:
    return InProcess(tmp_path)
