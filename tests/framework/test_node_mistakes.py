"""The full text of each mistake in the declaration of a node or source."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple

import numpy as np
import pytest

import lodeflow as lf
from lodeflow.errors import NodeError

if TYPE_CHECKING:
    from lodeflow import Heading as Unseen


class Wrong(NamedTuple):
    heading: lf.Heading
    number: int


class Unresolved(NamedTuple):
    heading: Nowhere  # noqa: F821


def reason(define: Callable[[], object]) -> str:
    """Return what is said of the class that `define` makes, behind its name and file."""
    with pytest.raises(NodeError) as found:
        define()
    where, colon, text = str(found.value).partition(".py): ")
    assert colon, str(found.value)
    assert where.startswith(f"{__name__}.")
    assert "<locals>.Bad (" in where
    return text


def test_annotations_that_cannot_be_resolved() -> None:
    def unknown() -> None:
        class Bad(lf.Node):
            def step(self, x: Unseen) -> None: ...

    assert reason(unknown) == (
        "step: name 'Unseen' is not defined; annotations are read when the class is defined, so "
        "import the message types outside of TYPE_CHECKING"
    )

    def misspelt() -> None:
        class Bad(lf.Node):
            def step(self, x: lf.Headng) -> None: ...

    assert reason(misspelt) == (
        "step: module 'lodeflow' has no attribute 'Headng'; annotations are read when the class is "
        "defined, so import the message types outside of TYPE_CHECKING"
    )

    def in_the_tuple() -> None:
        class Bad(lf.Node):
            def step(self, x: lf.Heading) -> Unresolved: ...

    assert reason(in_the_tuple).startswith("Unresolved: name 'Nowhere' is not defined; ")


def test_inputs() -> None:
    def stars() -> None:
        class Bad(lf.Node):
            def step(self, *x: lf.Heading) -> None: ...

    assert reason(stars) == "step: argument 'x': an input is a plain argument, not * or **"

    def keyword_only() -> None:
        class Bad(lf.Node):
            def step_block(self, *, x: lf.Heading) -> None: ...

    assert reason(keyword_only) == (
        "step_block: argument 'x': an input is a plain argument, not * or **"
    )

    def bare() -> None:
        class Bad(lf.Node):
            def step(self, x) -> None: ...

    assert reason(bare) == "step: argument 'x' needs a message type as annotation"

    def number() -> None:
        class Bad(lf.Node):
            def step(self, x: float) -> None: ...

    assert reason(number) == "step: argument 'x' needs a message type as annotation"

    def two() -> None:
        class Bad(lf.Node):
            def step(self, x: lf.Heading | lf.Mode) -> None: ...

    assert reason(two) == "step: argument 'x' needs a message type as annotation"

    def abstract() -> None:
        class Bad(lf.Node):
            def step(self, x: lf.Score) -> None: ...

    assert reason(abstract) == "step: argument 'x' needs a message type as annotation"

    def default() -> None:
        class Bad(lf.Node):
            def step(self, x: lf.Heading = 3) -> None: ...

    assert reason(default) == (
        "step: argument 'x': the only default is None, which makes an input optional"
    )

    def none() -> None:
        class Bad(lf.Node):
            def step(self) -> None: ...

    assert reason(none) == "step has no input; see Source"

    def not_even_self() -> None:
        class Bad(lf.Node):
            def step_block() -> None: ...

    assert reason(not_even_self) == "step_block has no input; see Source"


def test_sparse_inputs() -> None:
    def without_each() -> None:
        class Bad(lf.Node):
            def step_block(self, x: lf.Sparse[lf.Heading]) -> None: ...

    assert reason(without_each) == (
        "step_block: argument 'x': Sparse is for step_block with sync = Each()"
    )

    def in_step() -> None:
        class Bad(lf.Node):
            sync = lf.Each()

            def step(self, x: lf.Sparse[lf.Heading], y: lf.Heading) -> None: ...

    assert reason(in_step) == "step: argument 'x': Sparse is for step_block with sync = Each()"

    def missing() -> None:
        class Bad(lf.Node):
            sync = lf.Each()

            def step_block(self, x: lf.Heading, y: lf.Heading) -> None: ...

    assert reason(missing) == (
        "step_block: argument 'x' must be Sparse[Heading]: rows of Each may lack it"
    )


def test_outputs() -> None:
    def number() -> None:
        class Bad(lf.Node):
            def step(self, x: lf.Heading) -> float: ...

    assert reason(number) == (
        "step must return one message type, a NamedTuple of them, or None, not <class 'float'>"
    )

    def two() -> None:
        class Bad(lf.Node):
            def finish(self) -> lf.Heading | lf.Mode: ...

            def step(self, x: lf.Heading) -> None: ...

    assert reason(two) == (
        "finish must return one message type, a NamedTuple of them, or None, not "
        "lodeflow.messages.vocabulary.Heading | lodeflow.messages.vocabulary.Mode"
    )

    def plain_tuple() -> None:
        class Bad(lf.Node):
            def step(self, x: lf.Heading) -> tuple[lf.Heading, lf.Mode]: ...

    assert reason(plain_tuple).startswith(
        "step must return one message type, a NamedTuple of them, or None, not tuple["
    )

    def port() -> None:
        class Bad(lf.Node):
            def step(self, x: lf.Heading) -> Wrong: ...

    assert reason(port) == "step: port 'number' of Wrong needs a message type"


def test_two_methods_that_disagree() -> None:
    def inputs() -> None:
        class Bad(lf.Node):
            def step(self, x: lf.Heading) -> None: ...
            def step_block(self, y: lf.Heading) -> None: ...

    assert reason(inputs) == "step and step_block declare different ports"

    def outputs() -> None:
        class Bad(lf.Node):
            def step(self, x: lf.Heading) -> None: ...
            def step_block(self, x: lf.Heading) -> lf.Heading: ...

    assert reason(outputs) == "step and step_block declare different ports"

    def finish() -> None:
        class Bad(lf.Node):
            def step(self, x: lf.Heading) -> lf.Heading: ...
            def finish(self) -> lf.Mode: ...

    assert reason(finish) == (
        "port 'out' is Heading in step and Mode in finish; give them names in a NamedTuple"
    )


def with_sync(value: Any, lookback_: Any = 0) -> Callable[[], None]:
    def define() -> None:
        class Bad(lf.Node):
            sync = value
            lookback = lookback_

            def step(self, imu: lf.Imu, mag: lf.MagneticField) -> None: ...

    return define


SPAN = "must be a whole number of nanoseconds from 0 up (see seconds)"


@pytest.mark.parametrize(
    ("sync", "text"),
    [
        (
            None,
            "2 inputs (imu, mag) and no sync; declare how they meet: sync = Exact(), "
            "Nearest(lead, within), Hold(lead) or Each()",
        ),
        (
            lf.Exact,
            "sync is <class 'lodeflow.sync.Exact'>; write for example sync = Exact()",
        ),
        ("exact", "sync is 'exact'; write for example sync = Exact()"),
        (
            lf.Hold("mga"),
            "the sync leads by 'mga', which is no input, did you mean 'mag'? (inputs: imu, mag)",
        ),
        (
            lf.Nearest("compass", 5),
            "the sync leads by 'compass', which is no input (inputs: imu, mag)",
        ),
        (lf.Nearest("imu", -1), f"Nearest: within {SPAN}, not -1"),
        (lf.Nearest("imu", 0.01), f"Nearest: within {SPAN}, not 0.01"),
        (
            lf.Hold("imu", initial={"imu": lf.Imu.of(0)}),
            "Hold: initial for 'imu', which is not held",
        ),
        (
            lf.Hold("imu", initial={"mga": lf.MagneticField.of(0)}),
            "Hold: initial for 'mga', which is not held, did you mean 'mag'?",
        ),
        (
            lf.Hold("imu", initial={"mag": lf.RawField.of(0)}),
            "Hold: initial for 'mag' must be a sample of MagneticField",
        ),
        (
            lf.Hold("imu", initial={"mag": lf.MagneticField(np.arange(1), np.ones((1, 3)))}),
            "Hold: initial for 'mag' must be a sample of MagneticField",
        ),
        (lf.Hold("imu", delay=True), "Hold with delay needs an initial message for mag"),
    ],
)
def test_sync(sync: Any, text: str) -> None:
    assert reason(with_sync(sync)) == text


def test_one_input_needs_no_sync() -> None:
    def define() -> None:
        class Bad(lf.Node):
            sync = lf.Exact()

            def step(self, imu: lf.Imu) -> None: ...

    assert reason(define) == "one input needs no sync"


def test_what_leads_cannot_be_optional() -> None:
    def exact() -> None:
        class Bad(lf.Node):
            sync = lf.Exact()

            def step(self, imu: lf.Imu = None, mag: lf.MagneticField = None) -> None: ...

    assert reason(exact) == "the lead 'imu' cannot be optional"

    def hold() -> None:
        class Bad(lf.Node):
            sync = lf.Hold("mag")

            def step(self, imu: lf.Imu, mag: lf.MagneticField = None) -> None: ...

    assert reason(hold) == "the lead 'mag' cannot be optional"

    def single() -> None:
        class Bad(lf.Node):
            def step(self, imu: lf.Imu = None) -> None: ...

    assert reason(single) == "the only input 'imu' cannot be optional"


@pytest.mark.parametrize("value", [-1, 0.5, "1 s", True])
def test_lookback_and_max_delay_are_nanoseconds(value: Any) -> None:
    assert reason(with_sync(lf.Exact(), value)) == f"lookback {SPAN}, not {value!r}"

    def source() -> None:
        class Bad(lf.Source):
            max_delay = value

            def read(self, clock: lf.Clock) -> Iterator[lf.Imu]: ...

    assert reason(source) == f"max_delay {SPAN}, not {value!r}"


def test_params_are_params() -> None:
    def define() -> None:
        class Bad(lf.Node):
            class Params:
                gain: ClassVar = 2.0

            def step(self, imu: lf.Imu) -> None: ...

    assert reason(define) == "Params must be a subclass of lodeflow.Params"


EXAMPLE = "read must say what it yields, for example Iterator[Imu]; got"


def test_sources() -> None:
    def nothing() -> None:
        class Bad(lf.Source):
            def read(self, clock: lf.Clock): ...

    assert reason(nothing) == f"{EXAMPLE} None"

    def message() -> None:
        class Bad(lf.Source):
            def read(self, clock: lf.Clock) -> lf.Imu: ...

    assert reason(message) == f"{EXAMPLE} <class 'lodeflow.messages.vocabulary.Imu'>"

    def bounds() -> None:
        class Bad(lf.Source):
            def read(self, clock: lf.Clock) -> Iterator[lf.Bound]: ...

    assert reason(bounds).startswith(EXAMPLE)

    def two() -> None:
        class Bad(lf.Source):
            def read(self, clock: lf.Clock) -> Iterator[lf.Imu | lf.Bound | lf.Mode]: ...

    assert reason(two) == "read yields 2 types; make them the ports of a NamedTuple"

    def numbers() -> None:
        class Bad(lf.Source):
            def read(self, clock: lf.Clock) -> Iterator[float]: ...

    assert reason(numbers) == (
        "read must yield one message type, a NamedTuple of them, or None, not <class 'float'>"
    )


def test_a_class_without_file_is_named_all_the_same() -> None:
    with pytest.raises(NodeError) as found:
        exec(
            "class Bad(lf.Node):\n    def step(self): ...\n",
            {"lf": lf, "__name__": "nowhere"},
        )
    assert str(found.value) == "nowhere.Bad: step has no input; see Source"


def test_read_of_the_base_class_is_not_implemented() -> None:
    with pytest.raises(NotImplementedError):
        lf.Source().read(None)
