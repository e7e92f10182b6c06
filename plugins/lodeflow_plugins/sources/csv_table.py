"""A CSV file as a table: its header and its rows, with errors that say where."""

import csv
import re
from collections.abc import Callable, Iterator
from itertools import islice
from typing import Any, TextIO

import numpy as np

import lodeflow as lf

UNIT_IN_HEADER = re.compile(r"(?P<name>.*?)\s*[\[(](?P<unit>[^\[\]()]*)[\])]")
UNDECODED = re.compile("[\udc80-\udcff]")
"""What `surrogateescape` makes of bytes that are not UTF-8."""


class BadRow(Exception):
    """A cell of the table does not fit: its row in the table, and what to tell."""

    def __init__(self, row: int, what: str) -> None:
        super().__init__(what)
        self.row = row


class Table:
    """The rows of the file, some at a time, with errors that say where.

    Attributes:
        lines: line in the file of each row.
        cells: cells of each row.
        error: what is wrong with the row after the last one, if anything.
    """

    def __init__(self, name: str, file: TextIO, delimiter: str) -> None:
        self.name = name
        self.reader = csv.reader(_decoded(name, file), delimiter=delimiter)
        self.header = [cell.strip() for cell in next(self.reader, [])]
        self.header_line = self.reader.line_num
        self.lines: list[int] = []
        self.cells: list[list[str]] = []
        self.error: ValueError | None = None
        if not self.header:
            raise ValueError(f"{name}:1: empty; the first line should name the columns")

    def advance(self, rows: int) -> bool:
        """Go on to the next rows, up to a bad one; False at the end of the file."""
        self.lines, self.cells = [], []
        try:
            for row in islice(filter(None, self.reader), rows):
                if len(row) != len(self.header):
                    what = f"{len(row)} cells, but the header has {len(self.header)}"
                    raise ValueError(f"{self.name}:{self.reader.line_num}: {what}")
                self.lines.append(self.reader.line_num)
                self.cells.append(row)
        except csv.Error as error:
            self.error = ValueError(f"{self.name}:{self.reader.line_num}: {error}")
        except ValueError as error:
            self.error = error
        return bool(self.lines) or self.error is not None

    def cut(self, bad: BadRow) -> None:
        """Keep only the rows before a bad one."""
        del self.lines[bad.row :], self.cells[bad.row :]
        self.error = ValueError(str(bad))

    def find(self, column: str) -> int:
        """Index of a column by its name, with or without the unit in the header."""
        for names in (self.header, [_split(name)[0] for name in self.header]):
            if names.count(column) == 1:
                return names.index(column)
            if column in names:
                what = "the header has it more than once"
                raise ValueError(f"{self.name}:{self.header_line}:{column}: {what}")
        near = lf.did_you_mean(_split(column)[0], [_split(name)[0] for name in self.header])
        columns = ", ".join(self.header)
        raise ValueError(
            f"{self.name}:{self.header_line}:{column}: no such column{near} "
            f"(the file has {columns})"
        )

    def factor(
        self, index: int, unit: str | None, factor_of: Callable[[str], float]
    ) -> float | None:
        """Factor of a column, from the unit asked for or that in the header; None without one."""
        where = f"{self.name}:{self.header_line}:{self.header[index]}"
        written = _split(self.header[index])[1]
        try:
            factors = [factor_of(spelling) for spelling in (written, unit) if spelling]
        except ValueError as error:
            raise ValueError(f"{where}: {error}") from None
        if len(set(factors)) > 1:
            what = f"the header says {written}, the graph {unit}; make them equal or leave one out"
            raise ValueError(f"{where}: {what}")
        return factors[0] if factors else None

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

    def refusal(self, index: int, good: Any, what: str = "is not a number") -> BadRow:
        """The error for the first cell of a column that is not good."""
        bad = next(at for at, text in enumerate(self.texts(index)) if not good(text))
        where = f"{self.name}:{self.lines[bad]}:{self.header[index]}"
        return BadRow(bad, f"{where}: {self.texts(index)[bad]!r} {what}")


def _decoded(name: str, file: TextIO) -> Iterator[str]:
    """The lines of a file that was opened with `surrogateescape`, up to one that is not UTF-8."""
    for number, line in enumerate(file, 1):
        if not line.isascii() and (bad := UNDECODED.search(line)):
            byte = ord(bad[0]) - 0xDC00
            raise ValueError(f"{name}:{number}: not UTF-8 (byte 0x{byte:02x}); save it as UTF-8")
        yield line


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
