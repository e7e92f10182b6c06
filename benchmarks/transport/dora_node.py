"""One node of dora: python dora_node.py source|relay|sink."""

from __future__ import annotations

import sys
import time

import numpy as np
import pyarrow as pa
from dora import Node
from task import HEAD, Book, Task, compiled, paced

if __name__ == "__main__":
    role = sys.argv[1]
    task = Task.from_environment()
    if task.numba:
        compiled()
    node = Node()
    if role == "source":
        payload = bytearray(task.size)
        for number in paced(task, 3.0):  # its first event takes so long
            HEAD.pack_into(
                payload, 0, float(time.monotonic_ns()), float((number + 1) * task.rows - 1)
            )
            node.send_output("out", pa.array(np.frombuffer(payload, dtype=np.uint8)))
        time.sleep(2.0)  # else what is on its way may be lost with us
    else:
        book = Book(task)
        for event in node:
            if event["type"] != "INPUT":
                continue
            if role == "relay":
                node.send_output("out", event["value"])
            elif book.see(*HEAD.unpack_from(event["value"].to_numpy()), task.rows):
                break
