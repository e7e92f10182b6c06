"""A CSV file as a source: columns mapped to ports, units converted, read in blocks."""

from collections.abc import Iterator
from decimal import Decimal, InvalidOperation
from functools import partial
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal, NamedTuple

import numpy as np
from pydantic import Field, field_validator, model_validator

import lodeflow as lf
from lodeflow_plugins.sources.csv_table import BadRow, Table

NANOSECONDS = {"s": 10**9, "ms": 10**6, "us": 10**3, "µs": 10**3, "ns": 1}


class Ports(NamedTuple):
    """Ports of `CsvFile`."""

    imu: lf.Imu | None
    mag: lf.MagneticField | None
    truth: lf.AttitudeTruth | None


class Time(lf.Params):
    """Column of time stamps."""

    column: str
    """Name in the header."""
    unit: Literal["s", "ms", "us", "µs", "ns"] | None = None
    """Unit of the stamps, which are converted in decimals, without rounding above 1 ns; null for
    that in the header, "t [ms]", or else s."""


class Vector(lf.Params):
    """Three columns of one quantity."""

    of: ClassVar[type[lf.Unit]] = lf.Dimensionless

    columns: tuple[str, str, str]
    """Names of x, y and z in the header, with or without the unit that stands there."""
    unit: str | None = None
    """Unit of the columns; null for that in the header, "gx [deg/s]", or else SI."""

    @field_validator("unit")
    @classmethod
    def _known(cls, unit: str | None) -> str | None:
        if unit is not None:
            _factor(cls.of, unit)
        return unit


class Rate(Vector):
    """Three columns of angular rate."""

    of = lf.RadPerSecond


class Force(Vector):
    """Three columns of specific force."""

    of = lf.MeterPerSecondSquared


class Flux(Vector):
    """Three columns of magnetic flux density."""

    of = lf.Tesla


class CsvFile(lf.Source):
    """Sensor data from a CSV file with a header.

    The parameters say which columns make a port; other columns are not looked at. All vectors
    are in the body frame (FLU), the truth is magnetic ENU <- FLU. Where all cells of a port are
    empty, it has no message in that row, so a slow sensor may share a file with a fast one. A
    cell that is empty otherwise, or says nan, is NaN: passed on in the truth, dropped and
    counted in all else. A unit in the header must not contradict the one in the graph. The file
    is UTF-8 and read as the run goes on, never as a whole; a bad row ends the run after the rows
    before it have passed.
    """

    rows: ClassVar[int] = 1000
    """Rows of a block."""

    class Params(lf.Params):
        """Which columns of which file, and their units."""

        file: str
        """Path."""
        time: Time | None = None
        """Column of stamps. Or give `rate`."""
        rate: Annotated[float | None, lf.Hertz] = Field(None, gt=0, le=1e6)
        """Rows per second of a file without stamps; t counts from the start of the run."""
        angular_velocity: Rate | None = None
        """Columns of the port `imu`."""
        linear_acceleration: Force | None = None
        """Columns of the port `imu`: specific force."""
        magnetic_field: Flux | None = None
        """Columns of the port `mag`."""
        quaternion: tuple[str, str, str, str] | None = None
        """Columns x, y, z, w of the port `truth`."""
        moving: str | None = None
        """Column of the port `truth`: 1 where it is scored, else 0. Null for 1 in all rows."""
        delimiter: str = Field(",", min_length=1, max_length=1)
        """Between two cells."""

        @model_validator(mode="after")
        def _complete(self) -> "CsvFile.Params":
            if (self.time is None) == (self.rate is None):
                raise ValueError("give one of time and rate")
            if (self.angular_velocity is None) != (self.linear_acceleration is None):
                raise ValueError("imu needs both angular_velocity and linear_acceleration")
            if self.moving is not None and self.quaternion is None:
                raise ValueError("moving belongs to a truth; give quaternion too")
            if not (self.angular_velocity or self.magnetic_field or self.quaternion):
                raise ValueError("nothing to read; give angular_velocity, magnetic_field, ...")
            return self

    example: ClassVar = {
        "file": "sensors.csv",
        "time": {"column": "t", "unit": "ms"},
        "angular_velocity": {"columns": ["gx", "gy", "gz"], "unit": "deg/s"},
        "linear_acceleration": {"columns": ["ax", "ay", "az"], "unit": "g"},
        "magnetic_field": {"columns": ["mx", "my", "mz"], "unit": "uT"},
    }

    def read(self, clock: lf.Clock) -> Iterator[Ports]:
        path = Path(self.params.file)
        with path.open(newline="", encoding="utf-8-sig", errors="surrogateescape") as file:
            table = Table(self.params.file, file, self.params.delimiter)
            reader = _Reader(table, self.params)
            first = 0
            while table.advance(self.rows):
                block = reader.block(clock.start, first)
                if table.lines:
                    yield block
                if table.error is not None:
                    raise table.error
                first += len(table.lines)


class _Reader:
    """Turns the rows of a table into messages."""

    def __init__(self, table: Table, params: Any) -> None:
        self.table = table
        self.params = params
        self.time: int | None = None
        self.nanoseconds = NANOSECONDS["s"]
        if params.time is not None:
            self.time = table.find(params.time.column)
            given = table.factor(self.time, params.time.unit, _nanoseconds)
            self.nanoseconds = given or self.nanoseconds
        self.rate = self._vector(params.angular_velocity)
        self.force = self._vector(params.linear_acceleration)
        self.field = self._vector(params.magnetic_field)
        self.truth = [(table.find(name), 1.0) for name in params.quaternion or ()]
        self.moving = None if params.moving is None else table.find(params.moving)

    def _vector(self, vector: Vector | None) -> list[tuple[int, float]]:
        """Index and factor of each column."""
        if vector is None:
            return []
        found = [self.table.find(name) for name in vector.columns]
        of = partial(_factor, vector.of)
        return [(i, self.table.factor(i, vector.unit, of) or 1.0) for i in found]

    def block(self, start: int, first: int) -> Ports:
        """The messages of the table's rows, the first of which is the row `first` of the file.

        A row with a bad cell is cut off the table, with all that follow.
        """
        while True:
            try:
                return self._ports(start, first)
            except BadRow as bad:  # the cells go by column, so an earlier row may be bad as well
                self.table.cut(bad)

    def _ports(self, start: int, first: int) -> Ports:
        t = self._stamps(start, first)
        return Ports(
            self._message(lf.Imu, t, self.rate, self.force),
            self._message(lf.MagneticField, t, self.field),
            self._message(lf.AttitudeTruth, t, self.truth, integers=[self._moving()]),
        )

    def _message(
        self,
        kind: type[lf.Message],
        t: np.ndarray,
        *fields: list[tuple[int, float]],
        integers: list[np.ndarray] | None = None,
    ) -> Any:
        """A block of the rows in which not all cells of the fields are empty."""
        used = [index for field in fields for index, _ in field]
        if not used:
            return None
        columns = [
            np.column_stack([self.table.numbers(index) * factor for index, factor in field])
            for field in fields
        ]
        columns += integers or []
        rows = np.array([any(map(str.strip, cells)) for cells in self._cells(used)], bool)
        if rows.all():
            return kind(t, *columns)
        return kind(t[rows], *[column[rows] for column in columns])

    def _cells(self, used: list[int]) -> Iterator[list[str]]:
        return ([row[index] for index in used] for row in self.table.cells)

    def _stamps(self, start: int, first: int) -> np.ndarray:
        if self.time is None:
            row = np.arange(first, first + len(self.table.lines))
            return start + np.rint(row * 1e9 / self.params.rate).astype(np.int64)
        factor = self.nanoseconds
        try:
            return np.array(
                [round(Decimal(text) * factor) for text in self.table.texts(self.time)], np.int64
            )
        except (InvalidOperation, ValueError, OverflowError):
            what = "is not a time stamp"
            raise self.table.refusal(self.time, lambda c: _is_stamp(c, factor), what) from None

    def _moving(self) -> np.ndarray:
        count = len(self.table.lines)
        if self.moving is None:
            return np.ones(count, np.int64)
        texts = self.table.texts(self.moving)
        if not set(texts) <= {"0", "1"}:
            raise self.table.refusal(self.moving, {"0", "1"}.__contains__, "should be 0 or 1")
        return np.array(texts, np.int64)


def _nanoseconds(unit: str) -> int:
    try:
        return NANOSECONDS[unit]
    except KeyError:
        known = " | ".join(NANOSECONDS)
        raise ValueError(f"{unit!r} is not a unit of time stamps ({known})") from None


def _factor(of: type[lf.Unit], unit: str) -> float:
    try:
        return of.factor(unit)
    except lf.MessageError as error:
        raise ValueError(str(error)) from None


def _is_stamp(text: str, factor: int) -> bool:
    try:
        return abs(round(Decimal(text) * factor)) < 2**63
    except (InvalidOperation, ValueError, OverflowError):
        return False
