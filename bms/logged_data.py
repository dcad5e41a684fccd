"""Logged data: time, current, voltage and what else a log holds, from a CSV file of any make.

Columns are those of the Battery Data Format (``Test Time / s``, ``Current / A``, ``Voltage / V``; a positive
current charges), our own (``time_s``, ``current_A``, ``voltage_V``, ``temperature_C``, ``soc``), many that
cyclers write, and any others that are named; see `bms.log_columns`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from bms.errors import BatteryError
from bms.log_checks import MIN_SAMPLES, check_scale, doubts, kept_times
from bms.log_columns import MOMENT, Column, find_columns
from bms.log_text import Layout, blocks, layouts, line_of, parse

Array = NDArray[np.float64]

_ARRAYS = ("time_s", "current_A", "voltage_V", "temperature_C", "soc_true")
GAP_RATIO = 5.0
EPOCH_TIME_S = 1e9
"""A numeric time beyond this counts from 1970 and is counted from the first sample instead."""


@dataclass(frozen=True)
class Gap:
    """A pause in a log: when it begins, and how long it lasts."""

    start_s: float
    length_s: float


@dataclass(frozen=True, eq=False)
class LoggedData:
    """What a log holds, in SI units; arrays have the shape (n,) and cannot be written.

    Parameters
    ----------
    time_s : ndarray
        Strictly increasing; as logged, or from the first sample on where the log gives dates.
    current_A : ndarray
        > 0 charges; NaN where it is missing.
    voltage_V : ndarray
        Terminal voltage; NaN where it is missing.
    temperature_C : ndarray or None
        NaN where it is missing; None without such a column.
    soc_true : ndarray or None
        SOC that the log takes for true, a fraction.
    source : str
        Where it comes from.
    notes : tuple of str
        What was done to the data, and what is missing.
    doubts : tuple of str
        What is probably wrong, and what to do about it.
    headers : mapping of str to str
        What the file calls each quantity.
    """

    time_s: Array
    current_A: Array
    voltage_V: Array
    temperature_C: Array | None = None
    soc_true: Array | None = None
    source: str = "data"
    notes: tuple[str, ...] = ()
    doubts: tuple[str, ...] = ()
    headers: Mapping[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for name in _ARRAYS:
            given = getattr(self, name)
            if given is None:
                continue
            # A view can be locked without locking what the caller holds.
            values = np.asarray(given, dtype=np.float64).view()
            if values.shape != np.shape(self.time_s) or values.ndim != 1:
                raise BatteryError(f"{name} has the shape {values.shape}; give one row as long as time_s")
            values.setflags(write=False)
            object.__setattr__(self, name, values)

    def __len__(self) -> int:
        return self.time_s.size

    @cached_property
    def step_s(self) -> float:
        """Median time from one sample to the next, s."""
        return float(np.median(np.diff(self.time_s)))

    @cached_property
    def jitter_s(self) -> float:
        """Half the distance between the 5 % and the 95 % quantile of the steps, s."""
        low, high = np.quantile(np.diff(self.time_s), (0.05, 0.95))
        return 0.5 * float(high - low)

    @cached_property
    def gaps(self) -> tuple[Gap, ...]:
        """Steps longer than five times the median."""
        steps = np.diff(self.time_s)
        places = np.flatnonzero(steps > GAP_RATIO * self.step_s)
        return tuple(Gap(float(self.time_s[at]), float(steps[at])) for at in places)

    @property
    def duration_s(self) -> float:
        """Time from the first to the last sample, s."""
        return float(self.time_s[-1] - self.time_s[0])

    def after(self, start_s: float) -> LoggedData:
        """Leave out what was logged in the first ``start_s`` seconds, and what was to be said of it.

        Raises
        ------
        BatteryError
            When fewer than 10 samples are left, or the time is negative.
        """
        first = int(np.searchsorted(self.time_s, self.time_s[0] + start_s))
        left = len(self) - first
        if not start_s >= 0.0 or left < MIN_SAMPLES:
            raise BatteryError(
                f"a start after {start_s:g} s leaves {left if start_s >= 0.0 and left else 'nothing'} of the"
                f" {len(self)} samples of {self.source}, which lasts {self.duration_s:g} s; an estimate needs"
                f" at least {MIN_SAMPLES}"
            )
        later = slice(first, None)
        kept = {name: values[later] for name in _ARRAYS if (values := getattr(self, name)) is not None}
        log, of_all = replace(self, **kept), _value_notes(self)
        notes = [note for note in self.notes if note not in of_all]
        return replace(log, notes=(*notes, *_value_notes(log)), doubts=doubts(log))


def read_log(
    path: str | Path,
    *,
    columns: Mapping[str, str | None] | None = None,
    discharge_positive: bool = False,
    progress: Callable[[int, int], None] | None = None,
) -> LoggedData:
    """Read a log from a CSV file, which may be compressed (``.gz``).

    Parameters
    ----------
    path : str or Path
        Text with a header row; comma, semicolon or tab separate, with a semicolon or tab decimals may have a
        comma; lines that start with ``#`` are comments.
    columns : mapping of str to str, optional
        The user's own names for ``time``, ``current``, ``voltage``, ``temperature``, ``soc``: ``NAME``,
        ``NAME:UNIT``, or ``none`` to leave out one of the last two.
    discharge_positive : bool
        Whether a positive current in the file discharges; it is negated then.
    progress : callable, optional
        Called with bytes read and bytes in all.

    Returns
    -------
    LoggedData
        Empty cells and NaN of current and voltage stay, as NaN: an estimator knows what to do without them.
        Of samples at the same time the last one is kept.

    Raises
    ------
    BatteryError
        When the file cannot be read, a column or unit is missing, a cell is no number, time does not
        increase, there are fewer than 10 samples, or the values look like another unit. Names the line.
    """
    path = Path(path)
    layout, found = _recognised(path, columns)
    table, notes = _table(layout, found, progress)
    _check_order(layout, table, notes)
    if table["time"][0] > EPOCH_TIME_S or found[0].unit == MOMENT:
        notes.append(f"time counts from the first sample, {_start(found[0], table['time'][0])}")
        table["time"] -= table["time"][0]
    if discharge_positive:
        np.negative(table["current"], out=table["current"])
        notes.append("the sign of the current was turned: in the file a positive current discharges")
    for values in table.values():
        values[~np.isfinite(values)] = np.nan
    log = LoggedData(
        time_s=table["time"],
        current_A=table["current"],
        voltage_V=table["voltage"],
        temperature_C=table.get("temperature"),
        soc_true=table.get("soc"),
        source=str(path),
        notes=tuple(notes),
        headers={column.quantity: column.header for column in found},
    )
    check_scale(log)
    return replace(log, notes=(*log.notes, *_value_notes(log)), doubts=doubts(log))


def _recognised(path: Path, given: Mapping[str, str | None] | None) -> tuple[Layout, list[Column]]:
    """The first line that names all columns that are needed; the complaint is about the first line of all."""
    complaint = None
    for layout in layouts(path):
        try:
            return layout, list(find_columns(layout.header, layout.first_row, given).values())
        except BatteryError as error:
            complaint = complaint or error
    raise BatteryError(f"{path}: {complaint}") from None


def _table(
    layout: Layout, columns: list[Column], progress: Callable[[int, int], None] | None
) -> tuple[dict[str, Array], list[str]]:
    """Read all blocks and join them column by column, so that there is never a second copy of all."""
    size = layout.path.stat().st_size
    parts: dict[str, list[Array]] = {column.quantity: [] for column in columns}
    notes: list[str] = []
    for line, block, position in blocks(layout):
        values, unfinished = parse(layout, line, block, columns)
        for place, column in enumerate(columns):
            parts[column.quantity].append(column.factor * values[:, place] + column.offset)
        if unfinished:
            notes.append("the last line is not complete and was left out")
        if progress is not None:
            progress(position, size)
    return {quantity: np.concatenate([*parts.pop(quantity), []]) for quantity in list(parts)}, notes


def _check_order(layout: Layout, table: dict[str, Array], notes: list[str]) -> None:
    time_s = table["time"]
    keep = kept_times(time_s, str(layout.path), lambda sample: line_of(layout, sample))
    if keep is None:
        return
    repeated = time_s.size - int(np.count_nonzero(keep))
    first = line_of(layout, int(np.argmin(keep)))
    for quantity in table:
        table[quantity] = table[quantity][keep]
    notes.append(
        f"{repeated} samples have the same time as the next one (first in line {first});"
        " the last of each was kept"
    )


def _value_notes(log: LoggedData) -> list[str]:
    """Say how much is missing, and where time jumps."""
    notes = []
    for name, values in (
        ("current", log.current_A),
        ("voltage", log.voltage_V),
        ("temperature", log.temperature_C),
        ("soc", log.soc_true),
    ):
        count = 0 if values is None else int(np.count_nonzero(~np.isfinite(values)))
        if count:
            notes.append(f"the {name} is missing in {count} of {len(log)} samples")
    return [*notes, *_gap_note(log)]


def _gap_note(log: LoggedData) -> list[str]:
    if not log.gaps:
        return []
    longest = max(log.gaps, key=lambda gap: gap.length_s)
    count = f"{len(log.gaps)} gaps" if len(log.gaps) > 1 else "1 gap"
    return [
        f"{count} longer than {GAP_RATIO:g} times the usual step of {log.step_s:g} s; the longest, of"
        f" {longest.length_s:g} s, begins at {longest.start_s:g} s"
    ]


def _start(column: Column, first_s: float) -> str:
    if column.unit != MOMENT or first_s > EPOCH_TIME_S:
        return f"{np.datetime64(round(1e3 * first_s), 'ms')} UTC"
    return f"{first_s:g} s on the clock of the log"
