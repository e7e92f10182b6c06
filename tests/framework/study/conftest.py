"""The modules beside the tests are imported by name, also by the processes of a study."""

import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parent))

from study_toys import GRAPH


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """The current folder, with a graph of toys in it."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "toy.yaml").write_text(GRAPH)
    return tmp_path
