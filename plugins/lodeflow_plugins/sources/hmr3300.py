"""The digital compass HMR3300 on a serial port.

Source: Honeywell, HMR3200/HMR3300 digital compass solutions, data sheet: ASCII lines at 19200 baud,
8 a second, "heading, pitch, roll" in degrees after *H, "x, y, z" in counts after *M; *S starts and
stops; #I answers a command that it does not know.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from typing import Annotated, ClassVar, Literal, NamedTuple

import numpy as np
from pydantic import Field

import lodeflow as lf
from lodeflow_plugins.sources.serial_lines import Faults, SerialLines

ANGLES = re.compile(r"(\d{1,3}\.\d+)\s*,\s*(-?\d{1,2}\.\d+)\s*,\s*(-?\d{1,2}\.\d+)")
COUNTS = re.compile(r"(-?\d{1,5})\s*,\s*(-?\d{1,5})\s*,\s*(-?\d{1,5})")
COMMANDS = {"heading": "*H", "field": "*M"}
LISTEN = 0.5
"""Time, s, in which a module that sends says something."""


class Ports(NamedTuple):
    """Ports of `Hmr3300`."""

    heading: lf.Heading | None
    euler: lf.EulerAngles | None
    raw: lf.RawField | None


def angles(line: str) -> tuple[float, float, float] | None:
    """Heading, pitch and roll in rad of a line such as "123.4, 18.6, -0.5"; None if it is none."""
    found = ANGLES.fullmatch(line)
    if not found:
        return None
    heading, pitch, roll = (float(number) for number in found.groups())
    if heading > 360.0 or max(abs(pitch), abs(roll)) > 90.0:
        return None
    return math.radians(heading % 360.0), math.radians(pitch), math.radians(roll)


def counts(line: str) -> np.ndarray | None:
    """The field (3,) in counts of a line such as "1256, -234, -1894"; None if it is none."""
    found = COUNTS.fullmatch(line)
    return np.array([float(n) for n in found.groups()]) if found else None


class Hmr3300(lf.Source):
    """A compass module HMR3300: heading, pitch and roll, or the raw field.

    Which of them the module sends is kept in the module; `configure` sets it first. Stamps are the
    times at which lines were complete. Lines that are neither are counted and told in the log, and
    so is silence. Needs pyserial: the extra `serial`.

    Source: Honeywell, HMR3200/HMR3300 data sheet.
    """

    max_delay: ClassVar[int] = lf.seconds(0.25)

    class Params(lf.Params):
        """The port, and what the module sends."""

        port: str
        """Device, such as /dev/ttyUSB0."""
        baud: int = Field(19200, gt=0)
        """Bits per second."""
        output: Literal["heading", "field"] = "heading"
        """Heading, pitch and roll, or the raw field."""
        configure: bool = False
        """Tell the module to send that, which it keeps; else it has to be set so already."""
        silence: Annotated[float, lf.Second] = Field(1.0, gt=0)
        """Time without a line that is worth a warning."""

    example: ClassVar = {"port": "/dev/ttyUSB0"}

    def read(self, clock: lf.Clock) -> Iterator[Ports | lf.Bound]:
        p = self.params
        faults = Faults(self.log, p.silence)
        port = SerialLines(p.port, p.baud)
        try:
            lines = port.lines(clock)
            if p.configure:
                self._configure(port, lines)
            for t, line in lines:
                if line is None:
                    faults.quiet(t)
                    yield lf.Bound(t)
                elif sample := self._sample(t, line):
                    faults.good(t)
                    yield sample
                elif line.startswith("#"):
                    self.log.warning("the module answers %s to a command", line[:20])
                elif not line.startswith("HMR"):  # it says its name when it starts
                    faults.bad(line, f"is no {p.output} of an HMR3300")
        finally:
            port.close()
            faults.finish()

    def _sample(self, t: int, line: str) -> Ports | None:
        if self.params.output == "field":
            field = counts(line)
            return None if field is None else Ports(None, None, lf.RawField(t, field))
        found = angles(line)
        if found is None:
            return None
        return Ports(lf.Heading(t, found[0]), lf.EulerAngles(t, *found), None)

    def _configure(self, port: SerialLines, lines: Iterator[tuple[int, str | None]]) -> None:
        """Set the output. *S toggles, so it has to be known whether the module sends."""
        begin: int | None = None
        for t, line in lines:
            begin = t if begin is None else begin
            if line is not None:
                port.write("*S")
                break
            if t - begin > lf.seconds(LISTEN):
                break
        port.write(COMMANDS[self.params.output])
        port.write("*S")
