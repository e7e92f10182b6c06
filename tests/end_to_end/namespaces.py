"""Two hosts with a cable between them: network namespaces of Linux."""

from __future__ import annotations

import itertools
import os
import shutil
import subprocess
from types import TracebackType

_number = itertools.count()


def ip(*words: str) -> None:
    """Run the tool `ip`, and have it succeed."""
    subprocess.run(["ip", *words], check=True, capture_output=True, text=True)


def why_not() -> str | None:
    """Return why there can be no network namespaces here; None if there can."""
    if shutil.which("ip") is None:
        return "needs the tool `ip` (package iproute2)"
    probe = f"lf-probe-{os.getpid()}"
    try:
        ip("netns", "add", probe)
        ip("netns", "exec", probe, "true")
        ip("-n", probe, "link", "add", "lf-p0", "type", "veth", "peer", "name", "lf-p1")
    except subprocess.CalledProcessError as error:
        return f"no network namespaces here: {error.stderr.strip()}"
    finally:
        subprocess.run(["ip", "netns", "del", probe], check=False, capture_output=True)
    return None


class Hosts:
    """Two namespaces, each with one end of a cable.

    Attributes:
        names: of the namespaces.
        addresses: IPv4, in the same order.
    """

    def __init__(self) -> None:
        number = next(_number)
        self.names = tuple(f"lf-{os.getpid()}-{number}-{end}" for end in "ab")
        self.addresses = ("10.213.77.1", "10.213.77.2")

    def __enter__(self) -> Hosts:
        one, other = self.names
        for name in self.names:
            ip("netns", "add", name)
            ip("-n", name, "link", "set", "lo", "up")
        ip("-n", one, "link", "add", "cable", "type", "veth", "peer", "cable", "netns", other)
        for name, address in zip(self.names, self.addresses, strict=True):
            ip("-n", name, "address", "add", f"{address}/30", "dev", "cable")
            ip("-n", name, "link", "set", "cable", "up")
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        for name in self.names:
            subprocess.run(["ip", "netns", "del", name], check=False, capture_output=True)

    def on(self, index: int) -> tuple[str, ...]:
        """Return what goes before a command to run it on a host."""
        return ("ip", "netns", "exec", self.names[index])

    def cut(self) -> None:
        """Pull the cable out."""
        ip("-n", self.names[0], "link", "set", "cable", "down")

    def mend(self) -> None:
        """Put it in again."""
        ip("-n", self.names[0], "link", "set", "cable", "up")
