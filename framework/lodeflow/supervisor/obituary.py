"""Obituary: what other hosts are told of a group that has crashed and will not come back.

On its own host the supervisor says so; on others a process that takes the group's place does, and
does nothing else.
"""

from __future__ import annotations

import signal
from collections import deque
from collections.abc import Callable
from typing import Any

from lodeflow.supervisor.group import open_links
from lodeflow.supervisor.setup import Report, Setup
from lodeflow.transport.meeting import resign

PATIENCE = 20.0
"""Seconds in which the others have to be reached."""


def run_obituary(
    setup: Setup,
    name: str,
    ends: bool,
    tell: Callable[[Any], None],
    orders: deque[Any],
    awake: list[Any],
) -> Report:
    """Tell the groups on other hosts; see `run_group` for what is not told here.

    Args:
        setup: the run.
        name: of the group that is gone.
        ends: the run ends with it.
        tell: not used.
        orders: what the supervisor says.
        awake: is given what ends a wait.
    """
    signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGTERM})  # which ends it at once
    links, close = open_links(setup, name, orders)
    awake.append(links.wake)
    resign(links, setup.far(name), PATIENCE, stop=ends)
    close()
    return Report()
