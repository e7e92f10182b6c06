"""One process of a peer without a framework: python role.py PEER source|relay|sink IN OUT."""

from __future__ import annotations

import os
import sys
import time

import numpy as np
from ends import receiver, sender
from task import HEAD, Book, Task, compiled, paced

if __name__ == "__main__":
    peer, role, inlet, outlet = sys.argv[1:]
    task = Task.from_environment()
    if task.numba:
        compiled()
    if role == "source":
        send = sender(peer, outlet)
        payload = bytearray(task.size)
        for number in paced(task):
            last = (number + 1) * task.rows - 1
            HEAD.pack_into(payload, 0, float(time.monotonic_ns()), float(last))
            send(payload)
        time.sleep(30)  # the end of the sink ends us
    elif role == "relay":
        recv, send = receiver(peer, inlet), sender(peer, outlet)
        while True:
            send(bytearray(recv()))
    else:
        recv, book = receiver(peer, inlet), Book(task)
        while True:
            data = np.frombuffer(recv(), dtype=np.uint8)
            if book.see(*HEAD.unpack_from(data), task.rows):
                break
        os._exit(0)
