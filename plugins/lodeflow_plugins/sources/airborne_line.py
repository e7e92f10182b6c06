"""Lines of an airborne gravity survey, as .npz files.

Columns, one number for each sample: FTIME s; LAT, LONG in degrees; MGA-Z, height in m; FX, FY, FZ,
specific force east, north and up in mGal; V_EAST, V_NORTH in m/s; EOTCOR, the contractor's Eotvos
correction in mGal.
"""

from collections.abc import Iterator
from pathlib import Path
from typing import ClassVar, NamedTuple

import numpy as np

import lodeflow as lf

COLUMNS = ("LAT", "LONG", "MGA-Z", "FX", "FY", "FZ", "V_EAST", "V_NORTH", "EOTCOR")
MGAL = 1e-5  # m/s^2


class Ports(NamedTuple):
    """Ports of `AirborneLine`."""

    force: lf.SpecificForce
    motion: lf.GeodeticMotion
    eotvos: lf.GravityCorrection


class AirborneLine(lf.Source):
    """One line of an airborne gravity survey: platform, navigation, and the contractor's result.

    The specific force is along the axes of the platform, x east, y north, z up. The file has no
    vertical velocity; it is the derivative of the height. t counts from the start of the run at
    the sampling rate.
    """

    rows: ClassVar[int] = 500
    """Rows of a block."""

    class Params(lf.Params):
        """Which line."""

        file: str
        """Path of the .npz file."""
        sample_rate: float = 2.0
        """Samples per second."""

    def read(self, clock: lf.Clock) -> Iterator[Ports]:
        data = _load(self.params.file)
        count = len(data["LAT"])
        rate = self.params.sample_rate
        t = clock.start + np.rint(np.arange(count) * (1e9 / rate)).astype(np.int64)
        force = np.column_stack([data[name] for name in ("FX", "FY", "FZ")]) * MGAL
        up = np.gradient(data["MGA-Z"]) * rate
        velocity = np.column_stack([data["V_EAST"], data["V_NORTH"], up])
        latitude, longitude = np.radians(data["LAT"]), np.radians(data["LONG"])
        for first in range(0, count, self.rows):
            part = slice(first, first + self.rows)
            yield Ports(
                lf.SpecificForce(t[part], force[part]),
                lf.GeodeticMotion(
                    t[part], latitude[part], longitude[part], data["MGA-Z"][part], velocity[part]
                ),
                lf.GravityCorrection(t[part], data["EOTCOR"][part] * MGAL),
            )


def _load(file: str) -> dict[str, np.ndarray]:
    """The columns. Raises ValueError for a file that is no line."""
    try:
        with np.load(Path(file), allow_pickle=False) as found:
            data = {name: found[name].astype(float) for name in COLUMNS if name in found.files}
    except Exception as error:  # zip and numpy raise whatever they stumble over
        raise ValueError(f"{file}: cannot be read as an .npz file: {error}") from None
    if missing := [name for name in COLUMNS if name not in data]:
        raise ValueError(f"{file} is no gravity line: it has no {', '.join(missing)}")
    count = data["LAT"].size
    for name, column in data.items():
        if column.shape != (count,) or count < 3:
            raise ValueError(
                f"{file}: {name} has the shape {column.shape}; all columns should be of one "
                "length, of 3 or more"
            )
    return data
