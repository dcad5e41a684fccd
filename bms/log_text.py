"""The text of a log, in blocks: where the header is, what separates the cells, and the numbers of a block.

A block is parsed by ``numpy.loadtxt``, 40 ns a cell; only a block that it refuses is read cell by cell, which
finds the missing values that loggers write in many ways, and names the line of what is wrong.
"""

from __future__ import annotations

import csv
import gzip
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import islice, pairwise
from pathlib import Path
from typing import Any, BinaryIO, cast

import numpy as np
from numpy.typing import NDArray

from bms.errors import BatteryError
from bms.log_columns import MOMENT, Column
from bms.log_moments import seconds_of

Array = NDArray[np.float64]

BLOCK_BYTES = 1 << 23
MOST_LEADING_LINES = 1000
MISSING = frozenset({"", "nan", "-nan", "na", "n/a", "#n/a", "nan(ind)", "null", "none", "-", "--"})
_UTF8_MARK = b"\xef\xbb\xbf"
_UTF16_MARKS = (b"\xff\xfe", b"\xfe\xff")


@dataclass(frozen=True)
class Layout:
    """How a log is laid out.

    Parameters
    ----------
    path : Path
        The file.
    header : tuple of str
        Cells of its header.
    first_row : tuple of str
        Cells of the first row below it.
    header_line : int
        Number of the header's line, from 1.
    delimiter : str
        Comma, semicolon or tab; with the latter two a comma is a decimal one.
    """

    path: Path
    header: tuple[str, ...]
    first_row: tuple[str, ...]
    header_line: int
    delimiter: str


def layouts(path: Path) -> Iterator[Layout]:
    """Yield the layout of a log for each line that may be its header, the likeliest first.

    That is its first line that is neither empty nor a comment (``#``); cyclers write some lines of their own
    above the header, so the ones after it follow.

    Parameters
    ----------
    path : Path
        The file.

    Raises
    ------
    BatteryError
        When the file cannot be read, is not text, or ends before its first row of data.
    """
    try:
        with open_log(path) as file:
            lines = list(islice(file, MOST_LEADING_LINES))
    except (OSError, EOFError) as error:
        raise BatteryError(_unreadable(path, error)) from error
    head = b"".join(lines[:3])
    if head.startswith(_UTF16_MARKS) or b"\0" in head:
        raise BatteryError(f"{path} is not UTF-8 text; save the log as CSV with UTF-8 encoding")
    texts = [(number, _decoded(line).strip("\r\n \ufeff")) for number, line in enumerate(lines, 1)]
    rows = [(number, text) for number, text in texts if text and not text.startswith("#")]
    if len(rows) < 2:
        raise BatteryError(
            f"{path} holds no data; the first row must name the columns with their units, as in"
            " 'time_s,current_A,voltage_V', the rows below it hold numbers"
        )
    for (number, text), (_, below) in pairwise(rows):
        delimiter = next((mark for mark in ";\t" if mark in text), ",")
        header, first = (tuple(next(csv.reader([row], delimiter=delimiter))) for row in (text, below))
        yield Layout(path, header, first, number, delimiter)


def open_log(path: Path) -> BinaryIO:
    """Open a log for reading, also one that is compressed (``.gz``)."""
    if path.suffix == ".gz":
        return cast(BinaryIO, gzip.open(path, "rb"))
    return path.open("rb")


def blocks(layout: Layout) -> Iterator[tuple[int, bytes, int]]:
    """Yield number of the first line, the bytes of whole lines, and the position in the file on disk."""
    try:
        with open_log(layout.path) as file:
            for _ in range(layout.header_line):
                file.readline()
            line = layout.header_line + 1
            while block := file.read(BLOCK_BYTES):
                block += file.readline()
                yield line, block.replace(b"\r\n", b"\n"), _position(file)
                line += block.count(b"\n")
    except (OSError, EOFError) as error:
        raise BatteryError(_unreadable(layout.path, error)) from error


def parse(layout: Layout, line: int, block: bytes, columns: Sequence[Column]) -> tuple[Array, bool]:
    """Turn a block into numbers, as they stand in the file.

    Parameters
    ----------
    layout : Layout
        Delimiter and file name.
    line : int
        Number of the first line.
    block : bytes
        Whole lines.
    columns : sequence of Column
        What is wanted, time first.

    Returns
    -------
    tuple of ndarray of shape (rows, columns), and bool
        Values, NaN where a cell is empty; and whether an unfinished last line was left out.

    Raises
    ------
    BatteryError
        When a cell is no number or a line too short; names the line.
    """
    try:
        return _fast(layout, block, columns), False
    except ValueError:
        return _careful(layout, line, block, columns)


def line_of(layout: Layout, sample: int) -> int:
    """Return the number of the line that holds a sample, by counting the rows above it again."""
    seen = -1
    for line, block, _ in blocks(layout):
        for number, text in enumerate(block.split(b"\n"), line):
            seen += _is_row(text.decode("latin-1"), layout.delimiter)
            if seen == sample:
                return number
    return 0


def _fast(layout: Layout, block: bytes, columns: Sequence[Column]) -> Array:
    mark = layout.delimiter.encode()
    if mark != b"," and b"," in block:
        block = block.replace(b",", b".")
    if mark + mark in block or mark + b"\n" in block:
        block = block.replace(mark + b"\n", mark + b"nan\n")
        # Twice, because neighbours share a delimiter.
        for _ in range(2):
            block = block.replace(mark + mark, mark + b"nan" + mark)
    lines = block.decode("latin-1").split("\n")
    if b"#" in block:
        lines = [text for text in lines if not text.startswith("#")]
    if not any(lines):
        return np.empty((0, len(columns)))
    moments: Any = {column.index: seconds_of for column in columns if column.unit == MOMENT}
    values: Array = np.loadtxt(
        lines,
        delimiter=layout.delimiter,
        usecols=[column.index for column in columns],
        comments=None,
        quotechar='"',
        ndmin=2,
        converters=moments or None,
        encoding=None,
    )
    if np.isnan(values[:, 0]).any():
        raise ValueError("a row without time: empty, or to be complained of by its line")
    return values


def _careful(layout: Layout, line: int, block: bytes, columns: Sequence[Column]) -> tuple[Array, bool]:
    texts = block.decode("latin-1").split("\n")
    values: list[list[float]] = []
    for number, text in enumerate(texts, line):
        if not _is_row(text, layout.delimiter):
            continue
        cells = next(csv.reader([text], delimiter=layout.delimiter))
        try:
            values.append([_value(cells, column, layout.delimiter) for column in columns])
        except (ValueError, IndexError) as error:
            # A logger that was switched off leaves a line without its end.
            if number == line + len(texts) - 1:
                return np.array(values).reshape(-1, len(columns)), True
            raise BatteryError(
                f"{layout.path}, line {number}: {_complaint(cells, columns, layout)}"
            ) from error
    return np.array(values, dtype=np.float64).reshape(-1, len(columns)), False


def _value(cells: Sequence[str], column: Column, delimiter: str) -> float:
    cell = cells[column.index].strip()
    if cell.lower() in MISSING:
        if column.quantity == "time":
            raise ValueError("a sample without time")
        return float("nan")
    if column.unit == MOMENT:
        return seconds_of(cell)
    return float(cell if delimiter == "," else cell.replace(",", "."))


def _complaint(cells: Sequence[str], columns: Sequence[Column], layout: Layout) -> str:
    for column in columns:
        if column.index >= len(cells):
            return (
                f"{len(cells)} cells, while the header names {len(layout.header)} columns; the"
                f" {column.quantity} ({column.header!r}) is missing. Complete or delete the line"
            )
        cell = cells[column.index].strip()
        if column.quantity == "time" and cell.lower() in MISSING:
            return f"the time is missing ({cell!r}); fill it or delete the line"
        try:
            _value(cells, column, layout.delimiter)
        except ValueError:
            form = " and no time as 2024-05-01T12:00:00 or 12:00:00" if column.quantity == "time" else ""
            return (
                f"the {column.quantity} is {cell!r}, which is not a number{form}; write decimals with a"
                " point, or with a comma where semicolons separate; an empty cell is a missing value"
            )
    return "the line cannot be read"


def _is_row(text: str, delimiter: str) -> bool:
    return bool(text.strip(' \r"' + delimiter)) and not text.startswith("#")


def _decoded(line: bytes) -> str:
    try:
        return line.removeprefix(_UTF8_MARK).decode("utf-8")
    except UnicodeDecodeError:
        # Cyclers write the degree sign in the encoding of Western Windows.
        return line.decode("cp1252", errors="replace")


def _position(file: BinaryIO) -> int:
    raw = file.fileobj if isinstance(file, gzip.GzipFile) else file
    return int(raw.tell())


def _unreadable(path: Path, error: OSError | EOFError) -> str:
    if isinstance(error, FileNotFoundError):
        return f"there is no file {path}; check the path of the log"
    if isinstance(error, IsADirectoryError):
        return f"{path} is a folder; name a file in it"
    return f"cannot read {path}: {getattr(error, 'strerror', None) or error}"
