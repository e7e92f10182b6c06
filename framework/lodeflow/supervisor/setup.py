"""What every process of a split run is told, and what it tells its supervisor."""

from __future__ import annotations

import hashlib
import os
import pickle
import struct
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from lodeflow.graph import Graph, dump
from lodeflow.graph.partition import Part
from lodeflow.messages.message import Message
from lodeflow.runtime.plan import Counters


def digest(graph: Graph, *options: object) -> bytes:
    """Return 16 bytes that tell a graph, and options that all groups must share, from others."""
    return hashlib.sha256("\n".join([dump(graph), *map(str, options)]).encode()).digest()[:16]


@dataclass(frozen=True)
class Recording:
    """What the recorder is told.

    Attributes:
        path: the file.
        provenance: texts kept in it.
    """

    path: Path
    provenance: Mapping[str, str]


@dataclass(frozen=True)
class Setup:
    """A split run.

    Attributes:
        graph: the whole graph, with the changes made so far.
        digest: of the graph at the start and of the options, the same in all groups of a run.
        parts: its groups, those of other hosts included; the recorder is the last.
        here: names of those that run on this host.
        run_dir: where they listen.
        rounds: see `Links`.
        samples: whether single samples are run, in all groups.
        speed: see `Engine`.
        duration: likewise, ns.
        recording: what is recorded; None for nothing.
        listen: endpoints of each group, for other hosts.
        connect: endpoints on other hosts.
        open_to: endpoints of each group at which other programs can look in.
        outside: endpoints of other programs.
        config: Zenoh configuration file with certificates, users and access control.
        shown: whether somebody looks at the progress of the run.
    """

    graph: Graph
    digest: bytes
    parts: Mapping[str, Part]
    here: tuple[str, ...]
    run_dir: Path
    rounds: int
    samples: bool
    speed: float | None = None
    duration: int | None = None
    recording: Recording | None = None
    listen: Mapping[str, Sequence[str]] = field(default_factory=dict)
    connect: Sequence[str] = ()
    open_to: Mapping[str, Sequence[str]] = field(default_factory=dict)
    outside: Sequence[str] = ()
    config: Path | None = None
    shown: bool = False

    @property
    def groups(self) -> list[str]:
        """Names of all groups, in one order on all hosts."""
        return list(self.parts)

    def far(self, name: str) -> list[str]:
        """Return the groups on other hosts that a group has a link to."""
        return [peer for peer in self.parts[name].peers if peer not in self.here]


@dataclass
class Report:
    """What a group did, told at its end.

    Attributes:
        counters: per node.
        scores: last score of each stream of scores.
        first: first stamp seen, ns; None for none.
        reached: last stamp seen, ns.
        stopped: it was told to stop before its sources ended.
        lossless: nothing was lost that the graph does not allow to lose.
        links: what each link lost.
        error: what ended it early.
    """

    counters: dict[str, Counters] = field(default_factory=dict)
    scores: dict[str, Message] = field(default_factory=dict)
    first: int | None = None
    reached: int = 0
    stopped: bool = False
    lossless: bool = True
    links: dict[str, dict[str, int]] = field(default_factory=dict)
    error: str | None = None


class Pipe:
    """Objects over a pipe between a supervisor and its own child, and nobody else."""

    _HEAD = struct.Struct("<I")

    def __init__(self, read: int, write: int) -> None:
        self.read, self.write = read, write
        self._rest = b""

    def send(self, what: Any) -> None:
        """Send an object; the other side may be gone."""
        data = pickle.dumps(what)
        data = self._HEAD.pack(len(data)) + data
        try:
            while data:
                data = data[os.write(self.write, data) :]
        except (BrokenPipeError, OSError):
            return

    def receive(self) -> Iterator[Any]:
        """Yield what has come; None at the end of the pipe. Blocks if nothing has."""
        try:
            data = os.read(self.read, 1 << 16)
        except OSError:
            data = b""
        if not data:
            yield None
            return
        self._rest += data
        while len(self._rest) >= 4:
            (size,) = self._HEAD.unpack_from(self._rest)
            if len(self._rest) < 4 + size:
                return
            what, self._rest = self._rest[4 : 4 + size], self._rest[4 + size :]
            yield pickle.loads(what)

    def close(self) -> None:
        """Close both ends."""
        os.close(self.read)
        os.close(self.write)
