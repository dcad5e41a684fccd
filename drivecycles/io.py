"""Read a drive cycle from a CSV file, the user's or one of ours; one parser for both.

The first row names the columns and their units (see `drivecycles.header`); separators are comma, semicolon or
tab; lines that start with # are comments. Every complaint names the line of the file.
"""

import csv
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import numpy.typing as npt

from drivecycles.cycle import DriveCycle
from drivecycles.errors import CycleError
from drivecycles.header import Column, find_columns
from drivecycles.validation import find_fault

FloatArray = npt.NDArray[np.float64]

MAX_SPEED_MPS = 100.0
MAX_STEP_RATIO = 5.0
MAX_STEP_S = 2.0
MAX_GRADE = 0.5
ALTITUDE_NOISE_M = 5.0


def read_csv(path: str | Path, *, name: str | None = None, max_step_s: float | None = None) -> DriveCycle:
    """Read a drive cycle from a CSV file.

    Parameters
    ----------
    path : str or Path
        UTF-8 text with a header such as ``time_s,speed_kmh`` or ``Time [s]; Speed [m/s]; Altitude [m]``.
        Speed and time need a unit; altitude (m, ft) or grade (fraction or %) are optional, and altitude is
        used where both are given. Other columns are ignored.
    name : str, optional
        Name of the cycle; default: the file's name without ending.
    max_step_s : float, optional
        Longest time step that is no gap; default: the larger of 2 s and five times the median step.

    Returns
    -------
    DriveCycle
        In SI units. A grade is rise over horizontal run; between samples the mean of both ends counts.

    Raises
    ------
    CycleError
        If the file cannot be read, a column or unit is missing, a cell is no number, time does not increase
        or leaves a gap, a speed is negative or above 100 m/s, altitude jumps, a grade exceeds 50 %, or there
        are fewer than 2 samples.
    """
    path = Path(path)
    try:
        text = path.read_text(encoding="utf-8-sig")
    except UnicodeDecodeError as error:
        raise CycleError(f"{path} is not UTF-8 text; save it as CSV with UTF-8 encoding") from error
    except FileNotFoundError as error:
        raise CycleError(f"there is no file {path}; check the path") from error
    except OSError as error:
        raise CycleError(f"cannot read {path}: {error.strerror or error}") from error
    return parse_csv(text, name=path.stem if name is None else name, source=str(path), max_step_s=max_step_s)


def parse_csv(text: str, *, name: str, source: str, max_step_s: float | None = None) -> DriveCycle:
    """Parse the text of a cycle file; see `read_csv`, which reads the text from a file.

    Parameters
    ----------
    text : str
        Content of the file.
    name : str
        Name of the cycle.
    source : str
        What error messages call the file.
    max_step_s : float, optional
        Longest time step that is no gap.

    Raises
    ------
    CycleError
        As `read_csv`.
    """
    rows = _rows(text)
    _, header = next(rows, (0, []))
    if not header:
        raise CycleError(f"{source} is empty; the first row must name the columns, as in 'time_s,speed_kmh'")
    try:
        columns = find_columns(header)
    except CycleError as error:
        raise CycleError(f"{source}: {error}") from None
    lines, table = _numbers(rows, columns, source, len(header))
    time, speed = table["time"], table["speed"]
    if time.size < 2:
        raise CycleError(f"{source} holds {time.size} sample(s); a cycle needs at least 2")
    fault = (
        find_fault(time, speed, table.get("altitude", np.zeros_like(time)))
        or _too_fast(speed)
        or _gap(time, max_step_s)
        or _altitude_jump(time, speed, table.get("altitude"))
        or _too_steep(table.get("grade"))
    )
    if fault is not None:
        raise CycleError(f"{source}, line {lines[fault[0]]}: {fault[1]}")
    return DriveCycle(name, time, speed, _altitude(table))


def _rows(text: str) -> Iterator[tuple[int, list[str]]]:
    """Yield line number and cells of every line that is neither blank nor a comment, header first."""
    separator = ""
    for number, line in enumerate(text.splitlines(), start=1):
        content = line.strip(" \r")
        if not content.strip() or content.startswith("#"):
            continue
        separator = separator or next((mark for mark in ";\t" if mark in content), ",")
        if '"' in content:
            yield number, next(csv.reader([content], delimiter=separator, skipinitialspace=True))
        else:
            yield number, content.split(separator)


def _numbers(
    rows: Iterator[tuple[int, list[str]]], columns: dict[str, Column], source: str, width: int
) -> tuple[list[int], dict[str, FloatArray]]:
    """Turn the cells of the wanted columns into SI values, and keep each row's line number."""
    wanted = list(columns.values())
    lines: list[int] = []
    values: list[list[float]] = []
    for number, cells in rows:
        if any(cell.strip() for cell in cells[width:]):
            raise CycleError(
                f"{source}, line {number}: there are {len(cells)} values under {width} names; write decimals"
                " with a point, or separate the columns with semicolons"
            )
        try:
            values.append([float(cells[column.index]) for column in wanted])
        except (ValueError, IndexError):
            raise CycleError(f"{source}, line {number}: {_bad_cell(cells, wanted)}") from None
        lines.append(number)
    table = np.array(values, dtype=np.float64).reshape(len(values), len(wanted))
    return lines, {column.quantity: table[:, k] * column.factor for k, column in enumerate(wanted)}


def _bad_cell(cells: list[str], wanted: list[Column]) -> str:
    for column in wanted:
        cell = cells[column.index].strip() if column.index < len(cells) else ""
        if not cell:
            return f"the {column.quantity} is missing; fill it or delete the line"
        try:
            float(cell)
        except ValueError:
            hint = " (write decimals with a point)" if "," in cell else ""
            return f"the {column.quantity} {cell!r} is not a number{hint}"
    return "the line cannot be read"


def _too_fast(speed_mps: FloatArray) -> tuple[int, str] | None:
    i = int(speed_mps.argmax())
    if speed_mps[i] <= MAX_SPEED_MPS:
        return None
    return i, f"speed is {speed_mps[i]:g} m/s, more than {MAX_SPEED_MPS:g} m/s; check the unit in the header"


def _gap(time_s: FloatArray, max_step_s: float | None) -> tuple[int, str] | None:
    step = np.diff(time_s)
    limit = max(MAX_STEP_RATIO * float(np.median(step)), MAX_STEP_S) if max_step_s is None else max_step_s
    i = int(step.argmax())
    if step[i] <= limit * (1 + 1e-9):
        return None
    return i + 1, (
        f"{step[i]:g} s have passed since the sample before, while {limit:g} s are the most that is read as "
        "driving; fill the gap, resample the log, or split it there into two files and join them with '+'"
    )


def _altitude_jump(
    time_s: FloatArray, speed_mps: FloatArray, altitude_m: FloatArray | None
) -> tuple[int, str] | None:
    if altitude_m is None:
        return None
    distance = np.diff(time_s) * 0.5 * (speed_mps[1:] + speed_mps[:-1])
    excess = np.abs(np.diff(altitude_m)) - MAX_GRADE * distance - ALTITUDE_NOISE_M
    i = int(excess.argmax())
    if excess[i] <= 0:
        return None
    return i + 1, (
        f"altitude goes from {altitude_m[i]:g} to {altitude_m[i + 1]:g} m over {distance[i]:g} m of road; "
        "check the unit in the header, or smooth the altitude"
    )


def _too_steep(grade: FloatArray | None) -> tuple[int, str] | None:
    if grade is None:
        return None
    bad = np.flatnonzero(~(np.abs(grade) <= MAX_GRADE))
    if not bad.size:
        return None
    i = int(bad[0])
    return i, f"grade is {grade[i]:g}, beyond {MAX_GRADE:g} (50 %); check the unit in the header ('grade_%')"


def _altitude(table: dict[str, FloatArray]) -> FloatArray | None:
    if "altitude" in table or "grade" not in table:
        return table.get("altitude")
    distance = np.diff(table["time"]) * 0.5 * (table["speed"][1:] + table["speed"][:-1])
    tangent = 0.5 * (table["grade"][1:] + table["grade"][:-1])
    rise = distance * tangent / np.hypot(1.0, tangent)
    return np.concatenate(([0.0], np.cumsum(rise)))
