"""Read a vehicle's log from a CSV file: channels by name and unit, checked before a filter sees them.

A regression takes every sample on its own, so rows that lack a value are left out and told of; a clock that
runs backwards, too many holes, and a signal that never changes are errors.
"""

from __future__ import annotations

import csv
import gzip
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from vehicle.errors import VehicleError
from vehicle.inertia.log_columns import CHANNELS, Column, find_columns

Array = NDArray[np.float64]

MIN_SAMPLES = 10
MOST_MISSING = 0.2
GAP_RATIO, GAP_S = 5.0, 0.5
MISSING = frozenset({"", "nan", "-nan", "na", "n/a", "#n/a", "null", "none", "-", "inf", "-inf"})


@dataclass(frozen=True, eq=False)
class LogTable:
    """A log as arrays in SI units.

    Parameters
    ----------
    source : str
        The file.
    channels : dict of str to ndarray, shape (n,)
        By the names of `vehicle.inertia.log_columns.CHANNELS`; no value is missing.
    headers : dict of str to str
        What the file calls them.
    notes, doubts : tuple of str
        What was done to the log, and what is probably wrong with it.
    """

    source: str
    channels: dict[str, Array]
    headers: dict[str, str]
    notes: tuple[str, ...] = ()
    doubts: tuple[str, ...] = ()


def read_table(
    path: str | Path,
    required: Iterable[str],
    optional: Iterable[str] = (),
    *,
    columns: Mapping[str, str] | None = None,
    varying: Iterable[str] = (),
) -> LogTable:
    """Read channels from a CSV file, which may be compressed (``.gz``).

    Parameters
    ----------
    path : str or Path
        UTF-8 text; its first row names the columns with their units; comma, semicolon or tab separate, with
        the
        latter two a comma may be the decimal one; lines that start with # are comments.
    required, optional : iterable of str
        Channels that must, and may, be there.
    columns : mapping of str to str, optional
        The user's own names, see `find_columns`.
    varying : iterable of str
        Channels without whose changes there is nothing to identify.

    Raises
    ------
    VehicleError
        The file cannot be read, a column is missing or has no unit, a cell is no number, time runs
        backwards, more
        than a fifth of the rows lack a value, or a channel that must vary does not.
    """
    path = Path(path)
    lines, rows = _rows(path)
    try:
        found = find_columns(rows[0], required, optional, columns)
    except VehicleError as error:
        raise VehicleError(f"{path}: {error}") from None
    if "time" not in found:
        raise VehicleError(f"{path}: a log is read with its time; ask for the channel 'time'")
    table = _numbers(path, lines[1:], rows[1:], list(found.values()))
    table, at, notes = _complete(path, np.array(lines[1:]), table, found)
    values = {name: column.factor * table[:, k] for k, (name, column) in enumerate(found.items())}
    doubts = _check_time(path, at, values["time"])
    for name in varying:
        if name in values:
            _check_varies(path, name, found[name], values[name])
    headers = {name: column.header for name, column in found.items()}
    return LogTable(str(path), values, headers, notes, doubts)


def constant(values: Array) -> bool:
    """Whether a signal never changes."""
    return bool(np.ptp(values) <= 1e-12 * max(1.0, float(np.abs(values).max())))


def _rows(path: Path) -> tuple[list[int], list[list[str]]]:
    try:
        raw = gzip.decompress(path.read_bytes()) if path.suffix == ".gz" else path.read_bytes()
        text = raw.decode("utf-8-sig")
    except FileNotFoundError:
        raise VehicleError(f"there is no file {path}; check the path of the log") from None
    except UnicodeDecodeError:
        raise VehicleError(f"{path} is not UTF-8 text; save the log as CSV with UTF-8 encoding") from None
    except (OSError, EOFError) as error:
        raise VehicleError(f"cannot read {path}: {getattr(error, 'strerror', None) or error}") from error
    texts = [
        (n, line) for n, line in enumerate(text.splitlines(), 1) if line.strip() and not line.startswith("#")
    ]
    if len(texts) < 2:
        raise VehicleError(
            f"{path} holds no data; the first row must name the columns with their units, as in"
            " 'time_s,force_fl_N,ax_mps2', the rows below it hold numbers"
        )
    mark = next((m for m in ";\t" if m in texts[0][1]), ",")
    rows = list(csv.reader([line for _, line in texts], delimiter=mark))
    if mark != ",":
        rows[1:] = [[cell.replace(",", ".") for cell in row] for row in rows[1:]]
    return [n for n, _ in texts], rows


def _numbers(path: Path, lines: list[int], rows: list[list[str]], wanted: list[Column]) -> Array:
    places = [column.index for column in wanted]
    try:
        return np.array([[row[k] for k in places] for row in rows], dtype=np.float64)
    except (ValueError, IndexError):
        pass
    table = np.full((len(rows), len(wanted)), np.nan)
    for r, (number, row) in enumerate(zip(lines, rows, strict=True)):
        for k, column in enumerate(wanted):
            cell = row[column.index].strip() if column.index < len(row) else ""
            if cell.lower() in MISSING:
                continue
            try:
                table[r, k] = float(cell)
            except ValueError:
                raise VehicleError(
                    f"{path}, line {number}: {column.channel} ({column.header!r}) is {cell!r}, which is no"
                    " number;"
                    " an empty cell is a missing value"
                ) from None
    return table


def _complete(
    path: Path, at: NDArray[np.int64], table: Array, found: dict[str, Column]
) -> tuple[Array, NDArray[np.int64], tuple[str, ...]]:
    """Leave out rows that lack a value."""
    holes = ~np.isfinite(table)
    for k, column in enumerate(found.values()):
        if holes[:, k].all():
            raise VehicleError(f"{path}: {column.channel} ({column.header!r}) is missing in every row")
    lacking = holes.any(axis=1)
    if not lacking.any():
        return table, at, ()
    count, names = int(lacking.sum()), [n for k, n in enumerate(found) if holes[:, k].any()]
    where = (
        f"{count} of {len(table)} rows lack a value of {', '.join(names)}, the first in line {at[lacking][0]}"
    )
    if count > MOST_MISSING * len(table):
        raise VehicleError(
            f"{path}: {where}; more than a fifth: mend the log, or leave the rows out yourself"
        )
    return table[~lacking], at[~lacking], (f"{where}; they were left out",)


def _check_time(path: Path, at: NDArray[np.int64], time_s: Array) -> tuple[str, ...]:
    if time_s.size < MIN_SAMPLES:
        raise VehicleError(
            f"{path} holds {time_s.size} whole samples; an estimate needs at least {MIN_SAMPLES}"
        )
    steps = np.diff(time_s)
    wrong = np.flatnonzero(steps <= 0.0)
    if wrong.size:
        k = int(wrong[0]) + 1
        raise VehicleError(
            f"{path}, line {at[k]}: time goes from {time_s[k - 1]:.10g} to {time_s[k]:.10g} s; it must"
            " increase:"
            " sort the log, leave out samples that are there twice, or split it where its clock starts anew"
        )
    usual = float(np.median(steps))
    gaps = np.flatnonzero(steps > max(GAP_RATIO * usual, GAP_S))
    if not gaps.size:
        return ()
    k = int(gaps[np.argmax(steps[gaps])])
    return (
        f"{gaps.size} gap(s) in time, the longest {steps[k]:.3g} s before line {at[k + 1]}, while a step is"
        " usually"
        f" {usual:.3g} s; each sample is taken as it is, and the parameters as unchanged in between",
    )


def _check_varies(path: Path, name: str, column: Column, values: Array) -> None:
    if constant(values):
        kind = CHANNELS[name][0]
        raise VehicleError(
            f"{path}: {name} ({column.header!r}) is {values[0]:g} throughout: from a {kind} that never"
            " changes nothing"
            " can be identified; check the sensor, or drive"
        )
