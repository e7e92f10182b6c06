"""Headings of NMEA 0183 sentences on a serial port.

Source: NMEA 0183, sentences HDG, HDM and HDT; the checksum is the exclusive or of all characters
between $ and *.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from functools import reduce
from operator import xor
from typing import Annotated, ClassVar, Literal

from pydantic import Field

import lodeflow as lf
from lodeflow_plugins.sources.serial_lines import Faults, SerialLines

FIELDS = {"HDG": 5, "HDM": 2, "HDT": 2}
REFERENCE = {"HDM": "M", "HDT": "T"}
SIGN = {"E": 1.0, "W": -1.0, "": 0.0}


def checksum(text: str) -> int:
    """Checksum of what stands between $ and *."""
    return reduce(xor, text.encode("ascii"), 0)


def fields_of(line: str) -> list[str]:
    """The fields of a sentence, the first of which is its address, such as HCHDG.

    Raises:
        ValueError: says what is wrong with it.
    """
    if not line.startswith("$") or not line.isascii():
        raise ValueError("is no NMEA sentence")
    body, star, given = line[1:].partition("*")
    if not star:
        raise ValueError("has no checksum")
    try:
        told = int(given, 16) if len(given) == 2 else None
    except ValueError:
        told = None
    if told is None:
        raise ValueError(f"has no checksum of two hexadecimal digits, but {given!r}")
    if told != checksum(body):
        raise ValueError(f"has the checksum {given}, and not {checksum(body):02X}")
    return body.split(",")


def heading_of(fields: list[str], declination: float | None) -> float | None:
    """Magnetic heading in [0, 2 pi), rad, of the fields of a sentence; None where it tells none.

    A true heading (HDT) needs the declination, rad east. The deviation of HDG is added to what
    the sensor shows.

    Raises:
        ValueError: the fields do not make sense.
    """
    kind = fields[0][-3:]
    values = fields[1:]
    if len(values) != FIELDS[kind]:
        raise ValueError(f"has {len(values)} fields, and {kind} has {FIELDS[kind]}")
    if not values[0]:
        return None  # the compass has no heading at the moment
    degrees = _number(values[0])
    if not 0.0 <= degrees <= 360.0:
        raise ValueError(f"has the heading {values[0]}")
    if kind in REFERENCE and values[1] != REFERENCE[kind]:
        raise ValueError(f"has the reference {values[1]!r}, and {kind} has {REFERENCE[kind]}")
    if kind == "HDG" and values[1]:
        if values[2] not in SIGN:
            raise ValueError(f"has the deviation {values[1]} {values[2]!r}")
        degrees += SIGN[values[2]] * _number(values[1])
    if kind == "HDT":
        if declination is None:
            raise ValueError("is a true heading, which needs the parameter declination")
        degrees -= math.degrees(declination)
    return math.radians(degrees % 360.0)


def _number(text: str) -> float:
    if not text.replace(".", "", 1).isdigit():
        raise ValueError(f"has {text!r} in the place of a number")
    return float(text)


class NmeaHeading(lf.Source):
    """Magnetic heading from a compass that sends NMEA 0183 sentences HDG, HDM or HDT.

    Any talker. Other sentences are passed over; lines that are damaged are counted and told in the
    log, and so is silence. Stamps are the times at which lines were complete. Needs pyserial: the
    extra `serial`.
    """

    max_delay: ClassVar[int] = lf.seconds(0.25)

    class Params(lf.Params):
        """The port, and the sentence."""

        port: str
        """Device, such as /dev/ttyUSB0."""
        baud: int = Field(4800, gt=0)
        """Bits per second."""
        sentence: Literal["HDG", "HDM", "HDT"] = "HDG"
        """Which sentence is read; devices often send more than one."""
        declination: Annotated[float | None, lf.Radian] = None
        """Of the place, east positive; needed for HDT, whose headings are true."""
        silence: Annotated[float, lf.Second] = Field(2.0, gt=0)
        """Time without a heading that is worth a warning."""

    example: ClassVar = {"port": "/dev/ttyUSB0"}

    def read(self, clock: lf.Clock) -> Iterator[lf.Heading | lf.Bound]:
        p = self.params
        if p.sentence == "HDT" and p.declination is None:
            raise ValueError("HDT is a true heading: give the declination of the place")
        faults = Faults(self.log, p.silence)
        port = SerialLines(p.port, p.baud)
        try:
            for t, line in port.lines(clock):
                heading = None
                if line is not None:
                    try:
                        fields = fields_of(line)
                        if fields[0][-3:] == p.sentence:
                            heading = heading_of(fields, p.declination)
                    except ValueError as error:
                        faults.bad(line, str(error))
                if heading is None:
                    faults.quiet(t)
                    yield lf.Bound(t)
                else:
                    faults.good(t)
                    yield lf.Heading(t, heading)
        finally:
            port.close()
            faults.finish()
