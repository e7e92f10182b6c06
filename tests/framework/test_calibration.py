"""Calibration tools: what a class declares, and what is refused."""

from __future__ import annotations

import pytest

import lodeflow as lf


class Tool(lf.CalibrationTool):
    class Params(lf.Params):
        scale: float = 1.0

    def calibrate(self, raw: lf.RawField, force: lf.SpecificForce | None = None) -> lf.Calibration:
        return lf.Calibration("", {}, [lf.Quantity("rows", len(raw))])


def test_streams_are_the_arguments() -> None:
    assert [(port.name, port.type, port.optional) for port in Tool.streams] == [
        ("raw", lf.RawField, False),
        ("force", lf.SpecificForce, True),
    ]
    found = Tool(name="tool").calibrate(lf.RawField.empty())
    assert found.quantities[0].value == 0
    assert found.draw is None


def test_what_reads_nothing_is_no_tool() -> None:
    with pytest.raises(lf.NodeError, match="calibrate reads no stream"):

        class Deaf(lf.CalibrationTool):
            def calibrate(self) -> lf.Calibration:
                raise NotImplementedError


def test_an_argument_needs_a_message_type() -> None:
    with pytest.raises(lf.NodeError, match="argument 'raw' needs a message type"):

        class Untyped(lf.CalibrationTool):
            def calibrate(self, raw: int) -> lf.Calibration:
                raise NotImplementedError
