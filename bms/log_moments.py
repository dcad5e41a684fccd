"""Times that are written as dates or as a running clock: ISO 8601, and hours:minutes:seconds."""

from __future__ import annotations

import re
from datetime import UTC, datetime

EPOCH = datetime(1970, 1, 1, tzinfo=UTC)
_DATE = re.compile(r"\s*\d{4}-\d{2}-\d{2}")
_CLOCK = re.compile(r"\s*(\d+):(\d{2}):(\d{2}(?:[.,]\d*)?)\s*")


def is_moment(cell: str) -> bool:
    """Whether a cell looks like a date or a clock time rather than a number."""
    return ":" in cell or _DATE.match(cell) is not None


def seconds_of(cell: str) -> float:
    """Read ``2024-05-01T12:00:00.5+02:00`` or ``101:59:30.5`` (hours may exceed 23).

    Parameters
    ----------
    cell : str
        The text. A date without a zone counts as UTC.

    Returns
    -------
    float
        Seconds since 1970, or since the clock stood at zero.

    Raises
    ------
    ValueError
        When it is neither.
    """
    clock = _CLOCK.fullmatch(cell)
    if clock:
        return 3600.0 * int(clock[1]) + 60.0 * int(clock[2]) + float(clock[3].replace(",", "."))
    moment = datetime.fromisoformat(cell.strip())
    return ((moment if moment.tzinfo else moment.replace(tzinfo=UTC)) - EPOCH).total_seconds()
