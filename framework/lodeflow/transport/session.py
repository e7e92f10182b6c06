"""Sessions: how lodeflow opens Zenoh, so that nothing is discovered, shared or waited for."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Any

import zenoh

from lodeflow.errors import RunError
from lodeflow.transport import refusals
from lodeflow.transport.frame import Payload

RETRY = {"period_init_ms": 5, "period_max_ms": 50, "period_increase_factor": 2}
"""How soon a link that is down is tried again."""
LEASE_MS = 2000
"""A peer that is silent for so long (frozen, or its cable cut) is taken for gone."""

# Zenoh's way of a frame leads over three threads by default: who sees that a socket has something
# wakes who reads it, who wakes a helper. One thread does all that here; it never runs our code. It
# is read when the first session of a process is opened, and who has set it knows better.
os.environ.setdefault(
    "ZENOH_RUNTIME", "(acc: (handover: rx), net: (handover: rx), rx: (worker_threads: 1))"
)

PROFILE: Mapping[str, Any] = {
    "mode": "peer",
    "scouting/multicast/enabled": False,
    "scouting/gossip/enabled": False,
    "scouting/delay": 0,  # else opening waits half a second for peers that are not there yet
    "connect/timeout_ms": -1,  # with 0, whoever comes before its listener never links
    "connect/exit_on_failure": False,
    "connect/retry": RETRY,
    "listen/exit_on_failure": True,
    "transport/shared_memory/enabled": False,  # it loses data on a busy CPU, and outlives a kill
    "transport/link/tx/lease": LEASE_MS,
    "transport/link/tx/keep_alive": 4,
}
LINKS: Mapping[str, Any] = {
    # A link sends again what is dropped, but waiting a little for room is cheaper.
    "transport/link/tx/queue/size/data": 16,
    "transport/link/tx/queue/congestion_control/drop/wait_before_drop": 20_000,
}


def open_session(
    *,
    listen: Sequence[str] = (),
    connect: Sequence[str] = (),
    settings: Mapping[str, Any] = MappingProxyType({}),
    config: Path | None = None,
) -> zenoh.Session:
    """Open a session with lodeflow's profile.

    Args:
        listen: endpoints to listen on, such as "tcp/0.0.0.0:7447".
        connect: endpoints to link to, tried until they are there.
        settings: further settings, as Zenoh names them.
        config: a Zenoh configuration file (JSON5) to begin with: certificates, users, access
            control. What the profile says goes before it. A session that also listens has its
            refusals told in the log.

    Raises:
        RunError: an endpoint is malformed or taken, or the file cannot be used.
    """
    try:
        base = zenoh.Config() if config is None else zenoh.Config.from_file(str(config))
    except Exception as error:
        raise RunError(f"{config}: no Zenoh configuration: {_first_line(error)}") from error
    wanted = {**PROFILE, **settings, "listen/endpoints": list(listen)}
    wanted["connect/endpoints"] = list(connect)
    guarded = config is not None and bool(listen)
    if guarded:
        refusals.begin(keys=json.loads(base.get_json("access_control"))["enabled"])
    try:
        for name, value in wanted.items():
            base.insert_json5(name, json.dumps(value))
        session = zenoh.open(base)
    except Exception as error:
        if guarded:
            refusals.end()
        where = ", ".join([*listen, *connect]) or "no endpoint"
        raise RunError(f"cannot open Zenoh on {where}: {_first_line(error)}") from error
    if guarded:
        _guarded.append(session)
    return session


_guarded: list[zenoh.Session] = []
"""Open sessions whose refusals are told."""


def close_session(session: zenoh.Session) -> None:
    """Close a session; a broken one stays as it is."""
    try:
        session.close()  # type: ignore[no-untyped-call]
    except zenoh.ZError:
        pass
    except BaseException as error:
        if not _is_panic(error):
            raise
    if session in _guarded:
        _guarded.remove(session)
        refusals.end()


def put(publisher: zenoh.Publisher, payload: Payload, attachment: bytes | None = None) -> None:
    """Put, and never fail: what a closed or broken session did not take is sent again or missed."""
    try:
        publisher.put(payload, attachment=attachment)
    except zenoh.ZError:
        return
    except BaseException as error:  # a panic inside Zenoh is no Exception
        if not _is_panic(error):
            raise


def _is_panic(error: BaseException) -> bool:
    return type(error).__name__ == "PanicException"


def _first_line(error: BaseException) -> str:
    return str(error).strip().split("\n")[0][:300]
