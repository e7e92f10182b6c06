"""Tell study files from graph files."""

from __future__ import annotations

import re
from pathlib import Path


def is_study(path: Path) -> bool:
    """Whether a file is a study, and no graph.

    A study is a file in a folder, where its paths start; a pipe can be read only once.
    """
    if not path.is_file():
        return False
    try:
        return re.search(rb"^lodeflow_study\b", path.read_bytes(), re.MULTILINE) is not None
    except OSError:
        return False
