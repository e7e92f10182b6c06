"""Reading lines of an airborne gravity survey."""

import numpy as np
import pytest

from lodeflow.clock import SimClock
from lodeflow_plugins.sources.airborne_line import COLUMNS, AirborneLine

ROWS = 1200


@pytest.fixture
def line():
    rng = np.random.default_rng(0)
    return {name: rng.standard_normal(ROWS) for name in COLUMNS} | {"OTHER": np.zeros(3)}


def read(path, data):
    np.savez(path, **data)
    return list(AirborneLine(AirborneLine.Params(file=str(path))).read(SimClock()))


def test_columns_and_units(tmp_path, line):
    line["MGA-Z"] = 300.0 + 0.25 * np.arange(ROWS)  # m, at 2 Hz
    parts = read(tmp_path / "line.npz", line)
    force, motion, eotvos = (type(b[0]).concat(b) for b in zip(*parts, strict=True))
    for block in (force, motion, eotvos):
        block.validate()
        assert block.t.tolist() == [k * 500_000_000 for k in range(ROWS)]
    np.testing.assert_allclose(force.specific_force[:, 1], line["FY"] * 1e-5)
    np.testing.assert_allclose(np.degrees(motion.latitude), line["LAT"])
    np.testing.assert_allclose(motion.velocity[:, 2], 0.5)
    assert np.array_equal(motion.velocity[:, 0], line["V_EAST"])
    np.testing.assert_allclose(eotvos.correction, line["EOTCOR"] * 1e-5)


def test_a_file_that_is_no_line_is_refused(tmp_path, line):
    short = {**line, "FY": np.zeros(7)}
    with pytest.raises(ValueError, match=r"FY has the shape \(7,\)"):
        read(tmp_path / "short.npz", short)
    del line["FX"], line["LAT"]
    with pytest.raises(ValueError, match=r"is no gravity line: it has no LAT, FX"):
        read(tmp_path / "bad.npz", line)
    text = tmp_path / "text.npz"
    text.write_text("no zip")
    with pytest.raises(ValueError, match=r"text\.npz: cannot be read"):
        list(AirborneLine(AirborneLine.Params(file=str(text))).read(SimClock()))
