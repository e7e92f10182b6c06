"""Message types of the installed plugin packages, for commands that read recordings."""

from __future__ import annotations

import importlib
from typing import Any

from lodeflow.cli.output import STATUS
from lodeflow.messages import vocabulary as bundled  # noqa: F401 (declares the bundled types)
from lodeflow.registry import registry


def declare_installed() -> None:
    """Import the modules that declare message types; tell of those that cannot be imported."""
    for implementation in registry().manager.hook.lodeflow_messages.get_hookimpls():
        try:
            modules: Any = implementation.function()
            for module in modules:
                importlib.import_module(module)
        except Exception as error:  # one broken package must not take the others along
            STATUS.print(
                f"the message types of {implementation.plugin_name} are not known: "
                f"{type(error).__name__}: {error}",
                soft_wrap=True,
                markup=False,
            )
