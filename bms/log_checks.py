"""What a log may not contain, and what it only makes doubtful.

An error is what no estimator can work with: a clock that runs backwards, a voltage in the wrong unit. A doubt
is what is probably wrong and can be right: a current with the other sign, a clock in other units.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from bms.errors import BatteryError

if TYPE_CHECKING:
    from bms.cell import Cell
    from bms.logged_data import LoggedData

Array = NDArray[np.float64]

MIN_SAMPLES = 10
MOST_REPEATED = 0.5
HIGHEST_V, LOWEST_V = 1200.0, 0.05
COLDEST_C, HOTTEST_C = -60.0, 150.0
HIGHEST_C_RATE = 100.0
LONG_STEP_S = 120.0
WRONG_SIGN = -0.3
_TYPICAL = 0.99


def kept_times(time_s: Array, source: str, line_of: Callable[[int], int]) -> NDArray[np.bool_] | None:
    """Check that time increases, and say which samples to keep where some share their time.

    Of samples at the same time the last one is kept: its current is the one that flows from there on.

    Parameters
    ----------
    time_s : ndarray, shape (n,)
        Times as logged.
    source : str
        What messages call the log.
    line_of : callable
        Takes the index of a sample, returns the number of its line.

    Returns
    -------
    ndarray of bool, shape (n,), or None
        None where every time is there once.

    Raises
    ------
    BatteryError
        Too few samples, a time that is missing or runs backwards, or mostly repeated times.
    """
    if time_s.size < MIN_SAMPLES:
        raise BatteryError(f"{source} holds {time_s.size} samples; an estimate needs at least {MIN_SAMPLES}")
    bad = np.flatnonzero(~np.isfinite(time_s))
    if bad.size:
        at = int(bad[0])
        raise BatteryError(f"{source}, line {line_of(at)}: the time is {time_s[at]}; delete the line")
    steps = np.diff(time_s)
    back = np.flatnonzero(steps < 0.0)
    if back.size:
        at = int(back[0]) + 1
        raise BatteryError(
            f"{source}, line {line_of(at)}: time goes back from {time_s[at - 1]:.10g} to {time_s[at]:.10g} s"
            f"{f' (and {back.size - 1} times more)' if back.size > 1 else ''}; sort the log by time, or"
            " split it where its clock starts anew"
        )
    same = steps == 0.0
    repeated = int(np.count_nonzero(same))
    if not repeated:
        return None
    if repeated > MOST_REPEATED * time_s.size or time_s.size - repeated < MIN_SAMPLES:
        raise BatteryError(
            f"{source}: {repeated} of {time_s.size} samples repeat the time of the one before; log the"
            " time with more digits, or name another column with --time"
        )
    return np.concatenate((~same, [True]))


def check_scale(log: LoggedData) -> None:
    """Refuse values that no battery has.

    Raises
    ------
    BatteryError
        No current or voltage at all, a median voltage beyond 0.05 to 1200 V, a median temperature beyond
        -60 to 150 degC, or a SOC beyond 0 to 1.
    """
    for name, values in (("current", log.current_A), ("voltage", log.voltage_V)):
        if not np.any(np.isfinite(values)):
            raise BatteryError(
                f"{log.source}: the {name} is missing in every row; name another column with --{name}"
            )
    median_V = float(np.nanmedian(log.voltage_V))
    if not LOWEST_V <= abs(median_V) <= HIGHEST_V:
        looks, unit = ("mV", "mV") if abs(median_V) > HIGHEST_V else ("V rather than mV", "V")
        raise BatteryError(
            f"{log.source}: the median voltage is {median_V:g} V, which looks like {looks}; give the unit"
            f" behind a colon: --voltage {log.headers['voltage']!r}:{unit}"
        )
    if log.temperature_C is not None and np.any(np.isfinite(log.temperature_C)):
        median_C = float(np.nanmedian(log.temperature_C))
        if not COLDEST_C <= median_C <= HOTTEST_C:
            looks, unit = ("K", "K") if median_C > HOTTEST_C else ("degC rather than K", "degC")
            raise BatteryError(
                f"{log.source}: the median temperature is {median_C:g} degC, which looks like {looks}; give"
                f" the unit behind a colon: --temperature {log.headers['temperature']!r}:{unit}, or leave it"
                " out: --temperature none"
            )
    if log.soc_true is not None and np.any(np.isfinite(log.soc_true)):
        low, high = float(np.nanmin(log.soc_true)), float(np.nanmax(log.soc_true))
        if high > 1.5 or low < -0.5:
            raise BatteryError(
                f"{log.source}: the SOC goes from {low:g} to {high:g}, which looks like per cent; give the"
                f" unit behind a colon: --soc {log.headers['soc']!r}:%, or leave it out: --soc none"
            )


def check_cell(log: LoggedData, cell: Cell) -> None:
    """Refuse a log that cannot be one of this cell.

    Raises
    ------
    BatteryError
        When the median voltage is below half the cell's lowest or above 1.5 times its highest, or 1 % of the
        currents are beyond 100 times its capacity per hour.
    """
    median_V = float(np.nanmedian(log.voltage_V))
    if not 0.5 * cell.voltage_min_V <= median_V <= 1.5 * cell.voltage_max_V:
        ratio = median_V / float(cell.ocv(0.5))
        guess = f" (about {ratio:.0f} in series?)" if ratio >= 1.5 else ""
        raise BatteryError(
            f"{log.source}: the median voltage is {median_V:g} V, while {cell.name} works between"
            f" {cell.voltage_min_V:g} and {cell.voltage_max_V:g} V; check the unit of"
            f" {log.headers['voltage']!r} and the cell, or say how many are in series with --series{guess}"
        )
    typical_A = float(np.nanquantile(np.abs(log.current_A), _TYPICAL))
    if typical_A > HIGHEST_C_RATE * cell.capacity_Ah:
        raise BatteryError(
            f"{log.source}: currents reach {typical_A:g} A, {typical_A / cell.capacity_Ah:.0f} times what"
            f" {cell.name} ({cell.capacity_Ah:g} Ah) gives in an hour; is it mA? Give the unit behind a"
            f" colon: --current {log.headers['current']!r}:mA; for cells in parallel there is --parallel"
        )


def doubts(log: LoggedData) -> tuple[str, ...]:
    """Say what is probably wrong with a log and cannot be told for sure."""
    found = []
    if wrong_sign(log.current_A, log.voltage_V):
        found.append(
            "the voltage falls when the current rises, so a positive current seems to discharge;"
            " if so, add --discharge-positive"
        )
    finite = log.current_A[np.isfinite(log.current_A)]
    if finite.size and finite.max() != finite.min() and (finite.min() >= 0.0 or finite.max() <= 0.0):
        only = "charges" if finite.min() >= 0.0 else "discharges"
        found.append(f"the current only ever {only}; a column without sign would give a wrong SOC")
    if log.step_s > LONG_STEP_S:
        found.append(
            f"there is one sample every {log.step_s:g} s; if the time is in ms, say so:"
            f" --time {log.headers.get('time', 'time')!r}:ms"
        )
    return tuple(found)


def wrong_sign(current_A: Array, voltage_V: Array) -> bool:
    """Whether steps of current and voltage go against each other, which no resistance does.

    Compared are differences from sample to sample, in which the slow course of the SOC does not show.
    """
    with np.errstate(invalid="ignore"):
        rise_A, rise_V = np.diff(current_A), np.diff(voltage_V)
        # Noise of two sensors is independent; steps of the current are what counts.
        big = np.isfinite(rise_A) & np.isfinite(rise_V)
    rise_A, rise_V = rise_A[big], rise_V[big]
    scale = float(np.sqrt(np.mean(rise_A**2)) * np.sqrt(np.mean(rise_V**2))) if rise_A.size else 0.0
    return scale > 0.0 and float(np.mean(rise_A * rise_V)) < WRONG_SIGN * scale
