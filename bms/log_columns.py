"""Recognise the columns of a log by their header, which must carry the units.

``Test Time / s`` (Battery Data Format), ``test_time_second`` (its machine-readable name), ``t [ms]``,
``I(mA)``, ``current_A`` and ``Ecell/V`` are all read the same way: a name, then a unit. A column whose name
means nothing here is named by the user, with a unit behind a colon where the header has none: ``U:mV``.
"""

from __future__ import annotations

import difflib
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from bms.errors import BatteryError
from bms.log_moments import is_moment

QUANTITIES: dict[str, tuple[str, ...]] = {
    "time": (
        *("test time", "testtime", "total time", "elapsed time", "time", "t", "unix time"),
        *("timestamp", "date time", "datetime", "absolute time", "date"),
    ),
    "current": (
        *("current", "cell current", "battery current", "current measured", "i cell", "icell"),
        *("I", "i"),
    ),
    "voltage": (
        *("voltage", "cell voltage", "terminal voltage", "battery voltage", "voltage measured"),
        *("ecell", "ewe", "u cell", "ucell", "v cell", "vcell", "U", "u", "V", "v", "E"),
    ),
    "temperature": (
        *("cell temperature", "surface temperature", "surface temperature t1", "temperature t1"),
        *("temperature", "temperature measured", "aux temperature 1", "cell temp", "temp", "t cell", "T"),
        *("ambient temperature", "ambient temp"),
    ),
    "soc": ("true soc", "soc true", "soc", "state of charge"),
}
"""Names under which a quantity may appear, the preferred one first; single letters keep their case."""

UNITS: dict[str, dict[str, tuple[float, float]]] = {
    "time": {
        **dict.fromkeys(("s", "sec", "second", "seconds"), (1.0, 0.0)),
        **dict.fromkeys(("ms", "millisecond", "milliseconds"), (1e-3, 0.0)),
        **dict.fromkeys(("us", "µs", "μs"), (1e-6, 0.0)),
        **dict.fromkeys(("min", "minute", "minutes"), (60.0, 0.0)),
        **dict.fromkeys(("h", "hr", "hour", "hours"), (3600.0, 0.0)),
        **dict.fromkeys(("d", "day", "days"), (86400.0, 0.0)),
    },
    "current": {
        **dict.fromkeys(("A", "amp", "amps", "ampere", "amperes"), (1.0, 0.0)),
        **dict.fromkeys(("mA", "milliampere", "milliamp"), (1e-3, 0.0)),
        **dict.fromkeys(("uA", "µA", "μA", "microampere"), (1e-6, 0.0)),
    },
    "voltage": {
        **dict.fromkeys(("V", "volt", "volts"), (1.0, 0.0)),
        **dict.fromkeys(("mV", "millivolt", "millivolts"), (1e-3, 0.0)),
        **dict.fromkeys(("uV", "µV", "μV"), (1e-6, 0.0)),
    },
    "temperature": {
        **dict.fromkeys(("degC", "°C", "C", "℃", "celsius", "degreeC", "degreecelsius"), (1.0, 0.0)),
        **dict.fromkeys(("K", "kelvin"), (1.0, -273.15)),
        **dict.fromkeys(("degF", "°F", "F", "fahrenheit"), (5.0 / 9.0, -160.0 / 9.0)),
    },
    "soc": {
        **dict.fromkeys(("fraction", "1", "-", ""), (1.0, 0.0)),
        **dict.fromkeys(("%", "percent", "pct"), (0.01, 0.0)),
    },
}
"""Factor and offset from each accepted unit to s, A, V, deg C, fraction; a SOC without unit is a fraction."""

REQUIRED = ("time", "current", "voltage")
MOMENT = "date-time"
NO_COLUMN = "none"
SIMILAR = 0.75
_BRACKET = re.compile(r"^(.*?)\s*[\[({<]\s*([^\])}>]*)[\])}>]\s*$")
_DIVIDED = re.compile(r"^(.*\S)\s*[/,]\s*([^/,]*)$")
_TAIL = re.compile(r"^(.*\S)[ _]([^ _]+)$")
_ADVICE = {"time": "t:ms", "current": "I:mA", "voltage": "U:mV", "temperature": "T:degC", "soc": "SOC:%"}


@dataclass(frozen=True)
class Column:
    """Where a quantity stands in a row, and how its values become SI: ``factor * value + offset``.

    Parameters
    ----------
    quantity, header : str
        What it is, and what the file calls it.
    index : int
        Place in the row.
    unit : str
        As in the header or as given; ``date-time`` where the cells are dates or clock times.
    factor, offset : float
        To s, A, V, deg C, or a fraction.
    """

    quantity: str
    header: str
    index: int
    unit: str
    factor: float
    offset: float


def find_columns(
    header: Sequence[str], first_row: Sequence[str] = (), given: Mapping[str, str | None] | None = None
) -> dict[str, Column]:
    """Find the columns of time, current, voltage and, where present, temperature and SOC.

    Parameters
    ----------
    header : sequence of str
        Cells of the header row; columns that are none of the five are ignored.
    first_row : sequence of str
        Cells of the first row of data: a time that reads ``2024-05-01T12:00:00`` needs no unit.
    given : mapping of str to str, optional
        The user's own names by quantity: ``NAME``, ``NAME:UNIT``, or ``none`` for a column to leave out.

    Returns
    -------
    dict of str to Column
        By quantity.

    Raises
    ------
    BatteryError
        When a column is missing, appears twice, or has no unit or an unknown one.
    """
    cells = [cell.strip() for cell in header]
    wanted = {quantity: text for quantity, text in (given or {}).items() if text is not None}
    found: dict[str, Column] = {}
    for quantity in QUANTITIES:
        text = wanted.get(quantity)
        if text is not None and text.strip().lower() == NO_COLUMN and quantity not in REQUIRED:
            continue
        pick = _pick_given(cells, quantity, text) if text is not None else _pick(cells, quantity, first_row)
        if pick is not None:
            found[quantity] = _column(cells, quantity, *pick, first_row)
        elif quantity in REQUIRED:
            raise BatteryError(_missing(cells, quantity))
    return found


def split_header(cell: str, quantity: str) -> tuple[str, str]:
    """Take a header cell apart into a name, in the spelling of `QUANTITIES`, and a unit, or "" for none."""
    text = cell.strip()
    name, unit = text, ""
    for form in (_BRACKET, _DIVIDED):
        match = form.match(text)
        if match and match[1].strip():
            name, unit = match[1], match[2].strip()
            break
    else:
        match = _TAIL.match(text)
        if match and find_unit(match[2], quantity) is not None:
            name, unit = match[1], match[2]
    plain = re.sub(r"[\s_\-#<>|]+", " ", name).strip()
    return (plain if len(plain) == 1 else plain.casefold()), unit


def find_unit(text: str, quantity: str) -> tuple[float, float] | None:
    """Return factor and offset of a unit, or None if it is not one of this quantity; case matters last."""
    units = UNITS[quantity]
    unit = re.sub(r"[\s_]+", "", text)
    if unit in units:
        return units[unit]
    return next((value for known, value in units.items() if known.casefold() == unit.casefold()), None)


def _pick(cells: Sequence[str], quantity: str, first_row: Sequence[str]) -> tuple[int, str] | None:
    """Place and unit text of the best column whose name is known: with a unit first, then by preference."""
    ranked = []
    for place, cell in enumerate(cells):
        name, unit = split_header(cell, quantity)
        if name in QUANTITIES[quantity]:
            known = find_unit(unit, quantity) is not None or _is_moment(quantity, place, first_row)
            ranked.append((not known, QUANTITIES[quantity].index(name), place, unit))
    if not ranked:
        return None
    ranked.sort()
    best = ranked[0]
    rivals = [cells[place] for unknown, rank, place, _ in ranked if (unknown, rank) == best[:2]]
    if len(rivals) > 1:
        raise BatteryError(
            f"the columns {rivals[0]!r} and {rivals[1]!r} both hold the {quantity}; keep one, or name the"
            f" one to take with --{quantity}"
        )
    return best[2], best[3]


def _pick_given(cells: Sequence[str], quantity: str, text: str) -> tuple[int, str]:
    """Place and unit text of the column that the user names; a unit behind a colon goes first."""
    name, unit = text.strip(), ""
    places = _places(cells, name, quantity)
    if not places and ":" in name:
        name, _, unit = (part.strip() for part in name.rpartition(":"))
        places = _places(cells, name, quantity)
    if not places:
        near = next(iter(difflib.get_close_matches(name, cells, n=1, cutoff=0.5)), _near(cells, quantity))
        hint = f"; did you mean {near!r}?" if near else ""
        raise BatteryError(
            f"there is no column {name!r} for the {quantity}; the columns are {_quoted(cells)}{hint}"
        )
    if len(places) > 1:
        raise BatteryError(f"the column {name!r} for the {quantity} is there {len(places)} times; rename one")
    return places[0], unit or split_header(cells[places[0]], quantity)[1]


def _places(cells: Sequence[str], name: str, quantity: str) -> list[int]:
    """Columns that a name fits: as it stands, else in another case, else without the unit."""
    lower = name.casefold()
    spellings = (
        [cell == name for cell in cells],
        [cell.casefold() == lower for cell in cells],
        [split_header(cell, quantity)[0].casefold() == lower for cell in cells],
    )
    for fits in spellings:
        if any(fits):
            return [place for place, fit in enumerate(fits) if fit]
    return []


def _column(cells: Sequence[str], quantity: str, place: int, unit: str, first_row: Sequence[str]) -> Column:
    if _is_moment(quantity, place, first_row):
        return Column(quantity, cells[place], place, MOMENT, 1.0, 0.0)
    scale = find_unit(unit, quantity)
    if scale is None:
        raise BatteryError(_bad_unit(cells[place], quantity, unit))
    return Column(quantity, cells[place], place, unit, *scale)


def _is_moment(quantity: str, place: int, first_row: Sequence[str]) -> bool:
    return quantity == "time" and place < len(first_row) and is_moment(first_row[place])


def _bad_unit(cell: str, quantity: str, unit: str) -> str:
    allowed = ", ".join(u for u in UNITS[quantity] if u and u.isascii())
    leave = "" if quantity in REQUIRED else f", or leave it out: --{quantity} none"
    example = _ADVICE[quantity].partition(":")[2]
    how = f"write it into the header, or give it behind a colon: --{quantity} {cell!r}:{example}"
    if not unit:
        return f"the column {cell!r} has no unit for the {quantity}; {how} (known: {allowed}){leave}"
    near = difflib.get_close_matches(unit, UNITS[quantity], n=1)
    hint = f" (did you mean {near[0]!r}?)" if near else ""
    return f"the column {cell!r} has the unit {unit!r}, which is none of {allowed}{hint}; {how}{leave}"


def _missing(cells: Sequence[str], quantity: str) -> str:
    near = _near(cells, quantity)
    hint = f" (is it {near!r}?)" if near else ""
    return (
        f"there is no {quantity} column among {_quoted(cells)}{hint}; name it: --{quantity} NAME, with the"
        f" unit behind a colon where the header has none, as in --{quantity} {_ADVICE[quantity]}"
    )


def _near(cells: Sequence[str], quantity: str) -> str | None:
    """The column that looks most like a quantity: by its name, else by its unit."""
    scores = {
        cell: max(
            difflib.SequenceMatcher(None, split_header(cell, quantity)[0], name).ratio()
            for name in QUANTITIES[quantity]
            if len(name) > 1
        )
        for cell in cells
        if cell
    }
    best = max(scores, key=lambda cell: scores[cell], default=None)
    if best is not None and scores[best] >= SIMILAR:
        return best
    units = {cell: split_header(cell, quantity)[1] for cell in cells}
    by_unit = [cell for cell, unit in units.items() if unit and find_unit(unit, quantity) is not None]
    return by_unit[0] if len(by_unit) == 1 else None


def _quoted(cells: Sequence[str]) -> str:
    shown = ", ".join(repr(cell) for cell in cells[:20])
    return f"{shown} and {len(cells) - 20} more" if len(cells) > 20 else shown
