"""Lines of text from a serial port, each with the time at which it was complete."""

from __future__ import annotations

import importlib
import logging
from collections.abc import Iterator
from typing import Any

import lodeflow as lf

WAIT = 0.1
"""Longest time, s, for which a read blocks: how soon a source notices that the run stops."""
LONGEST = 256
"""Bytes without an end of line that cannot be a line of these devices."""


class SerialLines:
    """A port that is open.

    Args:
        port: device, such as /dev/ttyUSB0, or a URL that pyserial knows.
        baud: bits per second; 8 bits, no parity, 1 stop bit.

    Raises:
        ValueError: the port cannot be opened, or pyserial is not installed.
    """

    def __init__(self, port: str, baud: int) -> None:
        try:
            serial: Any = importlib.import_module("serial")
        except ImportError:
            raise ValueError(
                "reading a serial port needs pyserial: pip install 'lodeflow[serial]'"
            ) from None
        try:
            self.device = serial.serial_for_url(port, baud, timeout=WAIT)
        except (serial.SerialException, ValueError, OSError) as error:
            raise ValueError(f"{port} cannot be opened: {error}") from None
        self.rest = b""

    def write(self, text: str) -> None:
        """Send a line."""
        self.device.write(f"{text}\r\n".encode())

    def lines(self, clock: lf.Clock) -> Iterator[tuple[int, str | None]]:
        """Yield (stamp, line) as lines come, and (stamp, None) where none came for a moment.

        What is no ASCII comes as it is decoded, for the caller to refuse. Ends where the port
        does, as a pseudo-terminal whose other side is closed.
        """
        while True:
            try:
                read = self.device.read(max(1, self.device.in_waiting))
            except OSError:  # unplugged
                return
            now = clock.now()
            if not read:
                yield now, None
                continue
            *whole, self.rest = (self.rest + read).replace(b"\r", b"\n").split(b"\n")
            if len(self.rest) > LONGEST:
                whole.append(self.rest)
                self.rest = b""
            for line in whole:
                if text := line.decode("ascii", "replace").strip():
                    yield now, text

    def close(self) -> None:
        """Close the port."""
        self.device.close()


class Faults:
    """What was wrong with the lines of a device: counted all, told at 1, 10, 100, ... and the end.

    Attributes:
        garbled: lines that could not be read.
    """

    def __init__(self, log: logging.Logger, silence: float) -> None:
        self.log, self.silence = log, lf.seconds(silence)
        self.garbled = 0
        self.heard: int | None = None
        self.is_silent = False

    def bad(self, line: str, why: str) -> None:
        """Count a line that cannot be read."""
        self.garbled += 1
        if self.garbled in (1, 10, 100) or self.garbled % 1000 == 0:
            self.log.warning("line %r: %s (%d such lines)", line[:60], why, self.garbled)

    def quiet(self, now: int) -> None:
        """Note that nothing came until now."""
        self.heard = now if self.heard is None else self.heard
        if not self.is_silent and now - self.heard > self.silence:
            self.is_silent = True
            self.log.warning("nothing has come for %.1f s", (now - self.heard) * 1e-9)

    def good(self, now: int) -> None:
        """Note that a line was read."""
        if self.is_silent:
            self.log.warning("lines come again after %.1f s", (now - (self.heard or now)) * 1e-9)
        self.heard, self.is_silent = now, False

    def finish(self) -> None:
        """Tell the sum."""
        if self.garbled:
            self.log.warning("%d lines could not be read", self.garbled)
