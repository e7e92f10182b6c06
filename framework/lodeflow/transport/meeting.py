"""Meeting and parting: how the groups of a run find each other, and how they leave."""

from __future__ import annotations

from collections.abc import Callable, Iterable

from lodeflow.clock import monotonic
from lodeflow.errors import RunError
from lodeflow.transport.link import HELLO_EVERY
from lodeflow.transport.links import Links

PATIENCE = 5.0
"""Seconds between two words on whom a group waits for."""
LATE = 0.5
"""Seconds in which groups may still meet after the run was told to stop."""
LOOK_EVERY = 1.0
"""Seconds between two looks at who can be reached."""
OUT_OF_REACH = 3.0
"""Seconds after which it is told that a group cannot be reached; Zenoh has noticed by then."""
LINGER = 20.0
"""Seconds that a group which is done waits for the others to have heard so, while they listen.

The last acknowledgement may be lost, with a cable that is cut: who left at once would leave the
other side without it for ever.
"""


def barrier(
    links: Links, is_stopping: Callable[[], bool], report: Callable[[list[str]], None]
) -> bool:
    """Wait until all links of the run are up; return whether they are.

    A group hears from its neighbours how far from them all is up, and tells them in turn.

    Args:
        links: of the group.
        is_stopping: whether the run is to end. The others may have begun by then, and need this
            group for what they have sent: they are waited for a little longer.
        report: called now and then with the names of those that are missing.

    Raises:
        RunError: another group runs another graph.
    """
    said = monotonic()
    until = float("inf")
    while (now := monotonic()) < until:
        if is_stopping():
            until = min(until, now + LATE)
        links.drain(now)
        for link in links.links.values():
            if link.refused is not None:
                raise RunError(
                    f"group '{link.peer}' runs another graph, or the same with other options; "
                    "start all groups with the same file and options (--arg, --set, --swap, "
                    "--with, --record or not, --realtime, --duration)"
                )
        open_links = [link for link in links.links.values() if not link.closed]
        ready = 0
        if all(link.joined for link in open_links):
            least = min((link.peer_ready for link in open_links), default=links.rounds)
            ready = min(links.rounds, least + 1)
        for link in open_links:
            news = ready > link.ready
            link.ready = ready
            if news:
                link.greet(now)  # at once: the others wait for it
            link.tend(now)
        if ready == links.rounds:
            return True
        if now - said > PATIENCE:
            said = now
            late = [x.peer for x in open_links if not x.joined]
            report(late or [x.peer for x in open_links if x.peer_ready == least])
        links.wait(HELLO_EVERY / 2)
    return False


def farewell(
    links: Links, patience: float | None = None, *, silent: bool = False, begun: bool = True
) -> int:
    """Wait until all that was sent is taken; return how many records were not.

    Args:
        links: of the group.
        patience: seconds to wait at most; None for as long as it takes.
        silent: do not say that this is the end.
        begun: this group may have sent something, or been sent something.
    """
    links.flush()
    links.detach()
    until = float("inf") if patience is None else monotonic() + patience
    while (now := monotonic()) < until and any(link.owes for link in links.links.values()):
        links.drain(now)
        for link in links.links.values():
            link.tend(now)
        links.wait(HELLO_EVERY)
    if silent:
        return sum(link.owes_rows for link in links.links.values())
    for link in links.links.values():
        link.tend(now, at_once=True)
        link.say_end(whole=links.is_whole(link), begun=begun)
    until = min(until, monotonic() + LINGER)
    while (now := monotonic()) < until:
        left = [x for x in links.links.values() if not (x.departed or x.closed)]
        if not any(x.is_matched for x in left):
            break
        links.drain(now)
        for link in left:
            link.tend(now, at_once=True)
            link.say_end(whole=links.is_whole(link), begun=begun)  # the one before may be lost
        links.wait(HELLO_EVERY)
    return sum(link.owes_rows for link in links.links.values())


def resign(links: Links, groups: Iterable[str], patience: float, *, stop: bool) -> None:
    """Tell groups, in the place of one that has crashed, that it will not come back.

    Args:
        links: in its place.
        groups: who is told, until it has answered.
        patience: seconds in which they have to.
        stop: the run ends with it.
    """
    told = [links.by_name[group] for group in groups]
    until = monotonic() + patience
    while (now := monotonic()) < until and not all(link.departed or link.closed for link in told):
        links.drain(now)
        for link in told:
            link.arrived.clear()  # it is for the one that is gone
            link.tend(now)
            if link.joined and stop:
                link.say_stop()
            if link.joined:
                link.say_end(whole=False)
        links.wait(HELLO_EVERY)


class Reach:
    """Tells of groups that cannot be reached any more, and of their return.

    A cut cable and a host without power look the same: both are waited for, and that is said.

    Args:
        links: of the group.
        groups: on other hosts.
        tell: gets each text.
    """

    def __init__(self, links: Links, groups: Iterable[str], tell: Callable[[str], None]) -> None:
        self._links = [links.by_name[group] for group in groups]
        self._tell = tell
        self._looked = 0.0
        self._away: dict[str, float] = {}
        self._told: set[str] = set()

    def look(self) -> None:
        """Look, if it is time to; call it as often as you like."""
        if not self._links or (now := monotonic()) - self._looked < LOOK_EVERY:
            return
        self._looked = now
        for link in self._links:
            name = link.peer
            if link.is_matched or link.departed or link.closed:
                since = self._away.pop(name, now)
                if name in self._told:
                    self._told.remove(name)
                    if link.is_matched:
                        self._tell(f"group '{name}' is back after {now - since:.0f} s")
            elif now - self._away.setdefault(name, now) >= OUT_OF_REACH and name not in self._told:
                self._told.add(name)
                self._tell(
                    f"group '{name}' cannot be reached; what it is owed is kept until it is back"
                )
