"""For tests of plugins: run a node on data, and prove that a node keeps the contract.

from lodeflow.testing import check_node, run_node

def test_doubler() -> None:
    check_node(Doubler)
    out = run_node(Doubler, rate=[lf.AngularRate.of(0, angular_rate=[1, 2, 3])])
    assert out["out"].angular_rate[0, 2] == 6
"""

from __future__ import annotations

import random
import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydantic import ValidationError

from lodeflow.clock import SimClock
from lodeflow.errors import ContractError, NodeError
from lodeflow.graph.model import Graph, GraphNode, Wire
from lodeflow.messages.cdr import layout_of
from lodeflow.messages.fields import FieldSpec, Quaternion
from lodeflow.messages.message import Message
from lodeflow.messages.units import STANDARD_GRAVITY
from lodeflow.node import Node, Source
from lodeflow.params import Params
from lodeflow.purity import impurity
from lodeflow.runtime.blocks import BlockDriver
from lodeflow.runtime.feed import feeds
from lodeflow.runtime.plan import Plan
from lodeflow.runtime.samples import SampleDriver
from lodeflow.sync import END, Nearest

ROWS = 240
SPLITS = 4

Inputs = Mapping[str, Message | Sequence[Message]]
Streams = dict[str, list[tuple[int, bytes]]]


def run_node(
    plugin: type[Node], params: Mapping[str, Any] | None = None, **inputs: Any
) -> dict[str, Any]:
    """Run a node on whole inputs and return what each port sent, as a block per port.

    Args:
        plugin: the class.
        params: values of its parameters; `plugin.example` if None.
        inputs: a block, or a list of samples, per input port.

    Raises:
        NodeFailure, ContractError: as in a run.
        NodeError: its parameters have no value, or one that does not fit.
    """
    harness = Harness(plugin, params, inputs)
    sent = harness.run_blocks([END])
    return {port.name: port.type.concat(sent[port.name]) for port in plugin.spec.outputs}


def check_node(
    plugin: type[Node] | type[Source],
    params: Mapping[str, Any] | None = None,
    *,
    inputs: Inputs | None = None,
    seed: int = 0,
    duration: int = 2_000_000_000,
) -> None:
    """Prove that a plugin keeps the contract, or say which rule it broke.

    For a node: any split of its inputs into blocks, and single samples, give the same bytes;
    `start()` resets; inputs are not modified; no wall clock or global random generator is used;
    stamps obey the rules of event time; numba compiles in `start()`, unless it has in an earlier
    test. For a source: two runs give the same bytes, and nothing of what it yields has to be
    dropped.

    Args:
        plugin: the class.
        params: values of its parameters; `plugin.example` if None.
        inputs: a block, or a list of samples, per input port; random data if None.
        seed: of the random data and splits.
        duration: of event time for which a source is read, in nanoseconds.

    Raises:
        ContractError: names the plugin and the rule.
        NodeError: its parameters have no value, or one that does not fit.
    """
    if call := impurity(plugin):
        raise _broken(
            plugin,
            f"no wall clock and no global random generator ({call}); "
            "use the stamps, a Clock, or np.random.default_rng(seed)",
        )
    with _named(plugin):
        if issubclass(plugin, Source):
            _check_source(plugin, params, duration)
        else:
            _check_node(plugin, params, inputs, seed)


def _check_node(
    plugin: type[Node], params: Mapping[str, Any] | None, inputs: Inputs | None, seed: int
) -> None:
    rng = np.random.default_rng(seed)
    harness = Harness(plugin, params, random_inputs(plugin, rng) if inputs is None else inputs)
    before = harness.fingerprint()
    harness.plan.start()
    started = _kernels()
    whole = harness.encoded(harness.run_blocks([END]))
    _check_compiled(plugin, started)
    _check_inputs(plugin, harness, before)  # first: whatever comes after would differ as well
    _compare(plugin, "start() must reset all state", whole, harness.run_blocks([END]), harness)
    cuts = random.Random(seed)
    for _ in range(SPLITS):
        stamps = sorted(cuts.sample(harness.stamps, min(len(harness.stamps), 20)))
        split = harness.run_blocks([*stamps, END])
        _compare(plugin, "any split into blocks must give the same bytes", whole, split, harness)
    every = [*harness.stamps[1:], END]
    single = harness.run_blocks(every)
    _compare(plugin, "blocks of one row must give the same bytes", whole, single, harness)
    samples = harness.run_samples()
    _check_compiled(plugin, started)
    _compare(plugin, "single samples must give the same bytes", whole, samples, harness)
    _check_inputs(plugin, harness, before)


def _check_inputs(plugin: type, harness: Harness, before: list[bytes]) -> None:
    if harness.fingerprint() != before:
        raise _broken(plugin, "inputs must not be modified")


def _check_compiled(plugin: type, before: set[str]) -> None:
    if late := _kernels() - before:
        raise _broken(
            plugin,
            "a function must be compiled in start(), or the first message waits for it: call it "
            f"there with arguments of these types, on no rows: {', '.join(sorted(late))}",
        )


def _kernels() -> set[str]:
    """Return what numba has compiled: the functions of all modules, with the types they take."""
    numba = sys.modules.get("numba.core.dispatcher")
    if numba is None:
        return set()
    return {
        f"{value.__module__}.{value.__qualname__}({', '.join(map(str, signature))})"
        for module in list(sys.modules.values())
        for value in list(vars(module).values())
        if isinstance(value, numba.Dispatcher)
        for signature in value.signatures
    }


def random_inputs(plugin: type[Node], rng: np.random.Generator) -> dict[str, Message]:
    """Return random data of plausible size for each input port of a node."""
    grid = np.cumsum(rng.integers(8, 13, ROWS)) * 1_000_000
    sync = plugin.spec.sync
    found = {}
    for port in plugin.spec.inputs:
        keep = rng.random(ROWS) < (0.9 if len(plugin.spec.inputs) > 1 else 1.0)
        t = grid[keep].astype(np.int64)
        if isinstance(sync, Nearest) and port.name != sync.lead:
            t = t + rng.integers(-2_000_000, 2_000_000, len(t))
        columns = [_random_column(port.type, field, len(t), rng) for field in port.type.fields]
        found[port.name] = port.type(t, *columns)
    return found


def _random_column(
    kind: type[Message], field: FieldSpec, n: int, rng: np.random.Generator
) -> NDArray[Any]:
    shape = (n, *field.shape)
    if field.integer:
        choices = list(kind.constants.values()) or [0, 1]
        return rng.choice(np.array(choices, dtype=np.int64), shape)
    column = rng.standard_normal(shape)
    if field.ros == Quaternion.ros:
        column /= np.linalg.norm(column, axis=-1, keepdims=True)
    scale = {"T": 3e-5, "LSB": 900.0, "m/s²": 1.0}.get(field.unit.symbol, 1.0)
    column *= scale
    if field.unit.symbol == "m/s²" and field.shape == (3,):
        column[:, 2] += STANDARD_GRAVITY
    if field.gaps:
        column[rng.random(n) < 0.1] = np.nan
    return column


class Harness:
    """A graph of one node, fed by hand."""

    def __init__(
        self, plugin: type[Node], params: Mapping[str, Any] | None, inputs: Inputs
    ) -> None:
        spec = plugin.spec
        ports = [port for port in spec.inputs if port.name in inputs]
        if unknown := set(inputs) - {port.name for port in ports}:
            raise TypeError(f"{plugin.__name__} has no input {', '.join(sorted(unknown))}")
        self.plugin = plugin
        self.blocks: list[Any] = []
        for port in ports:
            given = inputs[port.name]
            block = given if isinstance(given, Message) else port.type.stack(given)
            block.validate()
            self.blocks.append(block)
        columns = [block.t for block in self.blocks]
        self.stamps: list[int] = np.unique(np.concatenate(columns)).tolist() if columns else []
        source = _hand_fed({port.name: port.type for port in ports})
        node = GraphNode(
            "node",
            plugin.__name__,
            plugin,
            _params(plugin, params),
            {port.name: Wire("hand", port.name) for port in ports},
        )
        hand = GraphNode("hand", "hand", source, source.Params())
        self.graph = Graph("check", {"hand": hand, "node": node})
        self.plan = Plan(self.graph)

    def fingerprint(self) -> list[bytes]:
        """Return the bytes of all inputs."""
        return [a.tobytes() for block in self.blocks for a in (block.t, *block.values())]

    def _collect(self) -> dict[str, list[Any]]:
        # The plan, and with it the live node, is used again: start() must reset it.
        sent: dict[str, list[Any]] = {port.name: [] for port in self.plugin.spec.outputs}
        for name, into in sent.items():
            self.plan.taps[Wire("node", name)][:] = [into.append]
        self.plan.start()
        return sent

    def run_blocks(self, cuts: list[int]) -> dict[str, list[Any]]:
        """Push the inputs cut at the given stamps, the last of which is END."""
        sent = self._collect()
        driver = BlockDriver(self.plan)
        start = -(2**62)
        for cut in cuts:
            part = [
                (index, block[np.searchsorted(block.t, start) : np.searchsorted(block.t, cut)])
                for index, block in enumerate(self.blocks)
            ]
            driver.push("hand", [(index, block) for index, block in part if len(block)], cut)
            start = cut
        return sent

    def run_samples(self) -> dict[str, list[Any]]:
        """Push the inputs one by one, in the order of their stamps."""
        sent = self._collect()
        driver = SampleDriver(self.plan)
        for t in self.stamps:
            for index, block in enumerate(self.blocks):
                row = int(np.searchsorted(block.t, t))
                if row < len(block) and block.t[row] == t:
                    driver.push("hand", index, block.row(row))
            driver.promise("hand", t + 1)
        driver.promise("hand", END)
        return {
            name: [type(m).concat([m.as_block()]) if not m.is_block else m for m in messages]
            for name, messages in sent.items()
        }

    def encoded(self, sent: dict[str, list[Any]]) -> Streams:
        """Return the stamps and bytes of each port's messages."""
        streams: Streams = {}
        for port in self.plugin.spec.outputs:
            block = port.type.concat(sent[port.name])
            records = layout_of(port.type).encode_block(block)
            streams[port.name] = [
                (t, record.tobytes()) for t, record in zip(block.t.tolist(), records, strict=True)
            ]
        return streams


def _compare(
    plugin: type, rule: str, expected: Streams, sent: dict[str, list[Any]], harness: Harness
) -> None:
    found = harness.encoded(sent)
    for port, stream in expected.items():
        if stream == found[port]:
            continue
        pairs = list(zip(stream, found[port], strict=False))
        at = next((i for i, (a, b) in enumerate(pairs) if a != b), len(pairs))
        stamps = [s[at][0] if at < len(s) else "no message" for s in (stream, found[port])]
        raise _broken(
            plugin,
            f"{rule}; port '{port}' differs from message {at} on (t={stamps[0]} against "
            f"t={stamps[1]}; {len(stream)} against {len(found[port])} messages)",
        )


def _encoded(kind: type[Message], blocks: list[Any]) -> NDArray[np.uint8]:
    return layout_of(kind).encode_block(kind.concat(blocks))


def _broken(plugin: type, rule: str) -> ContractError:
    return ContractError(f"{_path(plugin)} broke the contract: {rule}")


@contextmanager
def _named(plugin: type) -> Iterator[None]:
    """Let a rule that the engine finds broken name the plugin as all others do."""
    path = _path(plugin)
    try:
        yield
    except ContractError as error:
        if str(error).startswith(path):
            raise
        raise ContractError(f"{path}: {error}") from error


def _path(plugin: type) -> str:
    return f"{plugin.__module__}.{plugin.__qualname__}"


def _params(plugin: type[Node] | type[Source], given: Mapping[str, Any] | None) -> Params:
    """Return the parameters that are given, or those of the plugin's example.

    Raises:
        NodeError: a parameter without default has no value, or a value does not fit.
    """
    values = plugin.example if given is None else given
    fields = plugin.Params.model_fields.items()
    missing = [name for name, field in fields if field.is_required() and name not in values]
    if missing:
        where = "give `example` a value" if given is None else "give a value"
        raise NodeError(f"{_path(plugin)}: {where} for {', '.join(missing)}, without default")
    try:
        return plugin.Params(**values)
    except ValidationError as error:
        why = "; ".join(
            f"{'.'.join(map(str, detail['loc'])) or 'params'}: {detail['msg']}"
            for detail in error.errors()
        )
        raise NodeError(f"{_path(plugin)}: {why}") from None


def _hand_fed(ports: dict[str, type[Message]]) -> type[Source]:
    """Return a source with these ports that has nothing of its own."""
    yielded = NamedTuple("Ports", list(ports.items()))  # type: ignore[misc]

    def read(self: Source, clock: Any) -> Iterator[Any]:
        yield from ()

    read.__annotations__["return"] = Iterator[yielded]
    return type("HandFed", (Source,), {"read": read})


def _check_source(plugin: type[Source], params: Mapping[str, Any] | None, duration: int) -> None:
    if plugin.max_delay is not None:
        return  # a device has no two equal runs
    values = _params(plugin, params)
    runs: list[dict[int, NDArray[np.uint8]]] = []
    started: set[str] | None = None
    for _ in range(2):
        node = GraphNode("source", plugin.__name__, plugin, values)
        plan = Plan(Graph("check", {"source": node}))
        (planned,) = plan.sources
        for _restart in range(2):  # start() must reset what an earlier read left
            plan.start()
            started = _kernels() if started is None else started
            sent: dict[int, list[Any]] = {}
            for batch in feeds([planned], SimClock(), duration)[planned.name]:
                for index, block in batch.messages:
                    sent.setdefault(index, []).append(block)
            if not runs:
                _check_compiled(plugin, started)
            if planned.counters.lost:
                raise _broken(
                    plugin,
                    "what it yields must be finite, and after a yield that reached stamp T nothing "
                    f"at or below T may follow; dropped: {planned.counters.lost}",
                )
            runs.append(
                {index: _encoded(plugin.spec.outputs[index].type, b) for index, b in sent.items()}
            )
    first, *others = runs
    for run in others:
        same = first.keys() == run.keys() and all(np.array_equal(first[i], run[i]) for i in first)
        if not same:
            raise _broken(plugin, "start() must reset all state, and two runs give the same bytes")
