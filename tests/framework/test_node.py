"""What a node or source may declare, and what is read from it."""

from __future__ import annotations

from collections.abc import Generator, Iterator
from typing import NamedTuple, Optional

import lodeflow as lf
from lodeflow.node import InputPort, OutputPort


class Both(NamedTuple):
    heading: lf.Heading | None
    mode: lf.Mode | None


def test_one_input_and_one_output() -> None:
    class Node(lf.Node):
        def step(self, imu: lf.Imu) -> lf.Heading | None: ...

    spec = Node.spec
    assert spec.inputs == (InputPort("imu", lf.Imu, False),)
    assert spec.outputs == (OutputPort("out", lf.Heading, True, False),)
    assert (spec.sync, spec.has_step, spec.has_block, spec.is_source) == (None, True, False, False)
    assert spec.input("imu") is spec.inputs[0]
    assert spec.input("out") is None
    assert spec.output("out") is spec.outputs[0]
    assert spec.output("imu") is None


def test_several_inputs_and_outputs() -> None:
    class Node(lf.Node):
        sync = lf.Nearest("imu", within=5)

        def step_block(
            self,
            imu: lf.Imu,
            mag: Optional[lf.MagneticField] = None,  # noqa: UP045
        ) -> Both | None: ...

        def finish(self) -> lf.AttitudeScore: ...

    spec = Node.spec
    assert spec.inputs == (
        InputPort("imu", lf.Imu, False),
        InputPort("mag", lf.MagneticField, True),
    )
    assert spec.outputs == (
        OutputPort("heading", lf.Heading, True, False),
        OutputPort("mode", lf.Mode, True, False),
        OutputPort("out", lf.AttitudeScore, False, True),
    )
    assert (spec.has_step, spec.has_block) == (False, True)
    assert (spec.step_tuple, spec.finish_tuple) == (True, False)


def test_step_and_finish_may_write_one_port() -> None:
    class Node(lf.Node):
        def step(self, imu: lf.Imu) -> lf.Heading | None: ...

        def finish(self) -> lf.Heading | None: ...

    assert Node.spec.outputs == (OutputPort("out", lf.Heading, True, True),)


def test_a_node_without_return_is_a_sink() -> None:
    class Node(lf.Node):
        def step(self, imu: lf.Imu) -> None: ...

    assert Node.spec.outputs == ()


def test_under_each_a_block_step_has_sparse_inputs() -> None:
    class Node(lf.Node):
        sync = lf.Each()

        def step_block(
            self, a: lf.Sparse[lf.Heading], b: lf.Sparse[lf.Mode] | None = None
        ) -> None: ...

        def step(self, a: lf.Heading | None, b: lf.Mode | None = None) -> None: ...

    assert Node.spec.inputs == (
        InputPort("a", lf.Heading, False),
        InputPort("b", lf.Mode, True),
    )


def test_a_subclass_declares_anew() -> None:
    class Base(lf.Node):
        sync = lf.Exact()

        def step(self, x: lf.Heading, y: lf.Heading) -> lf.Heading: ...

    class Held(Base):
        sync = lf.Hold("y")

    assert Base.spec.sync == lf.Exact()
    assert Held.spec.sync == lf.Hold("y")


def test_a_base_class_without_step_is_no_plugin_yet() -> None:
    class Base(lf.Node):
        sync = lf.Exact()

    assert not hasattr(Base, "spec")


def test_a_source() -> None:
    class One(lf.Source):
        def read(self, clock: lf.Clock) -> Iterator[lf.Imu | lf.Bound]: ...

    class Two(lf.Source):
        max_delay = 5

        def read(self, clock: lf.Clock) -> Generator[Both | None, None, None]: ...

    assert One.spec.outputs == (OutputPort("out", lf.Imu, True, False),)
    assert One.spec.is_source
    assert not One.spec.step_tuple
    assert [port.name for port in Two.spec.outputs] == ["heading", "mode"]
    assert Two.spec.step_tuple


def test_a_plugin_has_parameters_a_name_and_a_logger() -> None:
    class Node(lf.Node):
        class Params(lf.Params):
            gain: float = 2.0

        def step(self, x: lf.Heading) -> None: ...

    assert Node().params.gain == 2.0
    assert Node().name == "Node"
    named = Node(Node.Params(gain=3.0), name="fuser")
    assert (named.params.gain, named.name, named.log.name) == (3.0, "fuser", "lodeflow.node.fuser")
    assert named.start() is None


def test_a_lookback_may_be_computed() -> None:
    class Node(lf.Node):
        class Params(lf.Params):
            window: int = 5

        @property
        def lookback(self) -> int:
            return self.params.window * 2

        def step(self, imu: lf.Imu) -> None: ...

    assert Node(Node.Params(window=4)).lookback == 8
