"""The ends of a link as each peer's own documentation has them: what sends, and what receives.

`sender(peer, where)` returns what sends bytes, `receiver(peer, where)` what waits for the next and
returns a readable buffer. `where` is a path that both sides are given.
"""

from __future__ import annotations

import ctypes
import json
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

Send = Callable[[bytearray], Any]
Receive = Callable[[], Any]


def sender(peer: str, where: str) -> Send:
    return {"zenoh": _zenoh_send, "pyzmq": _zmq_send, "iceoryx2": _iceoryx_send}[peer](where)


def receiver(peer: str, where: str) -> Receive:
    return {"zenoh": _zenoh_recv, "pyzmq": _zmq_recv, "iceoryx2": _iceoryx_recv}[peer](where)


# ---- eclipse-zenoh: unix sockets, FifoChannel, blocking where nothing may be lost ----------------

_KEPT: list[Any] = []


def _zenoh_session(listen: str = "", connect: str = "") -> Any:
    import zenoh

    config = zenoh.Config()
    for name, value in {
        "mode": "peer",
        "scouting/multicast/enabled": False,
        "scouting/gossip/enabled": False,
        "scouting/delay": 0,
        "connect/timeout_ms": -1,
        "connect/exit_on_failure": False,
        "connect/retry": {"period_init_ms": 5, "period_max_ms": 50, "period_increase_factor": 2},
        "transport/shared_memory/enabled": False,
        "listen/endpoints": [f"unixsock-stream/{listen}"] if listen else [],
        "connect/endpoints": [f"unixsock-stream/{connect}"] if connect else [],
    }.items():
        config.insert_json5(name, json.dumps(value))
    session = zenoh.open(config)
    _KEPT.append(session)
    return session


def _zenoh_send(where: str) -> Send:
    import zenoh

    publisher = _zenoh_session(connect=where).declare_publisher(
        f"bench/{Path(where).name}", congestion_control=zenoh.CongestionControl.BLOCK
    )
    while not publisher.matching_status.matching:
        time.sleep(0.001)
    return publisher.put


def _zenoh_recv(where: str) -> Receive:
    from zenoh.handlers import FifoChannel

    session = _zenoh_session(listen=where)
    recv = session.declare_subscriber(f"bench/{Path(where).name}", FifoChannel(1024)).recv
    return lambda: recv().payload.to_bytes()


# ---- pyzmq: PUSH and PULL over ipc ---------------------------------------------------------------


def _zmq_send(where: str) -> Send:
    import zmq

    socket = zmq.Context.instance().socket(zmq.PUSH)
    socket.connect(f"ipc://{where}")
    return socket.send


def _zmq_recv(where: str) -> Receive:
    import zmq

    socket = zmq.Context.instance().socket(zmq.PULL)
    socket.bind(f"ipc://{where}")
    return socket.recv


# ---- iceoryx2: publish and subscribe over shared memory, an event to wake the reader -------------


def _iceoryx_services(where: str) -> tuple[Any, Any]:
    import iceoryx2 as iox2

    iox2.set_log_level(iox2.LogLevel.Error)
    node = iox2.NodeBuilder.new().create(iox2.ServiceType.Ipc)
    name = where.replace("/", "-")
    data = (
        node.service_builder(iox2.ServiceName.new(f"data{name}"))
        .publish_subscribe(iox2.Slice[ctypes.c_uint8])
        .enable_safe_overflow(False)
        .subscriber_max_buffer_size(64)
        .open_or_create()
    )
    event = node.service_builder(iox2.ServiceName.new(f"event{name}")).event().open_or_create()
    _KEPT.extend([node, data, event])
    return data, event


def _iceoryx_send(where: str) -> Send:
    import iceoryx2 as iox2

    data, event = _iceoryx_services(where)
    publisher = (
        data.publisher_builder()
        .initial_max_slice_len(64)
        .allocation_strategy(iox2.AllocationStrategy.PowerOfTwo)
        .backpressure_strategy(iox2.BackpressureStrategy.RetryUntilDelivered)
        .create()
    )
    notifier = event.notifier_builder().create()
    while not data.dynamic_config.number_of_subscribers:
        time.sleep(0.001)

    def send(payload: bytearray) -> None:
        sample = publisher.loan_slice_uninit(len(payload))
        source = (ctypes.c_uint8 * len(payload)).from_buffer(payload)
        ctypes.memmove(sample.payload_ptr, source, len(payload))
        sample.assume_init().send()
        notifier.notify()

    return send


def _iceoryx_recv(where: str) -> Receive:
    data, event = _iceoryx_services(where)
    subscriber = data.subscriber_builder().create()
    listener = event.listener_builder().create()

    def recv() -> Any:
        while (sample := subscriber.receive()) is None:
            listener.blocking_wait()
        return ctypes.string_at(sample.payload_ptr, sample.payload().len())

    return recv
