"""Gathering: small blocks of data at rest become large ones, since each block has its cost."""

from __future__ import annotations

from collections.abc import Generator, Iterator
from typing import Any

from lodeflow.clock import monotonic
from lodeflow.errors import ContractError
from lodeflow.runtime.intake import Batch, Intake
from lodeflow.runtime.plan import RAISED

ROWS = 8192
"""Rows that are gathered; more make little cheaper, and outgrow a processor's cache."""
PATIENCE = 0.05
"""Seconds after which a slow source's rows go on although they are fewer."""


class Pile:
    """Consecutive messages of a source with one port, to be looked at as one block.

    What is kept and what is counted is the same as one by one; so is an error, and what goes on
    before it.

    Args:
        intake: looks at them.
        rows: how many are gathered.
    """

    def __init__(self, intake: Intake, rows: int) -> None:
        node = intake.node
        self._intake, self._rows = intake, rows
        self._held: list[Any] = []
        self._count = 0
        self._since = 0.0
        lone = len(node.spec.outputs) == 1 and not node.spec.step_tuple
        self._kind = node.spec.outputs[0].type if lone and rows > 1 else None

    def add(self, item: Any) -> bool:
        """Take an item, if it is a block whose columns have the form that they should.

        Joining would hide it; the range of stamps and integers can be looked at later.
        """
        if type(item) is not self._kind or not item.is_well_formed():
            return False
        if not self._held:
            self._since = monotonic()
        self._held.append(item)
        self._count += len(item.t)
        return True

    @property
    def is_full(self) -> bool:
        """Whether what is held should go on."""
        return self._count >= self._rows or monotonic() - self._since >= PATIENCE

    def take(self) -> Iterator[Batch]:
        """Yield what was held.

        Raises:
            ContractError: a message broke the contract; what came before it was yielded.
        """
        held, self._held, self._count = self._held, [], 0
        if not held:
            return
        try:
            batch = self._intake.take(type(held[0]).concat(held))
        except ContractError:  # one of them; nothing is counted yet
            for item in held:
                yield self._intake.take(item)
            raise
        yield batch


def gathered(feed: Generator[Batch], rows: int = ROWS) -> Generator[Batch]:
    """Yield the batches of a feed joined until a port has so many rows, or `PATIENCE` is over."""
    held: list[Batch] = []
    counts: dict[int, int] = {}
    since = monotonic()
    try:
        for batch in feed:
            held.append(batch)
            for port, block in batch.messages:
                counts[port] = counts.get(port, 0) + len(block)
            if max(counts.values(), default=0) >= rows or monotonic() - since >= PATIENCE:
                yield _joined(held)
                held, counts, since = [], {}, monotonic()
    except RAISED:  # what came before the failure is not lost
        if held:
            yield _joined(held)
        raise
    finally:
        feed.close()
    if held:
        yield _joined(held)


def _joined(batches: list[Batch]) -> Batch:
    """Return consecutive batches of one source as one."""
    if len(batches) == 1:
        return batches[0]
    blocks: dict[int, list[Any]] = {}
    for batch in batches:
        for port, block in batch.messages:
            blocks.setdefault(port, []).append(block)
    joined = [(port, type(parts[0]).concat(parts)) for port, parts in sorted(blocks.items())]
    return Batch(joined, batches[-1].bound)
