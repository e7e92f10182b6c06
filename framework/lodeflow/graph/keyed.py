"""Inputs from a Zenoh key: a live source that the graph gets by itself, in the place of a node."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from functools import cache
from typing import Any, ClassVar

from lodeflow.clock import Clock, seconds
from lodeflow.errors import MessageError, did_you_mean
from lodeflow.graph.model import GraphNode
from lodeflow.graph.plugins import Plugin
from lodeflow.graph.problems import Problems, join, show
from lodeflow.graph.reading import check_keys, read_allow
from lodeflow.graph.tree import Tree
from lodeflow.messages.message import Message
from lodeflow.messages.units import Second
from lodeflow.node import Source
from lodeflow.params import Params

USE = "zenoh_key"
"""What such a source is called where plugins are named."""
KEYS = ("key", "type", "max_delay", "allow")
MAX_DELAY = 0.1
"""Seconds that a message may come late, if nothing else is said."""
_CHUNK = re.compile(r"[^/#?$]+")


class KeyParams(Params):
    """What is subscribed to."""

    key: str
    """Zenoh key expression; wildcards are welcome."""


class FromKey(Source):
    """Messages that any Zenoh program puts on a key, as CDR records of one type.

    Several publishers are merged by stamp. One that says how far it has come (lodeflow does) is
    taken at its word; others follow the clock, and are waited for as long as `max_delay`.

    Attributes:
        kind: type of the messages.
        subscribe: gives the messages, in the order of their stamps, and bounds; set by the run.
    """

    Params = KeyParams
    kind: ClassVar[type[Message]]
    own_bounds = True
    subscribe: Callable[[FromKey, Clock], Iterator[Any]] | None = None

    def messages(self, clock: Clock) -> Iterator[Any]:
        """Yield what comes, until the run ends."""
        if self.subscribe is None:
            raise RuntimeError("this run has no Zenoh session, so nothing can come from a key")
        yield from self.subscribe(self, clock)


@cache
def source_of(kind: type[Message], max_delay: int) -> type[FromKey]:
    """Return the source of messages of a type, which may come late by `max_delay` ns."""

    def read(self: FromKey, clock: Clock) -> Iterator[Any]:
        return self.messages(clock)

    read.__annotations__["return"] = Iterator[kind]  # type: ignore[valid-type]
    body = {"read": read, "kind": kind, "max_delay": max_delay, "__doc__": FromKey.__doc__}
    made: Any = type("FromKey", (FromKey,), body)
    found: type[FromKey] = made
    return found


def read_key(
    name: str, tree: Tree, path: str, kind: type[Message], problems: Problems
) -> GraphNode | None:
    """Return the source that an input `{key: ..., type: ..., max_delay: ..., allow: ...}` is.

    Args:
        name: of the source.
        tree: the input.
        path: of it in the file.
        kind: what the port takes.
        problems: where problems are added.
    """
    before = len(problems)
    check_keys(tree, path, KEYS, problems)
    key = tree.find("key")
    if key is None:
        problems.add(tree.place, path, "missing: key, the Zenoh key expression to subscribe to")
    elif why := _bad_key(key.value):
        key.refuse(problems, join(path, "key"), f"{why}, got {show(key.plain())}")
    named = tree.find("type")
    if named is not None and named.value not in (kind.__name__, kind.ros):
        what = f"the input takes {kind.__name__} ({kind.ros}), got {show(named.plain())}"
        named.refuse(problems, join(path, "type"), what)
    listed = tree.find("allow")
    allow = [] if listed is None else read_allow(listed, join(path, "allow"), problems)
    delay = _max_delay(tree.find("max_delay"), join(path, "max_delay"), problems)
    if len(problems) > before or key is None:
        return None
    source, params = source_of(kind, delay), KeyParams(key=str(key.value))
    return GraphNode(name, USE, source, params, allow=frozenset(allow))


def read_keys(tree: Tree | None, plugin: Plugin, path: str, problems: Problems) -> dict[str, str]:
    """Return the Zenoh keys that a node gives its outputs, by port.

    Args:
        tree: the node's `keys`; None for none.
        plugin: its class.
        path: of the keys in the file.
        problems: where problems are added.
    """
    if tree is None or tree.value is None:
        return {}
    if not isinstance(tree.value, dict):
        what = f"should be a mapping of outputs to Zenoh keys, got {show(tree.plain())}"
        tree.refuse(problems, path, what)
        return {}
    ports = [port.name for port in plugin.spec.outputs]
    found = {}
    for port, value in tree.entries.items():
        if port not in ports:
            near = did_you_mean(port, ports) or f" (outputs: {', '.join(ports) or 'none'})"
            problems.add(value.name_place, join(path, port), f"no such output{near}")
        elif why := _bad_key(value.value, one=True):
            value.refuse(problems, join(path, port), f"{why}, got {show(value.plain())}")
        else:
            found[port] = str(value.value)
    return found


def _bad_key(key: Any, *, one: bool = False) -> str | None:
    """Return why a value is no key expression, or not `one` key; None if it is."""
    if not isinstance(key, str):
        return "should be a Zenoh key"
    if one and ("*" in key or key.startswith("@")):
        return "a stream is put on one key, without wildcards or @"
    chunks = key.split("/")
    if not key or "" in chunks:
        return "a key has no empty part between, before or behind its '/'"
    for chunk in chunks:
        if chunk not in ("*", "**") and not _CHUNK.fullmatch(chunk.replace("$*", "x")):
            return "a part of a key has no #, ? or $ in it (but for the wildcards *, ** and $*)"
        if "*" in chunk.replace("$*", "") and chunk not in ("*", "**"):
            return "a wildcard inside a part is written $*"
    if "**/**" in key or "$*$*" in key or "**/*" in key:
        return "wildcards that follow each other mean the same as one: **, or *"
    return None


def _max_delay(tree: Tree | None, path: str, problems: Problems) -> int:
    if tree is None:
        return seconds(MAX_DELAY)
    given: Any = tree.value
    try:
        value = Second.parse(given) if isinstance(given, str) else float(given)
        if isinstance(given, bool) or not 0 <= value <= 3600:
            raise ValueError
    except (ValueError, TypeError, MessageError):
        what = f"should be a time from 0 to 3600 s, such as 50 ms, got {show(tree.plain())}"
        tree.refuse(problems, path, what)
        return 0
    return seconds(value)
