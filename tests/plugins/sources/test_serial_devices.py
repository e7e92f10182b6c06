"""Serial devices on a pseudo-terminal: good, garbled and silent lines."""

import contextlib
import logging
import math
import os
import pty
import termios
import threading
import time
import tty

import numpy as np
import pytest

import lodeflow as lf
from lodeflow.clock import WallClock
from lodeflow_plugins.sources import hmr3300, nmea_heading
from lodeflow_plugins.sources.hmr3300 import Hmr3300
from lodeflow_plugins.sources.nmea_heading import NmeaHeading
from lodeflow_plugins.sources.serial_lines import SerialLines


@pytest.fixture
def terminal():
    """Both ends of a pseudo-terminal: (descriptor of the device's side, name of ours)."""
    device, ours = pty.openpty()
    tty.setraw(device)
    tty.setraw(ours, termios.TCSANOW)
    yield device, os.ttyname(ours)
    for end in (device, ours):
        with contextlib.suppress(OSError):  # one test has closed it
            os.close(end)


def read(plugin, params, wanted, say=lambda: None):
    """Read a source until `wanted` messages have come, and all that it yielded.

    The device speaks once the port is open: opening throws away what is in the line before.
    """
    source = plugin(plugin.Params(**params))
    found = []
    speaker = threading.Thread(target=say)
    lines = SerialLines.lines

    def open_lines(port, clock):
        speaker.start()
        return lines(port, clock)

    until = time.monotonic() + 30.0
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(SerialLines, "lines", open_lines)
        items = source.read(WallClock())
        for item in items:
            found.append(item)
            if sum(not isinstance(i, lf.Bound) for i in found) >= wanted:
                break
            assert time.monotonic() < until, found
        items.close()
    speaker.join()
    return found


def sentence(body):
    return f"${body}*{nmea_heading.checksum(body):02X}\r\n".encode()


def test_headings_of_an_hmr3300(terminal, caplog):
    device, name = terminal

    def say():
        os.write(device, b"HMR3300 v2.0\r\n123.4, 18.6, -0.5\r\n12")
        time.sleep(0.15)  # in the middle of a line
        os.write(device, b"4.0, 18.6, -0.5\r\n\xff\xfe.9, 1.0\r\n400.0, 1.0, 1.0\r\n#I\r\n")
        os.write(device, b"359.9,-1.0,2.0\r\n")

    found = [i for i in read(Hmr3300, {"port": name}, 3, say) if not isinstance(i, lf.Bound)]
    assert [round(math.degrees(s.heading.heading), 6) for s in found] == [123.4, 124.0, 359.9]
    assert [s.raw for s in found] == [None] * 3
    assert math.degrees(found[0].euler.pitch) == pytest.approx(18.6)
    assert math.degrees(found[0].euler.roll) == pytest.approx(-0.5)
    stamps = [s.heading.t for s in found]
    assert stamps == sorted(stamps)
    assert stamps[1] - stamps[0] > 0.1e9
    assert "is no heading of an HMR3300 (1 such lines)" in caplog.text
    assert "2 lines could not be read" in caplog.text
    assert "answers #I" in caplog.text


def test_the_field_of_an_hmr3300_after_it_was_configured(terminal):
    device, name = terminal
    heard = []

    def say():
        os.write(device, b"123.4, 18.6, -0.5\r\n")
        while len(heard) < 3:
            heard.extend(os.read(device, 100).decode().split())
        os.write(device, b"1256, -234, -1894\r\n")

    params = {"port": name, "output": "field", "configure": True}
    sample = read(Hmr3300, params, 1, say)[-1]
    assert heard == ["*S", "*M", "*S"]
    np.testing.assert_array_equal(sample.raw.counts, [1256.0, -234.0, -1894.0])
    assert sample.heading is None


def test_a_silent_device_keeps_its_bound_moving(terminal, caplog):
    device, name = terminal

    def say():
        time.sleep(0.4)
        os.write(device, b"1.0, 2.0, 3.0\r\n")

    found = read(Hmr3300, {"port": name, "silence": 0.2}, 1, say)
    bounds = [i.t for i in found if isinstance(i, lf.Bound)]
    assert len(bounds) >= 3
    assert bounds == sorted(bounds)
    assert "nothing has come" in caplog.text
    assert "lines come again" in caplog.text


def test_a_source_ends_with_its_device(terminal):
    device, name = terminal
    source = Hmr3300(Hmr3300.Params(port=name))
    threading.Timer(0.1, os.close, [device]).start()
    assert all(isinstance(item, lf.Bound) for item in source.read(WallClock()))


@pytest.mark.parametrize("plugin", [Hmr3300, NmeaHeading])
def test_a_port_that_is_not_there(plugin):
    source = plugin(plugin.Params(port="/dev/no-such-port"))
    with pytest.raises(ValueError, match=r"/dev/no-such-port cannot be opened"):
        next(iter(source.read(WallClock())))


def test_nmea_headings(terminal, caplog):
    device, name = terminal
    good = sentence("HCHDG,101.1,1.5,W,7.1,W")

    def say():
        os.write(device, good + sentence("HCHDM,200.0,M") + sentence("GPGGA,1,2,3"))
        os.write(device, good.replace(b"101", b"102"))  # the checksum is another's now
        os.write(device, b"$HCHDG,10\r\n\xff\xff\r\n" + sentence("HCHDG,,,,,"))
        os.write(device, sentence("HCHDG,0.5,1.5,W,,"))

    with caplog.at_level(logging.WARNING):
        found = read(NmeaHeading, {"port": name}, 2, say)
    headings = [math.degrees(i.heading) for i in found if not isinstance(i, lf.Bound)]
    np.testing.assert_allclose(headings, [99.6, 359.0])
    assert "has the checksum" in caplog.text
    assert "3 lines could not be read" in caplog.text


def test_true_headings_need_the_declination(terminal):
    device, name = terminal

    def say():
        os.write(device, sentence("HEHDT,90.0,T"))

    params = {"port": name, "sentence": "HDT", "declination": "3 deg"}
    sample = read(NmeaHeading, params, 1, say)[-1]
    assert math.degrees(sample.heading) == pytest.approx(87.0)
    with pytest.raises(ValueError, match="give the declination"):
        read(NmeaHeading, {"port": name, "sentence": "HDT"}, 1)


@pytest.mark.parametrize(
    ("line", "why"),
    [
        ("HCHDM,1.0,M*00", "is no NMEA sentence"),
        ("$HCHDM,1.0,M", "has no checksum"),
        ("$HCHDM,1.0,M*", "two hexadecimal digits"),
        ("$HCHDM,1.0,M*GG", "two hexadecimal digits"),
        ("$HCHDM,1.0,M*00", "has the checksum 00, and not"),
    ],
)
def test_damaged_sentences(line, why):
    with pytest.raises(ValueError, match=why):
        nmea_heading.fields_of(line)


@pytest.mark.parametrize(
    ("body", "why"),
    [
        ("HCHDM,1.0", "has 1 fields"),
        ("HCHDM,1.0,T", "has the reference 'T'"),
        ("HCHDM,361,M", "has the heading 361"),
        ("HCHDM,nan,M", "has 'nan'"),
        ("HCHDM,-1,M", "has '-1'"),
        ("HCHDG,1.0,2.0,X,,", "has the deviation 2.0 'X'"),
        ("HEHDT,1.0,T", "needs the parameter declination"),
    ],
)
def test_sentences_without_sense(body, why):
    with pytest.raises(ValueError, match=why):
        nmea_heading.heading_of(body.split(","), None)


@pytest.mark.parametrize(
    "line", ["", "1.0", "1, 2, 3", "1.0, 2.0", "1.0, 99.0, 1.0", "1.0,2.0,3.0,"]
)
def test_lines_that_are_no_angles(line):
    assert hmr3300.angles(line) is None
