"""Tell study files from graph files."""

from __future__ import annotations

import re
from pathlib import Path


def is_study(path: Path) -> bool:
    """Whether a file begins like a study, and not like a graph."""
    try:
        return re.search(rb"^lodeflow_study\b", path.read_bytes(), re.MULTILINE) is not None
    except OSError:
        return False
