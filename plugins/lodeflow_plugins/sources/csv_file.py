"""A CSV file as a source: columns mapped to ports, units converted, read in blocks."""

import csv
import re
from collections.abc import Iterator
from decimal import Decimal, InvalidOperation
from itertools import islice
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal, NamedTuple, TextIO

import numpy as np
from pydantic import Field, field_validator, model_validator

import lodeflow as lf

NANOSECONDS = {"s": 10**9, "ms": 10**6, "us": 10**3, "µs": 10**3, "ns": 1}
UNIT_IN_HEADER = re.compile(r"(?P<name>.*?)\s*[\[(](?P<unit>[^\[\]()]*)[\])]")


class Ports(NamedTuple):
    """Ports of `CsvFile`."""

    imu: lf.Imu | None
    mag: lf.MagneticField | None
    truth: lf.AttitudeTruth | None


class Time(lf.Params):
    """Column of time stamps."""

    column: str
    """Name in the header."""
    unit: Literal["s", "ms", "us", "µs", "ns"] = "s"
    """Unit of the stamps. They are converted in decimals, without rounding below 1 ns."""


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
    counted in all else. The file is read as the run goes on, never as a whole.
    """

    rows: ClassVar[int] = 1000
    """Rows of a block."""

    class Params(lf.Params):
        """Which columns of which file, and their units."""

        file: str
        """Path."""
        time: Time | None = None
        """Column of stamps. Or give `rate`."""
        rate: Annotated[float | None, lf.Hertz] = Field(None, gt=0)
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
        with path.open(newline="", encoding="utf-8-sig") as file:
            table = _Table(self.params.file, file, self.params.delimiter)
            ports = _Reader(table, self.params)
            first = 0
            while table.advance(self.rows):
                yield ports.block(clock.start, first)
                first += len(table.lines)


class _Table:
    """The rows of the file, some at a time, with errors that say where."""

    def __init__(self, name: str, file: TextIO, delimiter: str) -> None:
        self.name = name
        self.reader = csv.reader(file, delimiter=delimiter)
        self.header = [cell.strip() for cell in next(self.reader, [])]
        self.header_line = self.reader.line_num
        self.lines: list[int] = []
        self.cells: list[list[str]] = []
        if not self.header:
            raise ValueError(f"{name}:1: empty; the first line should name the columns")

    def advance(self, rows: int) -> bool:
        """Go on to the next rows; False at the end of the file."""
        numbered = ((self.reader.line_num, row) for row in self.reader if row)
        found = list(islice(numbered, rows))
        self.lines = [line for line, _ in found]
        self.cells = [row for _, row in found]
        for line, row in found:
            if len(row) != len(self.header):
                raise ValueError(
                    f"{self.name}:{line}: {len(row)} cells, but the header has {len(self.header)}"
                )
        return bool(found)

    def find(self, column: str) -> int:
        """Index of a column by its name, with or without the unit in the header."""
        for names in (self.header, [_split(name)[0] for name in self.header]):
            if names.count(column) == 1:
                return names.index(column)
            if column in names:
                what = "the header has it more than once"
                raise ValueError(f"{self.name}:{self.header_line}:{column}: {what}")
        columns = ", ".join(self.header)
        raise ValueError(
            f"{self.name}:{self.header_line}:{column}: no such column (the file has {columns})"
        )

    def factor(self, index: int, unit: str | None, of: type[lf.Unit]) -> float:
        """Factor of a column to SI: of the unit asked for, or that in the header."""
        unit = unit or _split(self.header[index])[1]
        try:
            return 1.0 if not unit else _factor(of, unit)
        except ValueError as error:
            where = f"{self.name}:{self.header_line}:{self.header[index]}"
            raise ValueError(f"{where}: {error}") from None

    def texts(self, index: int) -> list[str]:
        """Cells of a column."""
        return [row[index].strip() for row in self.cells]

    def numbers(self, index: int) -> np.ndarray:
        """Cells of a column as numbers; empty ones are NaN."""
        texts = self.texts(index)
        try:
            return np.array([float(text or "nan") for text in texts])
        except ValueError:
            raise self.refusal(index, _is_number) from None

    def refusal(self, index: int, good: Any, what: str = "is not a number") -> ValueError:
        """The error for the first cell of a column that is not good."""
        bad = next(at for at, text in enumerate(self.texts(index)) if not good(text))
        where = f"{self.name}:{self.lines[bad]}:{self.header[index]}"
        return ValueError(f"{where}: {self.texts(index)[bad]!r} {what}")


class _Reader:
    """Turns the rows of a table into messages."""

    def __init__(self, table: _Table, params: Any) -> None:
        self.table = table
        self.params = params
        self.time = None if params.time is None else table.find(params.time.column)
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
        return [(i, self.table.factor(i, vector.unit, vector.of)) for i in found]

    def block(self, start: int, first: int) -> Ports:
        """The messages of the table's rows, the first of which is the row `first` of the file."""
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
        rows = np.array([any(map(str.strip, cells)) for cells in self._cells(used)])
        if rows.all():
            return kind(t, *columns)
        return kind(t[rows], *[column[rows] for column in columns])

    def _cells(self, used: list[int]) -> Iterator[list[str]]:
        return ([row[index] for index in used] for row in self.table.cells)

    def _stamps(self, start: int, first: int) -> np.ndarray:
        if self.time is None:
            row = np.arange(first, first + len(self.table.lines))
            return start + np.rint(row * 1e9 / self.params.rate).astype(np.int64)
        factor = NANOSECONDS[self.params.time.unit]
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


def _factor(of: type[lf.Unit], unit: str) -> float:
    try:
        return of.factor(unit)
    except lf.MessageError as error:
        raise ValueError(str(error)) from None


def _split(header: str) -> tuple[str, str]:
    """The name and the unit in a header such as "gx [deg/s]" or "gx (deg/s)"."""
    match = UNIT_IN_HEADER.fullmatch(header)
    return (match["name"], match["unit"].strip()) if match else (header, "")


def _is_number(text: str) -> bool:
    try:
        float(text or "nan")
    except ValueError:
        return False
    return True


def _is_stamp(text: str, factor: int) -> bool:
    try:
        return abs(round(Decimal(text) * factor)) < 2**63
    except (InvalidOperation, ValueError, OverflowError):
        return False
