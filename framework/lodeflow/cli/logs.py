"""Show what nodes log."""

from __future__ import annotations

import logging


def log_to_stderr() -> None:
    """Show what nodes log."""
    handler = logging.StreamHandler()
    handler.setFormatter(logging.Formatter("%(name)s: %(levelname)s: %(message)s"))
    logger = logging.getLogger("lodeflow")
    logger.addHandler(handler)
    logger.setLevel(logging.INFO)
