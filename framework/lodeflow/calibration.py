"""CalibrationTool: from the streams of recordings to the parameters of a node."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar

from lodeflow.errors import NodeError
from lodeflow.node import Configured, InputPort, input_ports, named


@dataclass(frozen=True, eq=False)
class Quantity:
    """One line of what a calibration found.

    Attributes:
        name: what it is, in words.
        value: a number, or an array of them; NaN where the data do not tell.
        unit: its symbol, "" for none.
        error: standard error of the value, of the same shape; None where there is none to give.
    """

    name: str
    value: Any
    unit: str = ""
    error: Any = None


@dataclass(frozen=True, eq=False)
class Calibration:
    """What a calibration tool found.

    Attributes:
        plugin: name of the plugin that the parameters are for; "" where nothing reads them.
        params: its parameters, as numbers, arrays, lists and texts.
        quantities: what to print: results with standard errors, residuals, condition number.
        notes: what a user should know: what was not observable, what looks odd.
        draw: draws the figure, given an empty matplotlib Figure; None for no figure.
    """

    plugin: str
    params: Mapping[str, Any]
    quantities: Sequence[Quantity]
    notes: Sequence[str] = field(default=())
    draw: Callable[[Any], None] | None = None


class CalibrationTool(Configured):
    """Base of the kinds of `lodeflow calibrate KIND REC...`.

    Implement `calibrate(streams...) -> Calibration`. Its arguments are the streams that it reads,
    declared as a node declares its inputs: `raw: RawField` is needed, `force: SpecificForce | None
    = None` may be left out. Each is one block with all rows of the recordings in the order of
    their stamps; where a recording does not follow the one before it by itself, its stamps, alike
    in all streams, are moved behind it with a gap of an hour. Data that do not determine what is
    asked are refused with a CalibrationError that says what to record.

    A plugin package brings kinds by the hook `lodeflow_calibrations`. The tool sees no file: the
    framework finds the streams, writes the calibration file, and saves the figure.

    Attributes:
        streams: what `calibrate` reads.
    """

    streams: ClassVar[tuple[InputPort, ...]] = ()
    calibrate: Callable[..., Calibration]

    def __init_subclass__(cls, **kwargs: Any) -> None:
        super().__init_subclass__(**kwargs)
        if "calibrate" in vars(cls):
            cls.streams = input_ports(cls, cls.calibrate)
            if not cls.streams:
                raise NodeError(f"{named(cls)}: calibrate reads no stream")
