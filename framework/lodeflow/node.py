"""Node and Source: what a plugin author subclasses, and what the class says of its ports."""

from __future__ import annotations

import inspect
import logging
import types
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, NamedTuple, Union, get_args, get_origin, get_type_hints

from lodeflow.clock import Clock
from lodeflow.errors import NodeError, did_you_mean
from lodeflow.messages.cdr import StreamConstants
from lodeflow.messages.message import Message
from lodeflow.params import Params as BaseParams
from lodeflow.sync import Bound, Each, Exact, Hold, Nearest, Sparse, Sync

SINGLE_PORT = "out"
"""Name of the output port of a node that returns one message."""


class InputPort(NamedTuple):
    """An input: its name, message type, and whether it may be left unwired."""

    name: str
    type: type[Message]
    optional: bool


class OutputPort(NamedTuple):
    """An output: its name, message type, and which methods write it."""

    name: str
    type: type[Message]
    by_step: bool
    by_finish: bool


@dataclass(frozen=True)
class NodeSpec:
    """What a plugin class declares.

    Attributes:
        inputs: in the order of the step's arguments; none for a source.
        outputs: ports written by `step`, `step_block`, `finish` or `read`.
        sync: how two or more inputs meet.
        has_step: samples are handled by `step`.
        has_block: blocks are handled by `step_block`.
        is_source: the class is a Source.
        step_tuple: `step` returns a NamedTuple of ports, not a single message.
        finish_tuple: `finish` returns a NamedTuple of ports, not a single message.
    """

    inputs: tuple[InputPort, ...]
    outputs: tuple[OutputPort, ...]
    sync: Sync | None
    has_step: bool
    has_block: bool
    is_source: bool
    step_tuple: bool
    finish_tuple: bool

    def input(self, name: str) -> InputPort | None:
        """Return the input of that name."""
        return next((port for port in self.inputs if port.name == name), None)

    def output(self, name: str) -> OutputPort | None:
        """Return the output of that name."""
        return next((port for port in self.outputs if port.name == name), None)


class Configured:
    """What nodes, sources and calibration tools share: parameters, a logger, a fresh start.

    Attributes:
        Params: the parameters; the base has none.
        example: values for parameters without default, for documentation and `check_node`.
    """

    Params: ClassVar[type[BaseParams]] = BaseParams
    example: ClassVar[Mapping[str, Any]] = {}
    spec: ClassVar[NodeSpec]

    def __init_subclass__(cls, **kwargs: Any) -> None:
        super().__init_subclass__(**kwargs)
        declared: Any = cls.Params
        if not (isinstance(declared, type) and issubclass(declared, BaseParams)):
            raise NodeError(f"{named(cls)}: Params must be a subclass of lodeflow.Params")

    def __init__(self, params: BaseParams | None = None, *, name: str = "") -> None:
        self.params: Any = self.Params() if params is None else params
        self.name = name or type(self).__name__
        self.log = logging.getLogger(f"lodeflow.node.{self.name}")

    def start(self) -> None:
        """Set up all state. Called before the first message; calling it again resets the node."""


class Node(Configured):
    """Base of the nodes that turn messages into messages.

    Implement `step(samples...)` or `step_block(blocks...)`, or both if both call one kernel. The
    arguments are the input ports, the return annotation the output: one message type, or a
    NamedTuple whose fields are the ports. `None` says nothing. `finish()` may emit at the end.

    Attributes:
        sync: how two or more inputs meet (required then, refused otherwise).
        lookback: how far, in nanoseconds, an output may lie before the row it comes from.
    """

    sync: ClassVar[Sync | None] = None
    lookback: int = 0

    def __init_subclass__(cls, **kwargs: Any) -> None:
        super().__init_subclass__(**kwargs)
        if "step" in vars(cls) or "step_block" in vars(cls) or hasattr(cls, "spec"):
            cls.spec = _node_spec(cls)


class Source(Configured):
    """Base of the nodes that bring messages in.

    Implement `read(clock)`, a generator of samples, blocks, NamedTuples of them (several ports),
    or `Bound(t)`. It yields everything it has for one stamp at once: after a yield that reached
    stamp T, nothing at or below T may follow on any port (unless `max_delay` says otherwise).

    Attributes:
        max_delay: for live devices, how late (ns) behind the clock a sample may come; the source
            is then read in a thread of its own. None for data that is all there.
        own_bounds: a live source says by itself, with `Bound`, how far it has come; else its
            bound follows the clock, `max_delay` behind it.
    """

    max_delay: ClassVar[int | None] = None
    own_bounds: ClassVar[bool] = False

    def __init_subclass__(cls, **kwargs: Any) -> None:
        super().__init_subclass__(**kwargs)
        if "read" in vars(cls):
            cls.spec = _source_spec(cls)

    def read(self, clock: Clock) -> Iterator[Any]:
        """Yield what there is, in the order of its stamps."""
        raise NotImplementedError

    def constants(self) -> Mapping[str, StreamConstants]:
        """Return what does not change within the streams of some ports, by port.

        That is the frame_id of their headers, and ROS members that the message type does not
        declare, such as covariances. They are written into recordings; what is left out has the
        defaults of the type. Asked for once, before `read`.
        """
        return {}


def named(cls: type) -> str:
    """Return the name of a class and its file, as errors name it."""
    try:
        return f"{cls.__module__}.{cls.__qualname__} ({inspect.getsourcefile(cls)})"
    except (OSError, TypeError):
        return f"{cls.__module__}.{cls.__qualname__}"


def _hints(cls: type, annotated: Any) -> dict[str, Any]:
    """Return the annotations of a method, or of a NamedTuple that it names."""
    try:
        return get_type_hints(annotated, localns=dict(vars(cls)))
    except (NameError, AttributeError) as error:
        raise NodeError(
            f"{named(cls)}: {annotated.__name__}: {error}; annotations are read when the class "
            "is defined, so import the message types outside of TYPE_CHECKING"
        ) from None


def _without_none(hint: Any) -> tuple[Any, ...]:
    if get_origin(hint) in (Union, types.UnionType):
        return tuple(arg for arg in get_args(hint) if arg is not type(None))
    return () if hint in (None, type(None)) else (hint,)


def _is_message(hint: Any) -> bool:
    return isinstance(hint, type) and issubclass(hint, Message) and bool(hint.ros)


def input_ports(cls: type, method: Any) -> tuple[InputPort, ...]:
    """Return the inputs that the arguments of a method declare.

    Raises:
        NodeError: names the argument, and what is wrong with it.
    """
    hints = _hints(cls, method)
    ports = []
    is_sparse = method.__name__ == "step_block" and isinstance(getattr(cls, "sync", None), Each)
    for argument in list(inspect.signature(method).parameters.values())[1:]:
        where = f"{named(cls)}: {method.__name__}: argument {argument.name!r}"
        if argument.kind not in (argument.POSITIONAL_ONLY, argument.POSITIONAL_OR_KEYWORD):
            raise NodeError(f"{where}: an input is a plain argument, not * or **")
        if argument.default not in (argument.empty, None):
            raise NodeError(f"{where}: the only default is None, which makes an input optional")
        (kind, *more) = _without_none(hints.get(argument.name)) or (None,)
        sparse = get_origin(kind) is Sparse
        if sparse:
            (kind,) = get_args(kind)
        if more or not _is_message(kind):
            raise NodeError(f"{where} needs a message type as annotation")
        if sparse is not is_sparse:
            raise NodeError(
                f"{where} must be Sparse[{kind.__name__}]: rows of Each may lack it"
                if is_sparse
                else f"{where}: Sparse is for step_block with sync = Each()"
            )
        ports.append(InputPort(argument.name, kind, argument.default is None))
    return tuple(ports)


def _outputs(cls: type, method: Any, hint: Any) -> tuple[dict[str, type[Message]], bool]:
    """Return the ports that a return annotation declares, and whether they are a NamedTuple."""
    kinds = _without_none(hint)
    if not kinds:
        return {}, False
    (kind, *more) = kinds
    if not more and _is_message(kind):
        return {SINGLE_PORT: kind}, False
    if not more and isinstance(kind, type) and issubclass(kind, tuple) and hasattr(kind, "_fields"):
        ports = {}
        for name, field in _hints(cls, kind).items():
            (inner, *rest) = _without_none(field) or (None,)
            if rest or not _is_message(inner):
                raise NodeError(
                    f"{named(cls)}: {method.__name__}: port {name!r} of {kind.__name__} "
                    "needs a message type"
                )
            ports[name] = inner
        return ports, True
    verb = "yield" if method.__name__ == "read" else "return"
    raise NodeError(
        f"{named(cls)}: {method.__name__} must {verb} one message type, a NamedTuple of them, "
        f"or None, not {hint!r}"
    )


def _node_spec(cls: type[Node]) -> NodeSpec:
    methods = [getattr(cls, name) for name in ("step", "step_block") if hasattr(cls, name)]
    inputs = [input_ports(cls, method) for method in methods]
    returned = [_outputs(cls, m, _hints(cls, m).get("return")) for m in methods]
    if inputs[0] != inputs[-1] or returned[0] != returned[-1]:
        raise NodeError(f"{named(cls)}: step and step_block declare different ports")
    if not inputs[0]:
        raise NodeError(f"{named(cls)}: {methods[0].__name__} has no input; see Source")
    stepped, step_tuple = returned[0]
    finished: dict[str, type[Message]] = {}
    finish_tuple = False
    if finish := getattr(cls, "finish", None):
        finished, finish_tuple = _outputs(cls, finish, _hints(cls, finish).get("return"))
    for name in stepped.keys() & finished.keys():
        if stepped[name] is not finished[name]:
            raise NodeError(
                f"{named(cls)}: port {name!r} is {stepped[name].__name__} in step and "
                f"{finished[name].__name__} in finish; give them names in a NamedTuple"
            )
    outputs = tuple(
        OutputPort(name, kind, name in stepped, name in finished)
        for name, kind in {**stepped, **finished}.items()
    )
    _check_sync(cls, inputs[0])
    _check_span(cls, "lookback")
    return NodeSpec(
        inputs[0],
        outputs,
        cls.sync,
        has_step=hasattr(cls, "step"),
        has_block=hasattr(cls, "step_block"),
        is_source=False,
        step_tuple=step_tuple,
        finish_tuple=finish_tuple,
    )


def _check_sync(cls: type[Node], inputs: tuple[InputPort, ...]) -> None:
    names = [port.name for port in inputs]
    if len(inputs) > 1 and cls.sync is None:
        raise NodeError(
            f"{named(cls)}: {len(inputs)} inputs ({', '.join(names)}) and no sync; declare how "
            "they meet: sync = Exact(), Nearest(lead, within), Hold(lead) or Each()"
        )
    if len(inputs) == 1 and cls.sync is not None:
        raise NodeError(f"{named(cls)}: one input needs no sync")
    if cls.sync is not None and not isinstance(cls.sync, (Exact, Nearest, Hold, Each)):
        raise NodeError(f"{named(cls)}: sync is {cls.sync!r}; write for example sync = Exact()")
    if isinstance(cls.sync, (Nearest, Hold)) and cls.sync.lead not in names:
        raise NodeError(
            f"{named(cls)}: the sync leads by {cls.sync.lead!r}, which is no input"
            f"{did_you_mean(cls.sync.lead, names)} (inputs: {', '.join(names)})"
        )
    if isinstance(cls.sync, Nearest) and not _is_span(cls.sync.within):
        raise NodeError(f"{named(cls)}: Nearest: within {_SPAN}, not {cls.sync.within!r}")
    if isinstance(cls.sync, Hold):
        _check_hold(cls, cls.sync, inputs)
    first_leads = isinstance(cls.sync, Exact) or len(names) == 1
    lead = names[0] if first_leads else getattr(cls.sync, "lead", None)
    for port in inputs:
        if port.name == lead and port.optional:
            what = "lead" if len(names) > 1 else "only input"
            raise NodeError(f"{named(cls)}: the {what} {lead!r} cannot be optional")


_SPAN = "must be a whole number of nanoseconds from 0 up (see seconds)"


def _is_span(value: Any) -> bool:
    return type(value) is int and value >= 0


def _check_span(cls: type, name: str) -> None:
    """Look at a duration that the class declares, unless an instance computes it."""
    value = getattr(cls, name)
    if value is not None and not isinstance(value, property) and not _is_span(value):
        raise NodeError(f"{named(cls)}: {name} {_SPAN}, not {value!r}")


def _check_hold(cls: type[Node], sync: Hold, inputs: tuple[InputPort, ...]) -> None:
    held = {port.name: port.type for port in inputs if port.name != sync.lead}
    for name, message in (sync.initial or {}).items():
        if name not in held:
            raise NodeError(
                f"{named(cls)}: Hold: initial for {name!r}, which is not held"
                f"{did_you_mean(name, held)}"
            )
        if type(message) is not held[name] or message.is_block:
            raise NodeError(
                f"{named(cls)}: Hold: initial for {name!r} must be a sample of "
                f"{held[name].__name__}"
            )
    if sync.delay and set(sync.initial or {}) != set(held):
        missing = ", ".join(sorted(set(held) - set(sync.initial or {})))
        raise NodeError(f"{named(cls)}: Hold with delay needs an initial message for {missing}")


def _source_spec(cls: type[Source]) -> NodeSpec:
    hint = _hints(cls, cls.read).get("return")
    ports: dict[str, type[Message]] = {}
    is_tuple = False
    yielded = [kind for arg in get_args(hint)[:1] for kind in _without_none(arg)]
    messages = [kind for kind in yielded if kind is not Bound]
    if len(messages) > 1:
        raise NodeError(
            f"{named(cls)}: read yields {len(messages)} types; make them the ports of a NamedTuple"
        )
    if messages:
        ports, is_tuple = _outputs(cls, cls.read, messages[0])
    if not ports:
        raise NodeError(
            f"{named(cls)}: read must say what it yields, for example Iterator[Imu]; got {hint!r}"
        )
    _check_span(cls, "max_delay")
    outputs = tuple(OutputPort(name, kind, True, False) for name, kind in ports.items())
    return NodeSpec(
        (),
        outputs,
        None,
        has_step=False,
        has_block=False,
        is_source=True,
        step_tuple=is_tuple,
        finish_tuple=False,
    )
